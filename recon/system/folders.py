"""What in a folder is the user's, and what systems leave there."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from recon.system import limits
from recon.system.digests import digest

_LEFT_BY_SYSTEMS = {"thumbs.db", "desktop.ini", "ehthumbs.db", "__macosx", "icon\r"}  # besides ._* and other dot files


def is_left_by_systems(name: str) -> bool:
    """Whether a file or folder of this name is one that macOS, Windows or others leave, or hidden."""
    return name.startswith(".") or name.lower() in _LEFT_BY_SYSTEMS


def entries(folder: Path) -> list[Path]:
    """Files and folders of a folder, sorted by name, without what systems leave there. Raises OSError."""
    return sorted(p for p in folder.iterdir() if not is_left_by_systems(p.name))


def is_file(path: Path) -> bool:
    """Whether a path is an ordinary file; also False for names that no file system takes, and loops of links."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def exists(path: Path) -> bool:
    """Whether something is there; False for names that no file system takes."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def digest_of(files: list[Path], folder: Path) -> str:
    """A digest of the names below `folder` and the contents of files; of too large or unreadable ones, of less."""
    return digest([[str(p.relative_to(folder)), _content(p)] for p in files])


def _content(path: Path) -> str:
    try:
        if (size := path.stat().st_size) > limits.PICTURE_BYTES:
            return f"{size} bytes"
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return "unreadable"


def lies_in(path: Path, folder: Path) -> bool:
    """Whether a path as it is written lies in a folder; the user's own links inside the folder count as inside."""
    inside, outer = (os.path.abspath(p) for p in (path, folder))
    return inside == outer or inside.startswith(outer.rstrip(os.sep) + os.sep)
