"""The visual hull of the silhouettes at 64^3 in the canonical box, carved with the renderer's own rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from nnproc.ray_operator import RayOperator, ray_operator, visual_hull
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
    operator = crop_operator(crops, scene.canonical)
    min_views = min(options.min_views, len(crops.cameras))
    grid = visual_hull(operator, torch.from_numpy(crops.masks), options.agreement, min_views).numpy()
    if not grid.any():
        raise ReconstructionError("the silhouettes have no common inside; check them in the report or give --masks")
    return Hull(grid)


def crop_operator(crops: Crops, canonical: Canonical) -> RayOperator:
    """The sparse ray operator of the windows' pixels that lie in the photos."""
    size = crops.masks.shape[1]
    return ray_operator(
        torch.from_numpy(crops.cameras.K),
        torch.from_numpy(cam_from_canonical(crops.cameras, canonical)),
        size,
        size,
        pixels=torch.from_numpy(crops.valid),
    )
