"""Blender's Python module, when it is there and of a version that is known to work. Nothing else imports bpy."""

from __future__ import annotations

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
