"""One run at a time in a results folder.

The lock is the operating system's, on a file, so that it ends with its process however that ends. The file names the
process and when it started, which tells others who it is; and it serves alone where the file system knows no locks.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import platform
from collections.abc import Iterator
from pathlib import Path

from recon.scene import InputError
from recon.system import scratch

NAME = "lock"


class Busy(InputError):
    """Another process uses the folder; when it has ended, the same can be done."""


@contextlib.contextmanager
def held(folder: Path, shown_as: Path) -> Iterator[None]:
    """Hold the lock of `folder` (which exists) while the block runs.

    Raises Busy, which says who holds it, when another process does; OSError when the file cannot be written.
    """
    path = folder / NAME
    descriptor = _opened(path, shown_as)
    try:
        os.pwrite(descriptor, json.dumps(_self()).encode().ljust(os.fstat(descriptor).st_size), 0)
        yield
    finally:
        with contextlib.suppress(FileNotFoundError):
            path.unlink()  # before it is unlocked: whoever waits for this file then sees that it is gone
        os.close(descriptor)


def _opened(path: Path, shown_as: Path) -> int:
    """The descriptor of the locked file."""
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
        try:
            locked = _lock(descriptor)
            holder = _holder(descriptor)
            if not locked or _runs(holder):
                raise Busy(_refusal(holder, shown_as))
            if _is_still(descriptor, path):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _lock(descriptor: int) -> bool:
    """False when another process has it; a file system without locks leaves it to the file's content."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def _is_still(descriptor: int, path: Path) -> bool:
    """Whether the file was not removed by its last holder between opening and locking it."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _self() -> dict[str, str | int]:
    return {"pid": os.getpid(), "started": scratch.started(os.getpid()), "host": platform.node()}


def _holder(descriptor: int) -> dict[str, str | int]:
    """What the file says; empty when that is nothing that can be read."""
    try:
        content = json.loads(os.pread(descriptor, 4096, 0))
        return {"pid": int(content["pid"]), "started": str(content["started"]), "host": str(content["host"])}
    except (ValueError, KeyError, TypeError, RecursionError):
        return {}


def _runs(holder: dict[str, str | int]) -> bool:
    """Whether the process still runs on this machine; its number alone may have gone to another one since."""
    if holder.get("host") != platform.node():
        return False
    started = scratch.started(int(holder["pid"]))
    return started != "" and started == holder["started"]


def _refusal(holder: dict[str, str | int], shown_as: Path) -> str:
    who = f"process {holder['pid']} on {holder['host']}" if holder else "another process"
    return f"{shown_as} is in use by another run ({who}); wait until it has ended, or choose another folder with --out"
