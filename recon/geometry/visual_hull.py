"""The visual hull of the silhouettes at 64^3 in the canonical box, carved at the voxels' centres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from datasets.voxels import RESOLUTION, voxel_centres
from recon.geometry.object_windows import Crops, object_crops
from recon.scene import Canonical, ReconstructionError, Scene, cam_from_canonical


@dataclass(frozen=True)
class HullOptions:
    """How the hull is carved."""

    size: int = 96  # pixels along each side of a window; the canonical cube fills it
    agreement: float = 0.85  # share of the views that must find a voxel inside
    min_views: int = 3


@dataclass(frozen=True)
class Hull:
    """grid (64, 64, 64) bool: solid hull, axes x, y, z of the canonical frame."""

    grid: np.ndarray


def run(scene: Scene, options: HullOptions = HullOptions()) -> Hull:
    """Carve the canonical box. Raises ReconstructionError when nothing is left."""
    crops = object_crops(scene, options.size)
    grid = carved(crops, scene.canonical, options)
    if not grid.any():
        raise ReconstructionError("the silhouettes have no common inside; check them in the report or give --masks")
    return Hull(grid)


def carved(crops: Crops, canonical: Canonical, options: HullOptions) -> np.ndarray:
    """(64, 64, 64) bool: voxels that enough of the windows which show their centres find inside."""
    centres = voxel_centres().reshape(-1, 3).T
    inside, seen = np.zeros(centres.shape[1], np.int32), np.zeros(centres.shape[1], np.int32)
    P = crops.cameras.K @ cam_from_canonical(crops.cameras, canonical)[:, :3]
    for matrix, mask, valid in zip(P, crops.masks >= 0.5, crops.valid, strict=True):
        x, y, depth = matrix[:, :3] @ centres + matrix[:, 3:]
        side = len(mask)
        depth = np.where(depth > 1e-6, depth, np.nan)
        with np.errstate(invalid="ignore"):
            shown = np.flatnonzero((x >= 0) & (y >= 0) & (x < side * depth) & (y < side * depth))
        pixel = (y[shown] / depth[shown]).astype(int) * side + (x[shown] / depth[shown]).astype(int)
        shown, pixel = shown[valid.ravel()[pixel]], pixel[valid.ravel()[pixel]]
        seen[shown] += 1
        inside[shown] += mask.ravel()[pixel]
    enough = (inside >= options.agreement * seen - 1e-6) & (seen >= min(options.min_views, len(P)))
    return enough.reshape((RESOLUTION,) * 3)
