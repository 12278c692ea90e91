"""Formats that Blender imports: USD, FBX, Alembic and its own; a process of their own reads them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from recon.files.head import Head
from recon.files.shape import Surface
from recon.scene import InputError

SECONDS = 300  # after which an importer is given up
_USD = (".usd", ".usda", ".usdc")


def is_usd(head: Head) -> bool:
    """Whether it is USD: binary, text, or in an archive."""
    return (
        head.start[:8] == b"PXR-USDC"
        or head.start.lstrip()[:5] == b"#usda"
        or (head.members[:1] != () and head.members[0].lower().endswith(_USD))
    )


def is_fbx(head: Head) -> bool:
    return head.start[:18] == b"Kaydara FBX Binary" or bool(re.match(rb"\s*;\s*FBX \d", head.start))


def is_alembic(head: Head) -> bool:
    return head.start[:5] == b"Ogawa"


def is_blend(head: Head) -> bool:
    """Whether it is Blender's own, which may be packed with zstd or gzip: then the ending decides among such files."""
    packed = head.start[:4] == b"\x28\xb5\x2f\xfd" or head.start[:2] == b"\x1f\x8b"
    return head.start[:7] == b"BLENDER" or (packed and head.path.suffix.lower() == ".blend")


def read(importer: str, endings: tuple[str, ...]) -> Callable[[Path], Surface]:
    """A reader by one of recon.files.blender_import's importers, which wants one of these endings of a file's name."""

    def surface(path: Path) -> Surface:
        with tempfile.TemporaryDirectory() as folder:
            file = path.resolve()
            if path.suffix.lower() not in endings:
                file = Path(folder) / f"shape{_ending(path, endings)}"
                file.symlink_to(path.resolve())
            out = Path(folder) / "triangles.npz"
            _run(path, [str(file), importer, str(out)])
            with np.load(out, allow_pickle=False) as found:
                vertices, triangles = found["vertices"], found["triangles"]
        if not len(triangles):
            raise InputError(f"{path} holds no visible mesh that Blender can import; export the mesh as GLB")
        return Surface(vertices, triangles)

    return surface


def _ending(path: Path, endings: tuple[str, ...]) -> str:
    """The ending that goes with a file's first bytes."""
    with path.open("rb") as file:
        return {b"PK": ".usdz", b"PX": ".usdc"}.get(file.read(2), endings[0])


def _run(path: Path, arguments: list[str]) -> None:
    """Raises InputError when Blender fails."""
    try:
        done = subprocess.run(
            [sys.executable, "-m", "recon.files.blender_import", *arguments],
            cwd=Path(__file__).resolve().parents[2],  # where this package is found, installed or not
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            timeout=SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise InputError(
            f"{path} kept Blender's importer busy for {SECONDS} s; decimate it, or export it as GLB"
        ) from error
    if done.returncode:
        last = (done.stderr.decode("utf-8", "replace").strip().splitlines() or ["it crashed"])[-1]
        last = last.removesuffix(", see console for detail")
        raise InputError(f"{path} cannot be imported by Blender ({last[:200]}); export the mesh as GLB")
