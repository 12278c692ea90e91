"""Reading one photo of any common format: orientation, colour, size, alpha and the EXIF focal length."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pillow_heif
from PIL import ExifTags, Image, ImageOps, UnidentifiedImageError

pillow_heif.register_heif_opener()

# Named, because PIL would also open documents (EPS through an outside program, PSD, ...). JPEG includes MPO.
FORMATS = ("JPEG", "PNG", "HEIF", "AVIF", "WEBP", "TIFF", "BMP")
ENDINGS = {".jpg", ".jpeg", ".png", ".heic", ".heif", ".avif", ".webp", ".tif", ".tiff", ".bmp"}
BACKGROUND = (128, 128, 128)  # behind transparent pixels: both white and black objects keep their outline on grey
SHARPNESS_SIDE = 640  # px of the longest side at which sharpness is measured, so that photos compare
DIAGONAL_35MM = 43.27  # mm, of a 36 x 24 mm frame


class UnreadablePhoto(Exception):
    """This file is meant to be a photo but cannot be used."""

    @property
    def reason(self) -> str:
        return str(self)


@dataclass(frozen=True)
class Photo:
    """An upright RGB image at working size, its mask (mode L, 0 or 255) from an alpha channel, and EXIF focal length.

    focal_px is in pixels of `image`, NaN where EXIF does not tell; original (width, height) in pixels, upright.
    """

    image: Image.Image
    mask: Image.Image | None
    focal_px: float
    original: tuple[int, int] = (0, 0)

    def sharpness(self) -> float:
        """Variance of the Laplacian of the grey image with its longest side at SHARPNESS_SIDE px."""
        scale = SHARPNESS_SIDE / max(self.image.size)
        size = (max(3, round(self.image.width * scale)), max(3, round(self.image.height * scale)))
        grey = cv2.resize(np.asarray(self.image.convert("L")), size, interpolation=cv2.INTER_AREA)
        return float(cv2.Laplacian(grey, cv2.CV_64F).var())

    def thumbnail(self, side: int) -> np.ndarray:
        """(side, side) uint8, grey (formats differ in colour resolution), whatever the aspect ratio."""
        return cv2.resize(np.asarray(self.image.convert("L")), (side, side), interpolation=cv2.INTER_AREA)


def looks_like_photo(path: Path) -> bool:
    """Whether the name promises a photo."""
    return path.suffix.lower() in ENDINGS


def read_photo(path: Path, longest_side: int) -> Photo | None:
    """The photo in a file, its longest side at most `longest_side` px; None when the file is something else.

    Raises UnreadablePhoto for a damaged or unusable photo.
    """
    try:
        if path.stat().st_size == 0:
            if looks_like_photo(path):
                raise UnreadablePhoto("the file is empty")
            return None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # PIL warns of large images at half of the size that it refuses
            return _decode(path, longest_side)
    except UnidentifiedImageError as error:
        if looks_like_photo(path):
            raise UnreadablePhoto("not an image, or its beginning is damaged") from error
        return None
    except Image.DecompressionBombError as error:
        limit = 2 * (Image.MAX_IMAGE_PIXELS or 0) // 10**6
        raise UnreadablePhoto(f"too large: more than {limit} megapixels; save it smaller") from error
    except UnreadablePhoto:
        raise
    except Exception as error:  # decoders fail in many ways on damaged files: SyntaxError, struct.error, ...
        raise UnreadablePhoto(f"damaged or cut off ({error})") from error


def _decode(path: Path, longest_side: int) -> Photo:
    with Image.open(path, formats=FORMATS) as opened:
        focal_in_diagonals = exif_focal(opened.getexif(), opened.size)
        full = opened.size
        # JPEGs can be decoded at 1/2, 1/4, 1/8 size, which saves most of the time for large ones.
        opened.draft("RGB", (longest_side, longest_side))
        image: Image.Image = opened
        scale = longest_side / max(image.size)
        # HEIF turns itself while decoding, and its reader resets the EXIF orientation, so nothing turns twice.
        image = ImageOps.exif_transpose(_eight_bit(image))
    if (image.width < image.height) != (full[0] < full[1]):
        full = full[::-1]  # turned upright since
    if "A" in image.getbands() or "a" in image.getbands() or "transparency" in image.info:
        image = image.convert("RGBA")
    elif image.mode != "RGB":
        image = image.convert("RGB")
    if scale < 1:
        size = (max(1, round(image.width * scale)), max(1, round(image.height * scale)))
        image = image.resize(size, Image.Resampling.LANCZOS, reducing_gap=3.0)
    rgb, mask = _without_alpha(image)
    return Photo(rgb, mask, focal_in_diagonals * math.hypot(*rgb.size), full)


def _eight_bit(image: Image.Image) -> Image.Image:
    """16- and 32-bit grey images brought to 8 bits; PIL itself reduces 16-bit colour."""
    if not image.mode.startswith(("I", "F")):
        image.load()
        return image
    values = np.asarray(image, dtype=np.float64)
    # Neither mode says what white is: take the smallest usual one that holds every value.
    white = next((w for w in (1.0, 255.0, 65535.0) if values.max() <= w), float(values.max()))
    white = 65535.0 if image.mode.startswith("I;16") else white
    out = Image.fromarray(np.clip(values * (255 / white), 0, 255).astype(np.uint8))
    out.info = image.info
    if orientation := image.getexif().get(ExifTags.Base.Orientation):
        out.getexif()[ExifTags.Base.Orientation] = orientation
    return out


def _without_alpha(image: Image.Image) -> tuple[Image.Image, Image.Image | None]:
    """RGB over grey, and the mask; no mask when every pixel is at least half opaque."""
    if image.mode == "RGB":
        return image, None
    alpha = image.getchannel("A")
    mask = alpha.point([0] * 128 + [255] * 128)
    low, high = mask.getextrema()
    if high == 0:
        raise UnreadablePhoto("it is transparent everywhere")
    if low == 255:
        return image.convert("RGB"), None
    rgb = Image.new("RGB", image.size, BACKGROUND)
    rgb.paste(image.convert("RGB"), mask=alpha)
    return rgb, mask


def exif_focal(exif: Image.Exif, size: tuple[int, int]) -> float:
    """Focal length in units of the image diagonal, NaN when EXIF does not tell or the value is absurd.

    "35 mm equivalent" is defined by the diagonal angle of view (CIPA DC-008), so it is divided by the diagonal of the
    35 mm frame. Otherwise the focal length in mm and the sensor's pixels per unit are used; these refer to the size
    that the camera wrote (PixelXDimension), which an editor may have changed since. `size` (width, height) as stored.
    """
    tags = exif.get_ifd(ExifTags.IFD.Exif)
    f35 = _number(tags, ExifTags.Base.FocalLengthIn35mmFilm)
    if f35 > 0:
        return _plausible(f35 / DIAGONAL_35MM)
    focal_mm = _number(tags, ExifTags.Base.FocalLength)
    per_unit = _number(tags, ExifTags.Base.FocalPlaneXResolution)
    unit = _number(tags, ExifTags.Base.FocalPlaneResolutionUnit)
    mm = {3: 10.0, 4: 1.0, 5: 0.001}.get(int(unit) if unit > 0 else 2, 25.4)
    if not (focal_mm > 0 and per_unit > 0):
        return math.nan
    width, height = size
    written = _number(tags, ExifTags.Base.ExifImageWidth)
    if not written > 0:
        written = width
    elif (width < height) != (written < _number(tags, ExifTags.Base.ExifImageHeight)):
        width, height = height, width  # turned by an editor since: the written width is now the height
    focal = focal_mm * per_unit / mm * width / written
    return _plausible(focal / math.hypot(width, height))


def _plausible(in_diagonals: float) -> float:
    """NaN beyond a fisheye's or a long telephoto lens's focal length."""
    return in_diagonals if 0.15 < in_diagonals < 10 else math.nan


def _number(tags: Any, tag: int) -> float:
    """A positive EXIF number; NaN when missing or broken (0/0 happens)."""
    try:
        value = float(tags[tag])
        return value if math.isfinite(value) else math.nan
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return math.nan
