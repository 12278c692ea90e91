"""Blender's Python module, when it is there and of a version that is known to work. Nothing else imports bpy."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

SUPPORTED = ((5, 0), (5, 1))  # tested Blender versions: from, up to but excluding


class BlenderMissing(RuntimeError):
    """Blender's Python module cannot be used; the message says why and what to install."""


def require(name: str) -> Any:
    """bpy, bmesh or mathutils; raises BlenderMissing, with an explanation, when they cannot be loaded."""
    try:
        import bpy

        module: ModuleType = __import__(name)
    except ImportError as error:
        raise BlenderMissing(
            f"Blender's Python module cannot be loaded ({error}). "
            'If it is not installed: pip install "bpy==5.0.1" with Python 3.11 and numpy < 2. '
            "If a system library is missing, on Debian: apt-get install libxrender1 libxi6 libxxf86vm1 libxfixes3 "
            "libxkbcommon0 libsm6 libgl1"
        ) from error
    if not SUPPORTED[0] <= bpy.app.version[:2] < SUPPORTED[1]:
        raise BlenderMissing(f"Blender {bpy.app.version_string} found, {SUPPORTED[0]} to {SUPPORTED[1]} supported")
    return module


@contextmanager
def silenced() -> Iterator[None]:
    """Send Blender's own chatter on file descriptor 1 to nowhere (Python cannot intercept C's printf)."""
    sys.stdout.flush()
    saved = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(saved, 1)
        os.close(saved)
        os.close(nowhere)
