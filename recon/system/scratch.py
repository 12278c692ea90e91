"""Folders that live as long as the process that made them; what killed processes left is swept by those that follow.

A folder's name says which process it belongs to: a hash of the machine's name, the process's number, and a hash of when
it started, since numbers are given again.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PREFIX = "scratch-"
_NAME = re.compile(r"([0-9a-f]{8})-([0-9]+)-([0-9a-f]{8})-")


@contextmanager
def folder(parent: Path, prefix: str = PREFIX) -> Iterator[Path]:
    """A new folder in `parent` (made if need be) that vanishes with the block. Raises OSError."""
    parent.mkdir(parents=True, exist_ok=True)
    sweep(parent, prefix)
    own = Path(tempfile.mkdtemp(prefix=f"{prefix}{_short(platform.node())}-{_process(os.getpid())}-", dir=parent))
    try:
        yield own
    finally:
        shutil.rmtree(own, ignore_errors=True)


def sweep(parent: Path, prefix: str = PREFIX) -> None:
    """Remove the folders in `parent` whose processes have ended; those of other machines are let alone."""
    for entry in parent.glob(f"{prefix}*"):
        named = _NAME.match(entry.name.removeprefix(prefix))
        if named is None or named[1] != _short(platform.node()) or entry.is_symlink():
            continue
        if _process(int(named[2])) != f"{named[2]}-{named[3]}":
            shutil.rmtree(entry, ignore_errors=True)


def fresh(path: Path) -> Path:
    """An empty folder at `path`, whatever was there before. Raises OSError."""
    remove(path)
    path.mkdir(parents=True)
    return path


def remove(path: Path) -> None:
    """Remove a file, a link or a folder with all it holds, if it is there. Raises OSError."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def started(pid: int) -> str:
    """When a process started, unlike that of any other with its number; empty when it does not run.

    Where there is no /proc, all that run are taken to have started at one time.
    """
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return "running" if _runs(pid) else ""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if after_name[0] in "ZX" else f"{boot} {after_name[19]}"


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:  # it belongs to somebody else
        return True
    return True


def _process(pid: int) -> str:
    return f"{pid}-{_short(started(pid))}"


def _short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]
