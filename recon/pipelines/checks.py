"""What every command checks before minutes are spent: the class, Blender, the height, a folder that can be written."""

from __future__ import annotations

import tempfile
from pathlib import Path

from procmodels import Model, ModelError, load, names
from procmodels.blender import BlenderMissing, require
from recon.scene import InputError

AUTO = "auto"  # a class name: try every class


def models(class_name: str) -> list[Model]:
    """The model of that name, or all for "auto". Raises InputError, also when Blender's module cannot be used."""
    try:
        require("bpy")
        return [load(name) for name in (names() if class_name == AUTO else [class_name])]
    except (ModelError, BlenderMissing) as error:
        raise InputError(str(error)) from error


def check(height: float | None, out: Path) -> None:
    """Raise InputError for a senseless height (metres) or an output folder that cannot be written; makes nothing."""
    if height is not None and not 0.01 <= height <= 100:
        raise InputError(f"--height is in metres, from 0.01 to 100; got {height:g}")
    there = next(p for p in (out.absolute(), *out.absolute().parents) if p.exists())
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise InputError(
            f"the output folder {out} cannot be written ({error.strerror}); choose another with --out"
        ) from error
