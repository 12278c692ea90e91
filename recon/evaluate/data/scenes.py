"""Scenes with known truth, as a perfect start of the pipeline would give them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh

from datasets.photosets import Photoset
from nnproc.rays import look_at_cameras
from procmodels.shape import Shape
from recon.geometry.raster import silhouettes
from recon.geometry.umeyama import similarity_between
from recon.scene import Cameras, Canonical, Poses, Scene, Silhouettes, cam_from_canonical


@dataclass(frozen=True)
class Misaligned:
    """How far a result lies from the truth: degrees of up and of yaw, size as a share."""

    up: float
    yaw: float
    size: float


def read_mask(path: Path) -> np.ndarray:
    """(H, W) bool of a mask file, white = object."""
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 127


def true_scene(truth: Photoset) -> Scene:
    """The true masks and cameras of a rendered photo set."""
    cameras = Cameras(tuple(truth.names), truth.K, truth.cam_from_world, truth.sizes)
    lowest = float(trimesh.load_mesh(truth.mesh).bounds[0, 2])
    return posed_scene(cameras, [read_mask(p) for p in truth.masks], Canonical(truth.world_from_canonical), lowest)


def drawn_scene(shape: Shape, cameras: Cameras, canonical: Canonical) -> Scene:
    """Exact silhouettes of a shape that stands at `canonical`."""
    masks = silhouettes(shape, cameras.K, cam_from_canonical(cameras, canonical), cameras.sizes)
    return posed_scene(cameras, masks, canonical, float(shape.bounds()[0, 2]))


def orbit(views: int, seed: int = 0) -> tuple[Cameras, Canonical]:
    """Photos of 800 x 600 from all around at two heights, in a world frame turned, scaled and moved at random."""
    rng = np.random.default_rng(seed)
    azimuth = np.linspace(0, 360, views, endpoint=False) + rng.uniform(-5, 5, views)
    elevation = np.where(np.arange(views) % 2, 18, 40) + rng.uniform(-3, 3, views)
    K, poses = (t.numpy() for t in look_at_cameras(azimuth.tolist(), elevation.tolist(), 2.2, 40, 600))
    K[:, 0, 2] = 400
    scale = rng.uniform(0.5, 5)
    world_from_canonical = np.eye(4)
    world_from_canonical[:3, :3] = scale * cv2.Rodrigues(rng.normal(size=3))[0]
    world_from_canonical[:3, 3] = rng.normal(size=3)
    cam_from_world = poses @ np.linalg.inv(world_from_canonical)
    cam_from_world[:, :3] *= scale  # rigid again, in the world's units
    names = tuple(f"view_{i:02d}.jpg" for i in range(views))
    sizes = np.tile([800, 600], (views, 1))
    return Cameras(names, K, cam_from_world, sizes), Canonical(world_from_canonical)


def posed_scene(cameras: Cameras, masks: list[np.ndarray], canonical: Canonical, lowest: float) -> Scene:
    """Given masks as silhouettes of an object at `canonical`, with the floor below its `lowest` canonical height."""
    matrix, n = canonical.world_from_canonical, len(cameras)
    normal = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    foot = matrix[:3, :3] @ [0, 0, lowest] + matrix[:3, 3]
    floor = np.array([*normal, -normal @ foot])
    poses = Poses(cameras, tuple(Path(name) for name in cameras.names), np.zeros((0, 3)), np.zeros((0, n), bool))
    return Scene(poses, Silhouettes(cameras.names, tuple(masks), ("user",) * n, np.ones(n, bool), floor), canonical)


def misaligned(truth: Photoset, cameras: Cameras, canonical: Canonical) -> Misaligned:
    """A result's place compared with the truth, the frames brought together by the cameras' centres."""
    index = [truth.names.index(n) for n in cameras.names]
    true_cameras = Cameras(truth.names, truth.K, truth.cam_from_world, truth.sizes)
    truth_from_world = similarity_between(cameras.centres(), true_cameras.centres()[index])
    turn = np.linalg.inv(truth.world_from_canonical) @ truth_from_world @ canonical.world_from_canonical
    size = float(np.cbrt(np.linalg.det(turn[:3, :3])))
    rotation = turn[:3, :3] / size
    up = float(np.degrees(np.arccos(np.clip(rotation[2, 2], -1, 1))))
    return Misaligned(up, float(np.degrees(np.arctan2(rotation[1, 0], rotation[0, 0]))), abs(size - 1))
