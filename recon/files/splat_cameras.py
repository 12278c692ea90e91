"""cameras.json, which the trainers of 3D Gaussian splats write beside the splat.

A list of {id, img_name, width, height, position, rotation, fx, fy}. `position` is the camera's centre and `rotation`
world_from_camera, OpenCV axes; the principal point is the middle. img_name often comes without ending.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recon.files.camera_records import CameraRecords, from_rows, read_json, rigid
from recon.geometry.lenses import lens
from recon.scene import InputError

_NEEDED = {"img_name", "width", "height", "position", "rotation", "fx", "fy"}


def matches(path: Path) -> bool:
    """Whether a file is JSON with a list of such cameras."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    try:
        content = read_json(path)
    except (InputError, ValueError, RecursionError):
        return False
    return isinstance(content, list) and bool(content) and isinstance(content[0], dict) and content[0].keys() >= _NEEDED


def read(path: Path) -> CameraRecords:
    """All cameras of the file. Raises InputError naming the file and the camera."""
    rows, what = [], str(path)
    try:
        for entry in read_json(path):
            name = str(entry["img_name"])
            what = f"{path}, camera of {name}"
            size = (int(entry["width"]), int(entry["height"]))
            pinhole = np.array([entry["fx"], entry["fy"], size[0] / 2, size[1] / 2], float)
            placed = np.column_stack([np.array(entry["rotation"], float), np.array(entry["position"], float)])
            rows.append((name, size, *lens("PINHOLE", pinhole, size), np.linalg.inv(rigid(placed, what))))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        raise InputError(f"{what} is damaged ({type(error).__name__}: {error})") from error
    return from_rows(rows)
