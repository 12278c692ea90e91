"""Polycam's raw data: keyframes/ with a JSON a picture in corrected_cameras/ (or cameras/, before its own adjustment).

t_00 ... t_23 are the rows of world_from_camera with ARKit's axes, which are OpenGL's (x right, y up, z backward), for
the picture as it is stored. The pictures in corrected_images/ are undistorted.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recon.files.camera_records import CameraRecords, from_rows, read_json, rigid
from recon.files.transforms_json import OPENCV_FROM_OPENGL
from recon.geometry.lenses import lens
from recon.scene import InputError

_PAIRS = (("corrected_cameras", "corrected_images"), ("cameras", "images"))


def matches(path: Path) -> bool:
    """Whether a folder is the keyframes folder of a capture."""
    return path.is_dir() and any((path / p).is_dir() for _, p in _PAIRS) and bool(files(path))


def files(path: Path) -> list[Path]:
    """The cameras' files, of the adjusted cameras where there are any."""
    for cameras, pictures in _PAIRS:
        if (path / pictures).is_dir() and (found := sorted(p for p in (path / cameras).glob("*.json") if _own(p))):
            return found
    return []


def _own(path: Path) -> bool:
    return path.is_file() and not path.name.startswith(".")


def read(path: Path) -> CameraRecords:
    """All cameras of the folder. Raises InputError naming the file that is damaged."""
    rows = []
    pictures = dict(_PAIRS)
    for file in files(path):
        try:
            entry = read_json(file)
            size = (int(entry["width"]), int(entry["height"]))
            pinhole = np.array([entry[k] for k in ("fx", "fy", "cx", "cy")], float)
            placed = np.array([[entry[f"t_{i}{j}"] for j in range(4)] for i in range(3)], float)
            cam_from_world = np.linalg.inv(rigid(placed, str(file)) @ OPENCV_FROM_OPENGL)
            name = f"{pictures[file.parent.name]}/{file.stem}.jpg"
            rows.append((name, size, *lens("PINHOLE", pinhole, size), cam_from_world))
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            raise InputError(f"{file} is no camera of Polycam's ({type(error).__name__}: {error})") from error
    return from_rows(rows)
