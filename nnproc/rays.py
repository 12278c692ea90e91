"""Cameras and rays in the canonical frame: pixel rays, and their exact path lengths through voxels.

Canonical frame (as in DESIGN.md): X right, the object faces -Y, Z up, the cube [-0.5, 0.5]^3; voxel (i, j,
    k) of an R^3 grid is centred at ((i, j, k) + 0.5) / R - 0.5.
Cameras: OpenCV axes (x right, y down, z forward), pixel centres at +0.5, K (V, 3, 3) without skew (kornia's
    pinhole has none).
A ray is origin + t * direction with t >= 0. Its direction has depth 1 in the camera frame, so t is depth
    along the camera's z axis; distances are t * |direction|.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

# Rays per step while path lengths are computed: 8192 x 195 crossings x 8 bytes = 13 MB a temporary array.
_CHUNK = 8192
# Shorter crossings (in voxels) are rounding errors at voxel edges, below float32 resolution of a chord.
_SHORTEST = 1e-6
# Stands in for a zero component of a direction: its planes are then crossed far outside any cube.
_TINY = 1e-12


def check_cameras(K: Tensor, cam_from_canonical: Tensor) -> int:
    """Number of cameras V; raises ValueError unless K is (V, 3, 3) and cam_from_canonical is (V, 4, 4)."""
    if K.ndim != 3 or K.shape[1:] != (3, 3):
        raise ValueError(f"K must be (V, 3, 3), got {tuple(K.shape)}")
    if cam_from_canonical.shape != (len(K), 4, 4):
        raise ValueError(f"cam_from_canonical must be ({len(K)}, 4, 4), got {tuple(cam_from_canonical.shape)}")
    return len(K)


def look_at_cameras(
    azimuth_deg: Sequence[float], elevation_deg: Sequence[float], distance: float, fov_deg: float, size: int
) -> tuple[Tensor, Tensor]:
    """V square cameras that look at the canonical origin, upright.

    Azimuth 0 stands in front of the object, on the -Y side, and looks along +Y; it grows towards +X (90 = on
    the +X side, 180 = behind the object). Elevation is positive above the object's middle, up to 90.

    Args:
        azimuth_deg, elevation_deg: V angles each, degrees.
        distance: from the camera centre to the origin, canonical units.
        fov_deg: full field of view across the image, degrees.
        size: width and height, pixels.

    Returns:
        K (V, 3, 3) in pixels and cam_from_canonical (V, 4, 4), float64.
    """
    if len(azimuth_deg) != len(elevation_deg):
        raise ValueError(f"one elevation an azimuth is needed, got {len(azimuth_deg)} and {len(elevation_deg)}")
    azimuth = torch.deg2rad(torch.as_tensor(azimuth_deg, dtype=torch.float64))
    elevation = torch.deg2rad(torch.as_tensor(elevation_deg, dtype=torch.float64))
    zero = torch.zeros_like(azimuth)
    # The right axis comes from the azimuth alone, so that a view from straight above stays defined.
    right = torch.stack([azimuth.cos(), azimuth.sin(), zero], -1)
    level = torch.stack([-azimuth.sin(), azimuth.cos(), zero], -1)
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    forward = elevation.cos()[:, None] * level - elevation.sin()[:, None] * up
    down = torch.linalg.cross(forward, right)
    cam_from_canonical = torch.eye(4, dtype=torch.float64).repeat(len(azimuth), 1, 1)
    cam_from_canonical[:, :3, :3] = torch.stack([right, down, forward], 1)
    cam_from_canonical[:, 2, 3] = distance
    K = torch.eye(3, dtype=torch.float64).repeat(len(azimuth), 1, 1)
    K[:, 0, 0] = K[:, 1, 1] = size / 2 / np.tan(np.deg2rad(fov_deg) / 2)
    K[:, :2, 2] = size / 2
    return K, cam_from_canonical


def paper_cameras(size: int = 128) -> tuple[Tensor, Tensor]:
    """The paper's cameras of Task 4: elevation {20, 35} x azimuth {150, 165} deg, distance 1.1, fov 30 deg.

    At this distance the image covers 0.59 canonical units at the origin, so objects of full size leave it.
    """
    return look_at_cameras([150, 165, 150, 165], [20, 20, 35, 35], 1.1, 30.0, size)


def select_pixels(pixels: Tensor | Sequence[Tensor] | None, n_views: int, height: int, width: int) -> list[Tensor]:
    """V int64 tensors of flat pixel indices row * width + column.

    Args:
        pixels: None for every pixel; or a (V, H, W) bool mask (a crop is a filled rectangle); or V tensors
            of flat indices, which may differ in length.

    Raises:
        ValueError: wrong shape or number of views, or an index outside the image.
    """
    if pixels is None:
        return [torch.arange(height * width)] * n_views
    if isinstance(pixels, Tensor):
        if pixels.shape != (n_views, height, width) or pixels.dtype != torch.bool:
            raise ValueError(
                f"pixels must be a ({n_views}, {height}, {width}) bool mask or {n_views} index tensors, "
                f"got {tuple(pixels.shape)} {pixels.dtype}"
            )
        return [torch.nonzero(view.flatten())[:, 0] for view in pixels]
    if len(pixels) != n_views:
        raise ValueError(f"pixels must have one index tensor a view ({n_views}), got {len(pixels)}")
    for view in pixels:
        if view.ndim != 1 or view.is_floating_point() or view.dtype == torch.bool:
            raise ValueError(f"pixel indices must be 1-d integers, got {tuple(view.shape)} {view.dtype}")
        if len(view) and (int(view.min()) < 0 or int(view.max()) >= height * width):
            raise ValueError(f"pixel indices must lie in [0, {height * width}), got {view.min()} to {view.max()}")
    return [view.long() for view in pixels]


def pixel_rays(K: Tensor, cam_from_canonical: Tensor, index: Tensor, width: int) -> tuple[Tensor, Tensor]:
    """Rays of one camera through pixel centres, differentiable with respect to the camera.

    Args:
        K: (3, 3), pixels.  cam_from_canonical: (4, 4), rigid or a similarity.
        index: (n,) int64, row * width + column.

    Returns:
        origin (3,) and directions (n, 3) in the canonical frame; directions have depth 1 in the camera frame.
    """
    # A quarter of a second to import, which shapes given as such need not wait for.
    from kornia.geometry.camera.perspective import unproject_points
    from kornia.geometry.linalg import transform_points

    centres = torch.stack([index % width, index.div(width, rounding_mode="floor")], -1).to(K.dtype) + 0.5
    in_camera = unproject_points(centres, torch.ones_like(centres[:, :1]), K)
    canonical_from_cam = torch.linalg.inv(cam_from_canonical)
    origin = canonical_from_cam[:3, 3]
    return origin, transform_points(canonical_from_cam[None], in_camera[None])[0] - origin


def cube_interval(origins: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
    """Where rays (n, 3) enter and leave the cube [-0.5, 0.5]^3: t (n,) each, equal for a miss."""
    safe = torch.where(directions.abs() < _TINY, torch.full_like(directions, _TINY), directions)
    first, last = (-0.5 - origins) / safe, (0.5 - origins) / safe
    near = torch.minimum(first, last).amax(-1).clamp_min(0)
    return near, torch.maximum(torch.maximum(first, last).amin(-1), near)


def path_lengths(origins: Tensor, directions: Tensor, resolution: int) -> tuple[Tensor, Tensor, Tensor]:
    """Exact length of every ray in every voxel that it crosses.

    Each ray meets 3 x (resolution + 1) grid planes; sorted, their parameters cut it into pieces of one voxel
    each (the slab method, for all planes at once instead of step by step).

    Args:
        origins, directions: (n, 3) float64, canonical frame.
        resolution: voxels along each side of the cube.

    Returns:
        counts (n,) int64, voxels on each ray (0 where it misses the cube); then, ray after ray, front to
        back: voxels (m,) int32, flat index (i * resolution + j) * resolution + k; lengths (m,) float64, in
        voxels.
    """
    counts, voxels, lengths = [], [], []
    planes = torch.linspace(-0.5, 0.5, resolution + 1, dtype=origins.dtype)
    for o, d in zip(origins.split(_CHUNK), directions.split(_CHUNK), strict=True):
        near, far = cube_interval(o, d)
        safe = torch.where(d.abs() < _TINY, torch.full_like(d, _TINY), d)
        t = ((planes - o[:, :, None]) / safe[:, :, None]).flatten(1)
        t = torch.minimum(torch.maximum(t, near[:, None]), far[:, None])
        # numpy sorts short rows of floats several times faster than torch, which also returns the order.
        t = torch.from_numpy(np.sort(t.numpy(), axis=1))
        step = t.diff(dim=1) * (d.norm(dim=1, keepdim=True) * resolution)
        ray, piece = torch.nonzero(step > _SHORTEST, as_tuple=True)
        middle = o[ray] + d[ray] * ((t[ray, piece] + t[ray, piece + 1]) / 2)[:, None]
        ijk = ((middle + 0.5) * resolution).floor().long().clamp(0, resolution - 1)
        counts.append(torch.bincount(ray, minlength=len(o)))
        voxels.append(((ijk[:, 0] * resolution + ijk[:, 1]) * resolution + ijk[:, 2]).int())
        lengths.append(step[ray, piece])
    if not counts:
        return torch.zeros(0, dtype=torch.int64), torch.zeros(0, dtype=torch.int32), origins.new_zeros(0)
    return torch.cat(counts), torch.cat(voxels), torch.cat(lengths)
