"""Files of the user that are read whole: of a size that can be held, and ordinary files, which come to an end."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from recon.scene import InputError
from recon.system import limits
from recon.system.folders import is_file


def read_bytes(path: Path, most: int = limits.CAMERAS) -> bytes:
    """A file's content. Raises InputError when it cannot be read, or has more than `most` bytes."""
    try:
        if not is_file(path):
            raise InputError(f"{path} is not there, or is no file")
        if (size := path.stat().st_size) > most:
            raise InputError(f"{path} is too large: {size >> 20} MB, at most {most >> 20} are read")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error


def read_json(path: Path, what: str) -> Any:
    """A JSON file's content, with a byte-order mark or without.

    Raises InputError, which says that the file is not `what` (such as "Pix3D's pix3d.json").
    """
    try:
        return json.loads(read_bytes(path, limits.JSON))
    except RecursionError as error:
        raise InputError(f"{path} cannot be read as {what} (it is nested too deeply)") from error
    except ValueError as error:
        raise InputError(f"{path} cannot be read as {what} ({error})") from error
