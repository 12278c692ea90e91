"""Files written whole or not at all, and pictures read from any path."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import tempfile
from pathlib import Path

import cv2
import numpy as np

_FULL = (errno.ENOSPC, errno.EDQUOT)
_NEARLY_FULL = 64 * 1024  # bytes: libraries that fail without saying why had no more than that


def write_bytes(path: Path, data: bytes, durable: bool = False) -> None:
    """Replace a file, or make it: at every moment it is the old one or the whole new one. Raises OSError.

    durable  it is that even when the power fails; takes some milliseconds
    """
    partial = path.with_name(f".{hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]}.partial")
    try:
        with partial.open("wb") as file:
            file.write(data)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_picture(path: Path, image: np.ndarray, *settings: int) -> None:
    """Encode a picture (BGR, grey or BGRA uint8) by the path's ending and write it. Raises OSError.

    settings  OpenCV's, such as cv2.IMWRITE_JPEG_QUALITY, 95
    """
    ok, data = cv2.imencode(path.suffix, image, settings)
    if not ok:
        raise OSError(f"{path}: a picture of {image.shape[1]} x {image.shape[0]} pixels cannot be stored like this")
    write_bytes(path, data.tobytes())


def read_picture(path: Path, flags: int = cv2.IMREAD_COLOR) -> np.ndarray | None:
    """As cv2.imread, which crashes on file names that are not UTF-8; None for what is no picture or not there."""
    try:
        data = np.fromfile(path, np.uint8)
    except OSError:
        return None
    return cv2.imdecode(data, flags) if len(data) else None


def disk_is_full(error: BaseException, folder: Path) -> bool:
    """Whether an error comes from a full disk: it says so, or `folder` or that for scratch files has no space."""
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno in _FULL
    there = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    return min(shutil.disk_usage(p).free for p in (there, tempfile.gettempdir())) < _NEARLY_FULL
