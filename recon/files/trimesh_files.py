"""Formats that trimesh reads well: OFF, COLLADA (.dae) and 3MF."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from pathlib import Path

from datasets.mesh_reader import scene_triangles
from recon.files.head import Head
from recon.files.shape import Kind, Recognised, Surface
from recon.scene import InputError
from recon.system import limits


def is_off(head: Head) -> bool:
    return head.text is not None and bool(re.match(r"\s*(#[^\n]*\n\s*)*(ST)?C?N?(OFF)\b", head.text))


def is_dae(head: Head) -> bool:
    return head.text is not None and "<COLLADA" in head.text


def is_3mf(head: Head) -> bool:
    return any(name.lower().endswith(".model") and name.lower().lstrip("/").startswith("3d/") for name in head.members)


def describe(name: str) -> Callable[[Path], Recognised]:
    """Of a format that must be read whole to be counted."""

    def described(path: Path) -> Recognised:
        if _unpacked(path) > limits.SCENE:
            raise InputError(
                f"{path} is larger than the {limits.SCENE >> 20} MB that are read of {name}; save it as binary PLY"
            )
        return Recognised(Kind.MESH, f"a mesh ({name})")

    return described


def _unpacked(path: Path) -> int:
    """Bytes of a file, or of all that an archive says it holds."""
    if not zipfile.is_zipfile(path):
        return path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        return sum(member.file_size for member in archive.infolist())


def read(file_type: str) -> Callable[[Path], Surface]:
    """All triangles of the scene; file_type as trimesh calls it."""

    def surface(path: Path) -> Surface:
        with path.open("rb") as file:  # without its name no texture or other file is looked for
            return Surface(*scene_triangles(file, file_type))

    return surface
