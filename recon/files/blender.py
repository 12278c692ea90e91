"""Formats that Blender imports: USD, FBX, Alembic and its own; a process of their own reads them."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable
from pathlib import Path

from recon.files.child import arrays_of
from recon.files.head import Head
from recon.files.shape import Surface
from recon.scene import InputError
from recon.system import limits

_USD = (".usd", ".usda", ".usdc")


def is_usd(head: Head) -> bool:
    """Whether it is USD: binary, text, or in an archive."""
    bare = head.start[:8] == b"PXR-USDC" or head.start.lstrip()[:5] == b"#usda"
    return bare or any(name.lower().endswith(_USD) for name in head.members[:1])


def is_fbx(head: Head) -> bool:
    return head.start[:18] == b"Kaydara FBX Binary" or bool(re.match(rb"\s*;\s*FBX \d", head.start))


def is_alembic(head: Head) -> bool:
    return head.start[:5] == b"Ogawa"


def is_blend(head: Head) -> bool:
    """Whether it is Blender's own, which may be packed with zstd or gzip: then the ending decides among such files."""
    packed = head.start[:4] == b"\x28\xb5\x2f\xfd" or head.start[:2] == b"\x1f\x8b"
    return head.start[:7] == b"BLENDER" or (packed and head.path.suffix.lower() == ".blend")


def read(importer: str, endings: tuple[str, ...]) -> Callable[[Path], Surface]:
    """A reader by one of procmodels.blender_import's importers, which wants one of these endings of a file's name."""

    def surface(path: Path) -> Surface:
        _checked_links(path)
        with tempfile.TemporaryDirectory() as folder:
            file = path.absolute()
            if path.suffix.lower() not in endings:
                file = Path(folder) / f"shape{_ending(path, endings)}"
                file.symlink_to(path.absolute())
            found = arrays_of(
                path, "procmodels.blender_import", str(file), importer, advice="export the mesh as GLB or OBJ"
            )
        if not len(found["triangles"]):
            raise InputError(f"{path} holds no visible mesh that Blender can import; export the mesh as GLB or OBJ")
        return Surface(found["vertices"], found["triangles"])

    return surface


def _checked_links(path: Path) -> None:
    """Raises InputError when USD in text draws on files outside its folder."""
    with path.open("rb") as file:
        if file.read(5) != b"#usda":
            return
        text = file.read(limits.SCENE).decode("utf-8", "replace")
    folder = Path(os.path.abspath(path.parent))
    for link in re.findall(r"@([^@\n]+\.usd[acz]?)@", text):
        if "://" in link or not Path(os.path.normpath(folder / link)).is_relative_to(folder):
            raise InputError(
                f"{path} names {link}, which lies outside its folder and is not followed; put it beside it"
            )


def _ending(path: Path, endings: tuple[str, ...]) -> str:
    """The ending that goes with a file's first bytes."""
    with path.open("rb") as file:
        return {b"PK": ".usdz", b"PX": ".usdc"}.get(file.read(2), endings[0])
