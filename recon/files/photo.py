"""Reading one photo of any common format: orientation, colour, size, alpha and the EXIF focal length."""

from __future__ import annotations

import math
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pillow_heif
from PIL import ExifTags, Image, UnidentifiedImageError

from recon.files.raw_photo import RawError, is_raw
from recon.files.raw_photo import read as read_raw
from recon.system import limits

pillow_heif.register_heif_opener()

# Named, because PIL would also open documents (EPS through an outside program, PSD, ...). JPEG includes MPO.
FORMATS = ("JPEG", "PNG", "HEIF", "AVIF", "WEBP", "TIFF", "BMP", "JPEG2000")
ENDINGS = {
    *(".jpg", ".jpeg", ".jpe", ".jfif", ".mpo", ".png", ".heic", ".heif", ".avif", ".webp", ".tif", ".tiff", ".bmp"),
    *(".jp2", ".j2k", ".jpf", ".jpx", ".j2c"),
}
BACKGROUND = (128, 128, 128)  # behind transparent pixels: both white and black objects keep their outline on grey
SHARPNESS_SIDE = 640  # px of the longest side at which sharpness is measured, so that photos compare
DIAGONAL_35MM = 43.27  # mm, of a 36 x 24 mm frame

Image.MAX_IMAGE_PIXELS = limits.PIXELS // 2  # PIL warns above it, and refuses above twice as many
_TOO_LARGE = f"too large: at most {limits.PIXELS // 10**6} megapixels and {limits.PICTURE_SIDE} pixels a side are read"
_ONE_LARGE = threading.Lock()
# How PIL turns an image upright, by EXIF orientation.
_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}


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
    return path.suffix.lower() in ENDINGS or is_raw(path)


def read_photo(path: Path, longest_side: int) -> Photo | None:
    """The photo in a file, its longest side at most `longest_side` px; None when the file is something else.

    Raises UnreadablePhoto for a damaged or unusable photo.
    """
    try:
        size = path.stat().st_size
        if size == 0 and looks_like_photo(path):
            raise UnreadablePhoto("the file is empty")
        if size > limits.PICTURE_BYTES and looks_like_photo(path):
            raise UnreadablePhoto(f"too large: {size >> 20} MB, at most {limits.PICTURE_BYTES >> 20} are read")
        if not 0 < size <= limits.PICTURE_BYTES:
            return None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # PIL warns of large images at half of the size that it refuses
            return _raw(path, longest_side) if is_raw(path) else _decode(path, longest_side)
    except UnidentifiedImageError as error:
        if looks_like_photo(path):
            raise UnreadablePhoto("not an image, or its beginning is damaged") from error
        return None
    except RawError as error:
        raise UnreadablePhoto(str(error)) from error
    except (UnreadablePhoto, MemoryError):
        raise
    except PermissionError as error:
        raise UnreadablePhoto("it may not be read; check its permissions") from error
    except Exception as error:  # decoders fail in many ways on damaged files: SyntaxError, struct.error, ...
        raise UnreadablePhoto(f"damaged or cut off ({error})") from error


@contextmanager
def opened(path: Path, formats: tuple[str, ...] = FORMATS) -> Iterator[Image.Image]:
    """A picture whose header was read and whose size can be held; large ones are held one at a time.

    Raises UnreadablePhoto when it is too large, and what PIL raises when it is none.
    """
    try:
        image = Image.open(path, formats=formats)
    except Image.DecompressionBombError as error:
        raise UnreadablePhoto(f"{_TOO_LARGE}; save it smaller") from error
    with image:
        width, height = image.size
        if max(image.size) > limits.PICTURE_SIDE or width * height > limits.PIXELS:
            raise UnreadablePhoto(f"{_TOO_LARGE}, and it has {width} x {height}; save it smaller")
        with _ONE_LARGE if width * height > limits.PIXELS_AT_ONCE else nullcontext():
            yield image


def thinned(image: Image.Image, pixels: int) -> Image.Image:
    """Every n-th pixel of every n-th row where the image has more than `pixels`; values stay what they are."""
    step = math.ceil(math.sqrt(image.width * image.height / pixels))
    if step < 2:
        return image
    return image.resize((-(-image.width // step), -(-image.height // step)), Image.Resampling.NEAREST)


def _decode(path: Path, longest_side: int) -> Photo:
    with opened(path) as image:
        focal_in_diagonals, full = exif_focal(image.getexif(), image.size), image.size
        # JPEGs can be decoded at 1/2, 1/4, 1/8 size, which saves most of the time for large ones.
        image.draft("RGB", (longest_side, longest_side))
        small = _reduced(_eight_bit(image), longest_side)
        # HEIF and TIFF turn themselves while decoding and reset the EXIF orientation, so nothing turns twice.
        turn = _TURNS.get(image.getexif().get(ExifTags.Base.Orientation, 1))
    if turn is not None:
        small = small.transpose(turn)
    if (small.width < small.height) != (full[0] < full[1]):
        full = full[::-1]  # turned upright since
    rgb, mask = _without_alpha(small)
    return Photo(rgb, mask, focal_in_diagonals * math.hypot(*rgb.size), full)


def _raw(path: Path, longest_side: int) -> Photo:
    with _ONE_LARGE:
        image = read_raw(path)
        small = _reduced(image, longest_side)
    focal = math.nan
    try:
        with Image.open(path, formats=["TIFF"]) as record:  # most raw formats are TIFF inside
            focal = exif_focal(record.getexif(), image.size)
    except (OSError, SyntaxError, ValueError):
        pass
    return Photo(small, None, focal * math.hypot(*small.size), image.size)


def _reduced(image: Image.Image, longest_side: int) -> Image.Image:
    """RGB, or RGBA where the image has transparency, with its longest side at most `longest_side` px."""
    scale = longest_side / max(image.size)
    if "A" in image.getbands() or "a" in image.getbands() or "transparency" in image.info:
        image = image.convert("RGBA")
    elif image.mode != "RGB":
        image = image.convert("RGB")
    if scale < 1:
        size = (max(1, round(image.width * scale)), max(1, round(image.height * scale)))
        image = image.resize(size, Image.Resampling.LANCZOS, reducing_gap=3.0)
    return image


def _eight_bit(image: Image.Image) -> Image.Image:
    """16- and 32-bit grey images brought to 8 bits; PIL itself reduces 16-bit colour."""
    if not image.mode.startswith(("I", "F")):
        image.load()
        return image
    values = np.asarray(image, dtype=np.float32)
    # Neither mode says what white is: take the smallest usual one that holds every value.
    white = next((w for w in (1.0, 255.0, 65535.0) if values.max() <= w), float(values.max()))
    white = 65535.0 if image.mode.startswith("I;16") else white
    out = Image.fromarray(np.clip(values * np.float32(255 / white), 0, 255).astype(np.uint8))
    out.info = image.info
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
