"""transforms.json as NeRF, instant-ngp and nerfstudio write it: cameras with OpenGL axes."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Any

import numpy as np

from recon.files.camera_records import CameraRecords, SizeOf, read_json, rigid
from recon.geometry.lenses import LARGEST, lens
from recon.scene import InputError, Lens
from recon.system.folders import is_file, lies_in

log = logging.getLogger("recon.cameras")
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def is_transforms(path: Path) -> bool:
    """Whether a file is JSON with a list of frames that have matrices."""
    try:
        content = read_json(path) if path.suffix.lower() == ".json" and path.is_file() else None
    except (InputError, ValueError, RecursionError):
        return False
    frames = content.get("frames") if isinstance(content, dict) else None
    return isinstance(frames, list) and any(isinstance(f, dict) and "transform_matrix" in f for f in frames)


def read(path: Path, size_of: SizeOf) -> CameraRecords:
    """The frames whose images are there, and those that are not: size 0 and K NaN when the file does not tell them.

    size_of  (width, height) of the image that a file_path names, None when it is missing
    Raises InputError naming the file, and the frame where there is one.
    """
    try:
        content = read_json(path)
        frames = content["frames"]
        names = [str(f["file_path"]).replace("\\", "/") for f in frames]
        unique = sorted({n: i for i, n in reversed(list(enumerate(names)))}.values())
        rows = [_frame(path, {**content, **frames[i]}, names[i], size_of(names[i])) for i in unique]
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
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
        np.array([K for K, _ in lenses]).reshape(-1, 3, 3),
        tuple(bends for _, bends in lenses),
        np.array(poses).reshape(-1, 4, 4),
        points,
        np.zeros((len(points), len(unique)), bool),
        tuple(masks) if any(masks) else (),
    )


def _frame(
    path: Path, values: dict[str, Any], name: str, image: tuple[int, int] | None
) -> tuple[tuple[int, int], tuple[np.ndarray, Lens | None], np.ndarray]:
    """Size, lens and cam_from_world of one frame; `values` are the shared ones overlaid with its own."""
    what = f"{path}, frame {name}"
    world_from_camera = rigid(np.array(values["transform_matrix"], float).reshape(-1, 4), what)
    cam_from_world = np.linalg.inv(world_from_camera @ OPENCV_FROM_OPENGL)
    size = _size(values, what) if {"w", "h"} <= values.keys() else image
    if size is None:
        return (0, 0), (np.full((3, 3), np.nan), None), cam_from_world
    fx, fy = (_focal(values, axis, side, what) for axis, side in zip("xy", size, strict=True))
    if not (fx or fy):
        raise InputError(f"{what}: neither fl_x nor camera_angle_x is given, so the focal length is unknown")
    middle = [float(values.get(c, side / 2)) for c, side in zip(("cx", "cy"), size, strict=True)]
    try:
        return size, _lens(values, np.array([fx or fy, fy or fx, *middle]), size), cam_from_world
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def _size(values: dict[str, Any], what: str) -> tuple[int, int]:
    width, height = float(values["w"]), float(values["h"])
    if not (1 <= width <= LARGEST and 1 <= height <= LARGEST):
        raise InputError(f"{what}: its size is {width:g} x {height:g} (w, h), which is no picture's")
    return int(width), int(height)


def _lens(values: dict[str, Any], pinhole: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, Lens | None]:
    """K and the lens from fx, fy, cx, cy and the file's terms; raises InputError."""
    model, terms = str(values.get("camera_model", "OPENCV")).upper(), ()  # type: tuple[str, tuple[str, ...]]
    if "FISHEYE" in model or values.get("is_fisheye"):
        model, terms = "OPENCV_FISHEYE", ("k1", "k2", "k3", "k4")
    elif model not in ("EQUIRECTANGULAR", "ORTHOPHOTO"):  # k4 is a fisheye term here; OPENCV cameras have none
        model, terms = "FULL_OPENCV", ("k1", "k2", "p1", "p2", "k3", "-", "-", "-")
    return lens(model, np.array([*pinhole, *(float(values.get(k) or 0) for k in terms)]), size)


def _focal(values: dict[str, Any], axis: str, side: int, what: str) -> float:
    """Pixels, from fl_x or camera_angle_x; 0 when neither is there."""
    if values.get(f"fl_{axis}") is not None:
        return float(values[f"fl_{axis}"])
    if values.get(f"camera_angle_{axis}") is None:
        return 0.0
    angle = float(values[f"camera_angle_{axis}"])
    if not 0 < angle < math.pi:
        raise InputError(
            f"{what}: camera_angle_{axis} is {angle:g}; it is the angle of view in radians, between 0 and pi"
        )
    return 0.5 * side / math.tan(0.5 * angle)


def points_file(path: Path) -> Path | None:
    """The sparse points that nerfstudio puts beside the cameras."""
    try:
        name = read_json(path).get("ply_file_path")
    except (InputError, ValueError, AttributeError, RecursionError):
        return None
    beside = path.parent / str(name)
    return beside if name and lies_in(beside, path.parent) and is_file(beside) else None


def _points(path: Path, content: dict[str, Any]) -> np.ndarray:
    """(n, 3) float, empty when there are none or they cannot be read."""
    file = points_file(path)
    if file is None:
        return np.zeros((0, 3))
    import trimesh  # here, because it takes a while and few files have points

    try:
        loaded: Any = trimesh.load(file, process=False)
        points = np.asarray(loaded.vertices, dtype=np.float64).reshape(-1, 3)
    except Exception as error:  # readers of damaged meshes fail in many ways, and the points are not needed
        log.warning("the points in %s cannot be read (%s) and are not used", file, error)
        return np.zeros((0, 3))
    return points[np.isfinite(points).all(1)]
