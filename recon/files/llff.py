"""poses_bounds.npy of LLFF and the NeRF sets after it: one row a picture, in the order of the pictures' names.

A row is a 3 x 5 matrix, row by row, and the nearest and farthest depth. Its columns: the camera's axes down, right and
backward in the world, its centre, and height, width and focal length in pixels. The principal point is the middle.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recon.files.arrays import arrays_in
from recon.files.camera_records import CameraRecords, from_rows, rigid
from recon.geometry.lenses import lens
from recon.scene import InputError


def matches(path: Path) -> bool:
    """Whether a file is an array of rows of 17 numbers whose matrices are rotations."""
    if path.suffix.lower() != ".npy" or not path.is_file():
        return False
    try:
        array, *others = arrays_in(path)  # the headers alone are read
        shape = array.shape
        if others or array.name or len(shape) != 2 or shape[1] != 17 or not 0 < shape[0] < 100_000:
            return False
        axes = _rows(path)[:, :, :3]
    except (InputError, OSError, ValueError, TypeError, EOFError):
        return False
    return bool(np.allclose(axes @ axes.transpose(0, 2, 1), np.eye(3), atol=2e-2))


def _rows(path: Path) -> np.ndarray:
    """(n, 3, 5) float."""
    return np.load(path, allow_pickle=False)[:, :15].astype(float).reshape(-1, 3, 5)


def read(path: Path, pictures: list[str]) -> CameraRecords:
    """The cameras of `pictures`, names in the rows' order. Raises InputError when there are not as many."""
    rows = _rows(path)
    if len(rows) != len(pictures):
        raise InputError(
            f"{path} has {len(rows)} cameras, which belong to the pictures in their names' order, but there are "
            f"{len(pictures)} pictures; give the folder that holds just these"
        )
    out = []
    for name, row in zip(sorted(pictures), rows, strict=True):
        what = f"{path}, camera of {name}"
        height, width, focal = row[:, 4]
        if not (np.isfinite(row).all() and width >= 1 and height >= 1):
            raise InputError(f"{what}: its size is {width:g} x {height:g}, or a value is not a number")
        down, right, backward, centre = row[:, :4].T
        placed = rigid(np.column_stack([right, down, -backward, centre]), what)
        size = (round(float(width)), round(float(height)))
        pinhole = np.array([focal, focal, width / 2, height / 2])
        out.append((name, size, *lens("PINHOLE", pinhole, size), np.linalg.inv(placed)))
    return from_rows(out)
