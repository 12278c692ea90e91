"""JSON files of the user: of a size that can be held, in UTF-8 with or without a mark."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from recon import limits
from recon.scene import InputError


def read_json(path: Path, what: str) -> Any:
    """The content of a file. Raises InputError, which says that it is not `what` (such as "Pix3D's pix3d.json")."""
    try:
        if not path.is_file():
            raise InputError(f"{path} is no file; {what} is wanted")
        if (size := path.stat().st_size) > limits.JSON:
            raise InputError(
                f"{path} has {size >> 20} MB, and {what} of at most {limits.JSON >> 20} MB is read; keep the records "
                "that are needed"
            )
        return json.loads(path.read_bytes().decode("utf-8-sig"))
    except RecursionError as error:
        raise InputError(f"{path} cannot be read as {what} (it is nested too deeply)") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read as {what} ({error})") from error
