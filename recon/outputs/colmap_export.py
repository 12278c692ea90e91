"""COLMAP's sparse model as text: cameras, images with their 2D points, points with their tracks, and these as a PLY.

In the world frame (SfM units, right-handed, no preferred up): cam_from_world, OpenCV axes, PINHOLE, pixel centres at
+0.5. A folder `sparse/0` with it beside a folder `images` is what trainers of Gaussian splats open.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from recon.scene import Cameras, Observations, Poses

POINTS = "points3D.ply"  # in the folder of the model
_GREY = 128  # colour of points that no photo shows
_VERTEX = np.dtype([("place", "<f4", 3), ("normal", "<f4", 3), ("colour", "u1", 3)])


def write(folder: Path, poses: Poses, names: list[str]) -> None:
    """Write cameras.txt, images.txt, points3D.txt and, where there are points, points3D.ply into `folder` (made here).

    names  V file names of the undistorted photos
    """
    folder.mkdir(parents=True)
    seen = observations(poses)
    colours = _point_colours(poses)
    _write_lines(folder / "cameras.txt", _camera_lines(poses.cameras))
    _write_lines(folder / "images.txt", _image_lines(poses.cameras, seen, names))
    _write_lines(folder / "points3D.txt", _point_lines(poses, seen, colours))
    if len(poses.points):
        _write_ply(folder / POINTS, poses.points, colours)


def observations(poses: Poses) -> Observations:
    """Where the points were measured, by view; without measurements (cameras that were given) where they project to."""
    if poses.observations is not None:
        order = np.lexsort((poses.observations.point, poses.observations.view))
        return poses.observations.subset(order)
    view, point = np.nonzero(poses.tracks.T)
    pixels = _projected(poses, view, point)
    ahead = np.isfinite(pixels).all(1)
    return Observations(view[ahead], point[ahead], pixels[ahead])


def _projected(poses: Poses, view: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(m, 2) pixels of points in views; NaN behind the camera."""
    pose = poses.cameras.cam_from_world[view]
    local = np.einsum("mij,mj->mi", pose[:, :3, :3], poses.points[point]) + pose[:, :3, 3]
    local[local[:, 2] <= 0] = np.nan
    pixels = np.einsum("mij,mj->mi", poses.cameras.K[view], local)
    return pixels[:, :2] / pixels[:, 2:]


def _camera_lines(cameras: Cameras) -> list[str]:
    lines = ["# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY: undistorted, pixel centres at +0.5"]
    return lines + [f"{i + 1} {camera}" for i, camera in enumerate(dict.fromkeys(_pinholes(cameras)))]


def _pinholes(cameras: Cameras) -> list[str]:
    """Every view's camera; equal ones are one camera."""
    return [
        f"PINHOLE {width} {height} " + _numbers([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
        for K, (width, height) in zip(cameras.K, cameras.sizes, strict=True)
    ]


def _image_lines(cameras: Cameras, seen: Observations, names: list[str]) -> list[str]:
    pinholes = _pinholes(cameras)
    number = {camera: i + 1 for i, camera in enumerate(dict.fromkeys(pinholes))}
    lines = [
        "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME: cam_from_world, OpenCV axes, SfM units; then X Y POINT3D_ID"
    ]
    for i, name in enumerate(names):
        x, y, z, w = Rotation.from_matrix(cameras.cam_from_world[i, :3, :3]).as_quat()
        pose = _numbers([w, x, y, z, *cameras.cam_from_world[i, :3, 3]])
        mine = seen.view == i
        measured = zip(seen.pixels[mine], seen.point[mine], strict=True)
        lines.append(f"{i + 1} {pose} {number[pinholes[i]]} {name}")
        lines.append(" ".join(f"{u:.3f} {v:.3f} {p + 1}" for (u, v), p in measured))
    return lines


def _point_lines(poses: Poses, seen: Observations, colours: np.ndarray) -> list[str]:
    """Points with their colour, mean error in px, and track: pairs of the image and the place in its line."""
    error = np.linalg.norm(_projected(poses, seen.view, seen.point) - seen.pixels, axis=1)
    starts = np.searchsorted(seen.view, np.arange(len(poses.cameras)))
    tracks: list[list[str]] = [[] for _ in poses.points]
    errors: list[list[float]] = [[] for _ in poses.points]
    for k, (view, point) in enumerate(zip(seen.view, seen.point, strict=True)):
        tracks[point].append(f"{view + 1} {k - starts[view]}")
        errors[point].append(error[k])
    lines = ["# POINT3D_ID X Y Z R G B ERROR TRACK[] as (IMAGE_ID, POINT2D_IDX): world frame, SfM units"]
    for i, (place, (r, g, b)) in enumerate(zip(poses.points, colours, strict=True)):
        mean = float(np.nan_to_num(np.mean(errors[i]))) if errors[i] else 0.0
        lines.append(f"{i + 1} {_numbers(place)} {r} {g} {b} {mean:.4f} {' '.join(tracks[i])}".rstrip())
    return lines


def _point_colours(poses: Poses) -> np.ndarray:
    """(n, 3) uint8 RGB of the sparse points, each from the first photo that saw it."""
    colours = np.full((len(poses.points), 3), _GREY, np.uint8)
    first = np.where(poses.tracks.any(1), poses.tracks.argmax(1), -1)
    for view in range(len(poses.cameras)):
        mine = np.flatnonzero(first == view)
        image = cv2.imread(str(poses.paths[view])) if len(mine) else None
        if image is None:
            continue
        pixels = np.nan_to_num(_projected(poses, np.full(len(mine), view), mine))
        columns, rows = np.floor(pixels).astype(int).T
        limits = image.shape[1] - 1, image.shape[0] - 1
        colours[mine] = image[np.clip(rows, 0, limits[1]), np.clip(columns, 0, limits[0]), ::-1]
    return colours


def _write_ply(path: Path, points: np.ndarray, colours: np.ndarray) -> None:
    """The points with colours; with normals, which nobody knows here but trainers ask for (all zero)."""
    records = np.zeros(len(points), _VERTEX)
    records["place"], records["colour"] = points, colours
    names = [f"float {n}" for n in ("x", "y", "z", "nx", "ny", "nz")] + [f"uchar {n}" for n in ("red", "green", "blue")]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    head += [*(f"property {n}" for n in names), "end_header"]
    path.write_bytes("\n".join([*head, ""]).encode() + records.tobytes())


def _write_lines(path: Path, lines: list[str]) -> None:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _numbers(values: list[float] | np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in values)  # repr keeps every digit
