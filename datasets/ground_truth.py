"""The ground truth of a photo set: cameras, the mesh, and masks ray-cast from it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from datasets import camera_rings
from datasets.staging import Plan, apply


def true_mask(
    vertices: np.ndarray,
    faces: np.ndarray,
    K: np.ndarray,
    cam_from_world: np.ndarray,
    size: tuple[int, int],
    sub: int = 4,
) -> np.ndarray:
    """(H, W) bool: the pixels of which the surface covers at least half, counted by sub x sub rays a pixel.

    vertices  (n, 3) float, world frame; all in front of the camera
    faces     (m, 3) int
    size      (width, height) in pixels
    """
    import open3d as o3d

    pixels, _ = camera_rings.project(vertices, K, cam_from_world)
    x0, y0 = np.clip(np.floor(pixels.min(0)).astype(int), 0, size)
    x1, y1 = np.clip(np.ceil(pixels.max(0)).astype(int), 0, size)
    mask = np.zeros((size[1], size[0]), bool)
    if x1 <= x0 or y1 <= y0:
        return mask
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    local = apply(cam_from_world, vertices).astype(np.float32)
    scene.add_triangles(o3d.core.Tensor.from_numpy(local), o3d.core.Tensor.from_numpy(faces.astype(np.uint32)))
    u = x0 + (np.arange((x1 - x0) * sub) + 0.5) / sub
    v = y0 + (np.arange((y1 - y0) * sub) + 0.5) / sub
    rays = np.zeros((len(v), len(u), 6), np.float32)
    rays[..., 3:] = np.stack([*np.meshgrid(u, v), np.ones((len(v), len(u)))], axis=-1) @ np.linalg.inv(K).T
    hit = scene.test_occlusions(o3d.core.Tensor.from_numpy(rays)).numpy()
    mask[y0:y1, x0:x1] = hit.reshape(y1 - y0, sub, x1 - x0, sub).mean(axis=(1, 3)) >= 0.5
    return mask


def write_truth(folder: Path, plan: Plan, size: tuple[int, int]) -> None:
    """Write mesh.ply, cameras.json and the masks that are not there yet."""
    trimesh.Trimesh(plan.vertices, plan.faces, process=False).export(folder / "mesh.ply", vertex_normal=False)
    width, height = size
    views = [
        {"name": n, "width": width, "height": height, "K": plan.K.tolist(), "cam_from_world": p.tolist()}
        for n, p in zip(plan.names, plan.cam_from_world, strict=True)
    ]
    cameras = {"world_from_canonical": plan.world_from_canonical.tolist(), "views": views}
    (folder / "cameras.json").write_text(json.dumps(cameras, indent=1) + "\n")
    in_world = apply(plan.world_from_canonical, plan.vertices)
    for photo, pose in zip(plan.names, plan.cam_from_world, strict=True):
        target = folder / "masks" / f"{Path(photo).stem}.png"
        if not target.is_file():
            partial = target.with_suffix(".tmp")
            Image.fromarray(true_mask(in_world, plan.faces, plan.K, pose, size)).save(partial, format="PNG")
            os.replace(partial, target)
