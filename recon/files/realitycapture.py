"""RealityCapture's (RealityScan's) CSV of internal and external camera parameters.

Columns: #name, x, y, alt, heading, pitch, roll (degrees), f, px, py (as on 36 mm film, from the picture's middle), k1
to k4 (Brown's), t1, t2. World: x east, y north, z up. At heading, pitch and roll 0 the camera looks straight down with
north at the top; it is rolled about its own y axis first, then pitched about x, then turned clockwise by its heading.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from recon.files.camera_records import CameraRecords, SizeOf, from_rows
from recon.files.transforms_json import OPENCV_FROM_OPENGL
from recon.geometry.lenses import lens
from recon.scene import InputError
from recon.system.user_files import read_bytes

_FILM = 36.0  # mm, of the picture's longer side
_NEEDED = {"x", "y", "alt", "heading", "pitch", "roll", "f"}


def matches(path: Path) -> bool:
    """Whether a file's first line has the columns' names."""
    if path.suffix.lower() not in (".csv", ".txt") or not path.is_file():
        return False
    with path.open("rb") as file:
        return set(_heading(file.readline(4096).decode("utf-8-sig", "replace"))) > _NEEDED


def _heading(line: str) -> list[str]:
    """The columns' names, the first of them "name"."""
    return [word.strip().lstrip("#").lower() for word in line.split(",")]


def read(path: Path, size_of: SizeOf) -> CameraRecords:
    """All cameras of the file; size 0 and K NaN where the image is missing, whose size the file does not tell.

    Raises InputError naming the file and the camera.
    """
    rows, what = [], str(path)
    try:
        lines = read_bytes(path).decode("utf-8-sig").splitlines()
        for values in csv.DictReader(io.StringIO("\n".join(lines[1:])), _heading(lines[0])):
            name = values["name"].strip()
            what = f"{path}, camera of {name}"
            rows.append((name, *_camera(values, size_of(name), what)))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, csv.Error) as error:
        raise InputError(f"{what} is damaged ({type(error).__name__}: {error})") from error
    return from_rows(rows)


def _camera(values: dict[str, str], size: tuple[int, int] | None, what: str) -> tuple:
    """Size, K, lens and cam_from_world."""
    numbers = {k: float(v or 0) for k, v in values.items() if k not in ("name", None)}
    if not np.isfinite(list(numbers.values())).all():
        raise InputError(f"{what}: a value is not a number")
    turned = Rotation.from_euler("ZXY", [-numbers["heading"], numbers["pitch"], numbers["roll"]], degrees=True)
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3], world_from_camera[:3, 3] = turned.as_matrix(), [numbers[k] for k in ("x", "y", "alt")]
    cam_from_world = np.linalg.inv(world_from_camera @ OPENCV_FROM_OPENGL)
    if size is None:
        return (0, 0), np.full((3, 3), np.nan), None, cam_from_world
    if numbers.get("k4"):
        raise InputError(
            f"{what}: its lens has a fourth radial term; export with Brown's lens of three, or undistorted"
        )
    unit = max(size) / _FILM
    middle = [side / 2 + numbers.get(k, 0) * unit for k, side in zip(("px", "py"), size, strict=True)]
    focal, terms = numbers["f"] * unit, [numbers.get(k, 0.0) for k in ("k1", "k2", "t1", "t2", "k3")]
    try:
        return size, *lens("FULL_OPENCV", np.array([focal, focal, *middle, *terms, 0, 0, 0]), size), cam_from_world
    except InputError as error:
        raise InputError(f"{what}: {error}") from error
