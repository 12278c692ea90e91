"""Digests: what tells whether files, options and code are the same as before."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from recon.system import limits


def digest(*parts: Any) -> str:
    """16 hex digits over JSON-able values, dataclasses of options and other digests."""
    plain = [asdict(p) if is_dataclass(p) and not isinstance(p, type) else p for p in parts]
    return hashlib.sha256(json.dumps(plain, sort_keys=True, default=str).encode()).hexdigest()[:16]


def folder_digest(folder: Path | None) -> str:
    """A digest of the names and contents of a folder's files (not of its subfolders); "none" for None."""
    if folder is None:
        return "none"
    files = sorted(p for p in folder.iterdir() if p.is_file())
    return digest([[p.name, file_digest(p)] for p in files])


def file_digest(path: Path) -> str:
    """SHA-256 of a file's content, of which little is in memory at a time. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest_of_input(path: Path | None) -> str:
    """A digest of a file that the user gave and of the files beside it that it names if it is JSON; "none" for None.

    Raises OSError.
    """
    if path is None:
        return "none"
    return digest(file_digest(path), [[str(p), file_digest(p)] for p in _named_in(path)])


def _named_in(path: Path) -> list[Path]:
    """Files beside or below a JSON file (a glTF's buffers, a SOG's images) that its text names."""
    with path.open("rb") as file:
        if file.read(1) != b"{" or path.stat().st_size > limits.JSON:
            return []
    said = set(re.findall(rb'"([^"\\\n]{1,255})"', path.read_bytes()))
    named = sorted({unquote(s.decode("utf-8", "replace")) for s in said})
    return [path.parent / n for n in named if not n.startswith(("/", "..")) and _is_file(path.parent / n)]


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # no file system takes such a name
        return False


def code_version() -> str:
    """This project's version: results of another version are stale."""
    try:
        return version("nnproc-recon")
    except PackageNotFoundError:
        return "uninstalled"
