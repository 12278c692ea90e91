"""What in a folder is the user's, and what systems leave there."""

from __future__ import annotations

import os
from pathlib import Path

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


def lies_in(path: Path, folder: Path) -> bool:
    """Whether a path as it is written lies in a folder; the user's own links inside the folder count as inside."""
    inside, outer = (os.path.abspath(p) for p in (path, folder))
    return inside == outer or inside.startswith(outer.rstrip(os.sep) + os.sep)
