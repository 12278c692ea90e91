"""Patrick Min's binvox grids: runs of (value, length), y running fastest, then z, then x."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recon.files.head import Head
from recon.files.shape import Grid, Kind, Recognised
from recon.files.voxels import thinned
from recon.scene import InputError
from recon.system import limits


def is_binvox(head: Head) -> bool:
    return head.start[:7] == b"#binvox"


def describe(path: Path) -> Recognised:
    """Raises InputError for sizes that no grid has."""
    size, _ = _header(path)
    return Recognised(Kind.VOXELS, f"a voxel grid of {' x '.join(map(str, size))} (binvox)")


def read(path: Path) -> Grid:
    """Raises InputError when it is cut short."""
    size, offset = _header(path)
    with path.open("rb") as file:
        file.seek(offset)
        data = file.read(limits.TEXT)
    runs = np.frombuffer(data[: len(data) // 2 * 2], np.uint8).reshape(-1, 2)
    total = int(runs[:, 1].sum(dtype=np.int64))
    if total != int(np.prod(size)):
        raise InputError(f"{path} is a binvox file cut short: {total:,} voxels, its header promises {size}")
    flat = np.repeat(runs[:, 0] > 0, runs[:, 1])
    return Grid(thinned(flat.reshape(size[0], size[2], size[1]).transpose(0, 2, 1)))


def _header(path: Path) -> tuple[tuple[int, ...], int]:
    """The grid's size along x, y and z, and where its runs begin."""
    with path.open("rb") as file:
        head, found, _ = file.read(1 << 12).partition(b"data\n")
    try:
        words = [line.split() for line in head.decode("ascii").splitlines()]
        size = next(tuple(int(x) for x in w[1:4]) for w in words if w[:1] == ["dim"])
    except (UnicodeDecodeError, ValueError, StopIteration) as error:
        raise InputError(f"{path} is a damaged binvox file: no readable dimensions") from error
    if not found or len(size) != 3 or min(size) < 1 or max(size) > 1024:
        raise InputError(f"{path}: a binvox grid has three sides of 1 to 1024 voxels, its header says {size}")
    return size, len(head) + len(found)
