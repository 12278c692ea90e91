"""transforms.json as NeRF, instant-ngp and nerfstudio write it: cameras with OpenGL axes."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from recon.camera_records import CameraRecords, Lens, as_one_term, read_bytes, rigid
from recon.scene import InputError

log = logging.getLogger("recon.cameras")
_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
SizeOf = Callable[[str], tuple[int, int] | None]


def is_transforms(path: Path) -> bool:
    """Whether a file is JSON with a list of frames that have matrices."""
    try:
        content = json.loads(path.read_text()) if path.suffix.lower() == ".json" and path.is_file() else None
    except (OSError, ValueError, RecursionError):
        return False
    frames = content.get("frames") if isinstance(content, dict) else None
    return isinstance(frames, list) and any(isinstance(f, dict) and "transform_matrix" in f for f in frames)


def read(path: Path, size_of: SizeOf) -> CameraRecords:
    """The frames whose images are there, and those that are not: size 0 and K NaN when the file does not tell them.

    size_of  (width, height) of the image that a file_path names, None when it is missing
    Raises InputError naming the file, and the frame where there is one.
    """
    try:
        content = json.loads(read_bytes(path))
        frames = content["frames"]
        names = [str(f["file_path"]).replace("\\", "/") for f in frames]
        unique = sorted({n: i for i, n in reversed(list(enumerate(names)))}.values())
        rows = [_frame(path, {**content, **frames[i]}, names[i], size_of(names[i])) for i in unique]
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise InputError(
            f"{path} is not a transforms.json: frames with file_path and transform_matrix, and fl_x or camera_angle_x "
            f"are needed ({type(error).__name__}: {error})"
        ) from error
    masks = [path.parent / str(m).replace("\\", "/") if (m := frames[i].get("mask_path")) else None for i in unique]
    points = _points(path, content)
    sizes, lenses, poses = zip(*rows, strict=True) if rows else ((), (), ())
    return CameraRecords(
        tuple(names[i] for i in unique),
        np.array(sizes, int).reshape(-1, 2),
        np.array([one.K for one in lenses]).reshape(-1, 3, 3),
        np.array([one.k1 for one in lenses], float),
        np.array([one.left_over for one in lenses], float),
        np.array(poses).reshape(-1, 4, 4),
        points,
        np.zeros((len(points), len(unique)), bool),
        tuple(masks) if any(masks) else (),
    )


def _frame(
    path: Path, values: dict[str, Any], name: str, image: tuple[int, int] | None
) -> tuple[tuple[int, int], Lens, np.ndarray]:
    """Size, lens and cam_from_world of one frame; `values` are the shared ones overlaid with its own."""
    if "FISHEYE" in str(values.get("camera_model", "")) or values.get("is_fisheye"):
        raise InputError(f"{path}: fisheye lenses are not supported; undistort the photos first")
    what = f"{path}, frame {name}"
    world_from_camera = rigid(np.array(values["transform_matrix"], float).reshape(-1, 4), what)
    cam_from_world = np.linalg.inv(world_from_camera @ _OPENCV_FROM_OPENGL)
    size = (int(values["w"]), int(values["h"])) if {"w", "h"} <= values.keys() else image
    if size is None:
        return (0, 0), Lens(np.full((3, 3), np.nan), 0.0, 0.0), cam_from_world
    if min(size) < 1:
        raise InputError(f"{what}: its size is {size[0]} x {size[1]}")
    fx = _focal(values, "x", size[0])
    fy = _focal(values, "y", size[1])
    if not (fx or fy):
        raise InputError(f"{what}: neither fl_x nor camera_angle_x is given, so the focal length is unknown")
    fx, fy = fx or fy, fy or fx
    if not all(math.isfinite(f) and f > 0 for f in (fx, fy)):
        raise InputError(f"{what}: the focal length {fx:g}, {fy:g} is not usable")
    cx, cy = float(values.get("cx", size[0] / 2)), float(values.get("cy", size[1] / 2))
    terms = np.array([float(values.get(k) or 0) for k in ("k1", "k2", "p1", "p2", "k3")])
    if not np.isfinite([cx, cy, *terms]).all():
        raise InputError(f"{what}: its principal point or distortion is not a number")
    # k4 is a fisheye term here; OPENCV cameras have none.
    return size, as_one_term(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), terms, size), cam_from_world


def _focal(values: dict[str, Any], axis: str, side: int) -> float:
    """Pixels, from fl_x or camera_angle_x; 0 when neither is there."""
    if values.get(f"fl_{axis}") is not None:
        return float(values[f"fl_{axis}"])
    angle = values.get(f"camera_angle_{axis}")
    return 0.0 if angle is None else 0.5 * side / math.tan(0.5 * float(angle))


def points_file(path: Path) -> Path | None:
    """The sparse points that nerfstudio puts beside the cameras."""
    try:
        name = json.loads(path.read_text()).get("ply_file_path")
    except (OSError, ValueError, AttributeError, RecursionError):
        return None
    beside = path.parent / str(name)
    return beside if name and beside.is_file() else None


def _points(path: Path, content: dict[str, Any]) -> np.ndarray:
    """(n, 3) float, empty when there are none or they cannot be read."""
    file = points_file(path)
    if file is None:
        return np.zeros((0, 3))
    try:
        loaded: Any = trimesh.load(file, process=False)
        points = np.asarray(loaded.vertices, dtype=np.float64).reshape(-1, 3)
    except Exception as error:  # readers of damaged meshes fail in many ways, and the points are not needed
        log.warning("the points in %s cannot be read (%s) and are not used", file, error)
        return np.zeros((0, 3))
    return points[np.isfinite(points).all(1)]
