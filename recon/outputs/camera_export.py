"""The cameras for other programs: COLMAP's text model and nerfstudio's transforms.json, with the images they belong to.

Both are in the world frame (SfM units, right-handed, no preferred up). COLMAP: cam_from_world, OpenCV axes, PINHOLE.
transforms.json: world_from_camera with OpenGL axes (x right, y up, z backward). Pixel centres are at +0.5 in both.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from recon.scene import Cameras, Poses
from recon.system.names import plain, unique

_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
_ENDING = ".png"  # stands for that of the images and masks, so that numbers come before it
_GREY = 128  # colour of points that no photo shows


def stems(names: tuple[str, ...]) -> list[str]:
    """Different file names without suffix for photos: a photo's own stem, or its whole name where two are equal."""
    own = [plain(Path(name).stem) for name in names]
    counts = Counter(own)
    wanted = [o if counts[o] == 1 else plain(n) for o, n in zip(own, names, strict=True)]
    return [name.removesuffix(_ENDING) for name in unique(w + _ENDING for w in wanted)]


def write(folder: Path, poses: Poses) -> None:
    """Write cameras.txt, images.txt, points3D.txt, transforms.json and images/ into `folder` (made here)."""
    images = folder / "images"
    images.mkdir(parents=True)
    names = [f"{stem}{path.suffix}" for stem, path in zip(stems(poses.cameras.names), poses.paths, strict=True)]
    for name, path in zip(names, poses.paths, strict=True):
        shutil.copyfile(path, images / name)
    _write_colmap(folder, poses, names)
    masks = [f"../masks/{stem}.png" for stem in stems(poses.cameras.names)]
    content = transforms(poses.cameras, [f"images/{name}" for name in names], masks)
    (folder / "transforms.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def transforms(cameras: Cameras, file_paths: list[str], mask_paths: list[str]) -> dict[str, Any]:
    """What nerfstudio's transforms.json holds; intrinsics once when all views share them, otherwise in every frame."""
    intrinsics = [_intrinsics(K, size) for K, size in zip(cameras.K, cameras.sizes, strict=True)]
    shared = intrinsics[0] if all(i == intrinsics[0] for i in intrinsics) else {}
    frames = []
    for i, (file, mask) in enumerate(zip(file_paths, mask_paths, strict=True)):
        world_from_camera = np.linalg.inv(cameras.cam_from_world[i]) @ _OPENCV_FROM_OPENGL
        frame = {"file_path": file, "mask_path": mask, "transform_matrix": world_from_camera.tolist()}
        frames.append(frame | ({} if shared else intrinsics[i]))
    return {
        "frame": "world: right-handed, SfM units, no preferred up; transform_matrix is world_from_camera, OpenGL axes",
        "camera_model": "OPENCV",
        **shared,
        "frames": frames,
    }


def _intrinsics(K: np.ndarray, size: np.ndarray) -> dict[str, float]:
    values = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "k1": 0, "k2": 0, "p1": 0, "p2": 0}
    return {k: float(v) for k, v in values.items()} | {"w": int(size[0]), "h": int(size[1])}


def _write_colmap(folder: Path, poses: Poses, names: list[str]) -> None:
    """cameras.txt, images.txt (without 2D points) and points3D.txt (without tracks)."""
    cameras = poses.cameras
    numbers: dict[str, int] = {}
    images = [
        "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME: cam_from_world, OpenCV axes, SfM units; empty: 2D points"
    ]
    for i, name in enumerate(names):
        K, (width, height) = cameras.K[i], cameras.sizes[i]
        camera = f"PINHOLE {width} {height} " + _numbers([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
        number = numbers.setdefault(camera, len(numbers) + 1)
        x, y, z, w = Rotation.from_matrix(cameras.cam_from_world[i, :3, :3]).as_quat()
        pose = _numbers([w, x, y, z, *cameras.cam_from_world[i, :3, 3]])
        images += [f"{i + 1} {pose} {number} {name}", ""]
    (folder / "images.txt").write_text("\n".join(images) + "\n", encoding="utf-8")
    lines = ["# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY: undistorted, pixel centres at +0.5"]
    lines += [f"{number} {camera}" for camera, number in numbers.items()]
    (folder / "cameras.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    lines = ["# POINT3D_ID X Y Z R G B ERROR TRACK[]: world frame, SfM units; tracks are left out"]
    for i, (point, colour) in enumerate(zip(poses.points, _point_colours(poses), strict=True)):
        lines.append(f"{i + 1} {_numbers(point)} {colour[0]} {colour[1]} {colour[2]} 0")
    (folder / "points3D.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _point_colours(poses: Poses) -> np.ndarray:
    """(n, 3) uint8 RGB of the sparse points, each from the first photo that saw it."""
    colours = np.full((len(poses.points), 3), _GREY, np.uint8)
    first = np.where(poses.tracks.any(1), poses.tracks.argmax(1), -1)
    for view in range(len(poses.cameras)):
        mine = np.flatnonzero(first == view)
        image = cv2.imread(str(poses.paths[view])) if len(mine) else None
        if image is None:
            continue
        pose, K = poses.cameras.cam_from_world[view], poses.cameras.K[view]
        pixels = (poses.points[mine] @ pose[:3, :3].T + pose[:3, 3]) @ K.T
        columns, rows = np.floor(pixels[:, :2] / pixels[:, 2:]).astype(int).T
        limits = image.shape[1] - 1, image.shape[0] - 1
        colours[mine] = image[np.clip(rows, 0, limits[1]), np.clip(columns, 0, limits[0]), ::-1]
    return colours


def _numbers(values: list[float] | np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in values)  # repr keeps every digit
