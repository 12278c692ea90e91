"""Silhouettes of any mesh, also of an open or ill-made one, by casting rays; and the cameras that look at it."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh

from nnproc.rays import look_at_cameras
from recon.evaluate.data.scenes import orbit, posed_scene
from recon.scene import Cameras, Canonical, Scene, cam_from_canonical

SIZE = (800, 600)  # px of rendered masks


def ray_masks(mesh: trimesh.Trimesh, cameras: Cameras, canonical: Canonical) -> list[np.ndarray]:
    """V arrays (H, W) bool: pixels whose centre sees the mesh, which is given in the canonical frame.

    Unlike recon.geometry.raster it needs no closed parts and no order of corners.
    """
    import open3d as o3d

    tensor: Any = o3d.core.Tensor
    scene: Any = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(mesh.vertices.astype(np.float32)), tensor(mesh.faces.astype(np.uint32)))
    masks = []
    for K, pose, (width, height) in zip(
        cameras.K, cam_from_canonical(cameras, canonical), cameras.sizes.tolist(), strict=True
    ):
        rays = scene.create_rays_pinhole(tensor(K), tensor(pose), width, height)
        masks.append(np.isfinite(scene.cast_rays(rays)["t_hit"].numpy()))
    return masks


def all_round(mesh: trimesh.Trimesh, views: int, seed: int) -> Scene:
    """Masks of 800 x 600 from all round at two heights, cameras known in a world frame turned and scaled at random."""
    cameras, place = orbit(views, seed)
    return posed_scene(cameras, ray_masks(mesh, cameras, place), place, float(mesh.bounds[0, 2]))


def one_view(mesh: trimesh.Trimesh, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """One mask as a person would take the photo: from the front or beside it, from a little above, whole in view.

    Returns the mask (600, 800) bool, K (3, 3), cam_from_canonical (4, 4) rigid, and the azimuth in degrees.
    """
    rng = np.random.default_rng(seed)
    azimuth = float(rng.uniform(-65, 65) % 360)
    K, pose = look_at_cameras([azimuth], [float(rng.uniform(8, 30))], float(rng.uniform(1.9, 2.8)), 40, SIZE[1])
    matrix, place = K.numpy(), pose.numpy()
    matrix[:, 0, 2] = SIZE[0] / 2
    camera = Cameras(("view.png",), matrix, place, np.array([SIZE]))
    return ray_masks(mesh, camera, Canonical(np.eye(4)))[0], matrix[0], place[0], azimuth
