"""The cameras for other programs: a COLMAP model and nerfstudio's transforms.json, with the images they belong to.

Both are in the world frame (SfM units, right-handed, no preferred up), pixel centres at +0.5. COLMAP: see
recon.outputs.colmap_export. transforms.json: world_from_camera with OpenGL axes (x right, y up, z backward).
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from recon.outputs import colmap_export
from recon.scene import Cameras, Poses
from recon.system.names import plain, unique

_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
_ENDING = ".png"  # stands for that of the images and masks, so that numbers come before it
MODEL = "sparse/0"  # where programs look for COLMAP's model beside the folder of images


def stems(names: tuple[str, ...]) -> list[str]:
    """Different file names without suffix for photos: a photo's own stem, or its whole name where two are equal."""
    own = [plain(Path(name).stem) for name in names]
    counts = Counter(own)
    wanted = [o if counts[o] == 1 else plain(n) for o, n in zip(own, names, strict=True)]
    return [name.removesuffix(_ENDING) for name in unique(w + _ENDING for w in wanted)]


def write(folder: Path, poses: Poses) -> None:
    """Write sparse/0 (a COLMAP model), transforms.json and images/ into `folder` (made here)."""
    images = folder / "images"
    images.mkdir(parents=True)
    names = [f"{stem}{path.suffix}" for stem, path in zip(stems(poses.cameras.names), poses.paths, strict=True)]
    for name, path in zip(names, poses.paths, strict=True):
        shutil.copyfile(path, images / name)
    colmap_export.write(folder / MODEL, poses, names)
    masks = [f"../masks/{stem}.png" for stem in stems(poses.cameras.names)]
    content = transforms(poses.cameras, [f"images/{name}" for name in names], masks)
    if len(poses.points):
        content["ply_file_path"] = f"{MODEL}/{colmap_export.POINTS}"  # in the same frame as the cameras
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
