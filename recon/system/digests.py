"""Digests: what tells whether files, options and code are the same as before."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any


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


def code_version() -> str:
    """This project's version: results of another version are stale."""
    try:
        return version("nnproc-recon")
    except PackageNotFoundError:
        return "uninstalled"
