"""Raw photos of cameras (DNG, NEF, CR2, ARW, ...): the camera's own full-size preview, or developed by libraw.

libraw comes with the package rawpy, which is an extra: pip install "nnproc-recon[raw]".
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from PIL import ExifTags, Image, ImageOps

ENDINGS = {
    *(".dng", ".nef", ".nrw", ".cr2", ".cr3", ".crw", ".arw", ".srf", ".sr2", ".orf", ".raf", ".rw2", ".rwl", ".pef"),
    *(".srw", ".3fr", ".fff", ".iiq", ".x3f", ".erf", ".kdc", ".dcr", ".mrw", ".mos", ".gpr"),
}
FULL = 0.8  # of the sensor's longer side that a preview must have; smaller ones are thumbnails
_TURN = {3: Image.Transpose.ROTATE_180, 5: Image.Transpose.ROTATE_90, 6: Image.Transpose.ROTATE_270}  # libraw's flips


class RawError(Exception):
    """This raw photo cannot be read; the message says why and what to do."""


def is_raw(path: Path) -> bool:
    """Whether the name promises a raw photo."""
    return path.suffix.lower() in ENDINGS


def read(path: Path) -> Image.Image:
    """The upright picture at full size, RGB, with the EXIF record of the file. Raises RawError."""
    try:
        import rawpy
    except ImportError as error:
        raise RawError(
            'a raw photo, which needs the package rawpy (pip install "nnproc-recon[raw]"); or export it as JPEG'
        ) from error
    try:
        with rawpy.imread(str(path)) as raw:
            image = _preview(rawpy, raw)
            if image is None:
                # Half size halves each side of what has four pixels for one colour: nothing is lost but memory.
                image = Image.fromarray(raw.postprocess(use_camera_wb=True, half_size=True, output_bps=8))
    except (rawpy.LibRawError, OSError, ValueError, MemoryError) as error:
        words = error.args[0].decode() if error.args and isinstance(error.args[0], bytes) else str(error)
        raise RawError(f"libraw cannot read this raw photo ({words}); export it as JPEG") from error
    image.info.pop("exif", None)
    return image


def _preview(rawpy: Any, raw: Any) -> Image.Image | None:
    """The camera's own JPEG, upright; None when there is none of nearly full size."""
    try:
        thumb = raw.extract_thumb()
    except (rawpy.LibRawNoThumbnailError, rawpy.LibRawUnsupportedThumbnailError):
        return None
    if thumb.format == rawpy.ThumbFormat.JPEG:
        image: Image.Image = Image.open(io.BytesIO(thumb.data), formats=["JPEG"])
    else:
        image = Image.fromarray(thumb.data)
    if max(image.size) < FULL * max(raw.sizes.width, raw.sizes.height):
        return None
    image.load()
    told = image.getexif().get(ExifTags.Base.Orientation)
    if told is None and (turn := _TURN.get(raw.sizes.flip)) is not None:
        return image.transpose(turn)
    return ImageOps.exif_transpose(image).convert("RGB")
