"""Silhouettes from cameras that move: ray marching with gradients for the grid, the extrinsics and the intrinsics.

Same image model as the sparse operator of `nnproc.ray_operator`, S = 1 - exp(-integral of softplus(logits)),
    and its results to within 1 %. Use it where cameras or the alignment are refined; for fixed cameras the
    operator is exact and far faster.
Piecewise constant voxels have no useful gradient with respect to a camera: it is zero (nearest lookup), or exact but
    carried only by the few rays that graze an edge. Trilinear interpolation has a smooth one, but blurs over a whole
    voxel, and boards and legs are one voxel thin. So the density is interpolated trilinearly only in a band of
    1 / sharpness of a voxel across each voxel face and is constant between the bands. Mean absolute difference from
    the operator in % of full scale, six 64^2 views of 64^3 grids:

    sharpness                                  1 (trilinear)  2     3     4
    smooth random grids, sigma 2 / 4 voxels    0.84 / 0.38    0.31 / 0.13  0.18 / 0.08  0.14 / 0.07
    independent random voxels                  1.72           0.83  0.60  0.53
    random boxes                               1.21           0.43  0.27  0.20
    boards / legs one voxel thin               1.07 / 1.21    0.38 / 0.52  0.25 / 0.33  0.21 / 0.26

    A camera off by 3 degrees and 3 % (one 48^2 view, 80 steps of Adam) came back to within 0.5 degrees from 4 of 4
    starts with 3; 2 and 4 left one at 1.6 and 2.8; 1 stopped at 1.2 degrees and 1 % in all, because of its blur.
    Hence sharpness 3; from farther away start with 1 and end with 4. Interpolating logits instead of densities moves
    surfaces when a network is surer of empty than of full (5 % on boards).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional as F

from nnproc.rays import check_cameras, cube_interval, pixel_rays, select_pixels


def _check_grid(grid: Tensor, name: str) -> None:
    if grid.ndim not in (3, 4) or len(set(grid.shape[-3:])) != 1:
        raise ValueError(f"{name} must be (B, R, R, R) or (R, R, R), got {tuple(grid.shape)}")


def sample_grid(grid: Tensor, points: Tensor, sharpness: float = 1.0) -> Tensor:
    """Values of grids (B, R, R, R) at canonical points (n, m, 3): (B, n, m).

    sharpness 1 is trilinear between voxel centres; larger narrows the transition between two voxels to
    1 / sharpness of a voxel; infinity would be the nearest voxel.
    """
    resolution = grid.shape[-1]
    if sharpness != 1.0:
        index = (points + 0.5) * resolution - 0.5  # voxel centres at whole numbers
        lower = index.detach().floor()
        index = lower + ((index - lower - 0.5) * sharpness + 0.5).clamp(0, 1)
        points = (index + 0.5) / resolution - 0.5
    # grid_sample wants (x, y, z) = (last, middle, first axis) of the volume, each from -1 to 1 across the
    # cube.
    where = (2 * points.flip(-1))[None, :, :, None].to(grid.dtype)
    return F.grid_sample(grid[None], where, padding_mode="border", align_corners=False)[0, ..., 0]


def render_silhouettes(
    logits: Tensor,
    K: Tensor,
    cam_from_canonical: Tensor,
    height: int,
    width: int,
    pixels: Tensor | Sequence[Tensor] | None = None,
    sharpness: float = 3.0,
    step: float = 1.0,
) -> Tensor:
    """Silhouettes in [0, 1], differentiable with respect to logits, K and cam_from_canonical.

    Args:
        logits: (B, R, R, R) or (R, R, R), of occupancy. Occupancies o go in as torch.logit(o, 1e-6).
        K: (V, 3, 3), pixels.  cam_from_canonical: (V, 4, 4), rigid or a similarity, canonical units.
        height, width: of every image, pixels.
        pixels: every pixel (None), a (V, H, W) bool mask, or V tensors of flat indices row * width + column;
            a random subset makes a cheap stochastic step.
        sharpness: see the head of this file; at least 1. 1 pulls from farthest, larger is closer to the
        operator. step: largest distance between two samples on a ray, voxels.

    Returns:
        (B, V, H, W) or (V, H, W); with `pixels` (B, n_rays) or (n_rays,), rays ordered as in `ray_operator`.

    Raises:
        ValueError: wrong shapes, sharpness below 1 or a step that is not positive.
    """
    _check_grid(logits, "logits")
    if sharpness < 1 or step <= 0:
        raise ValueError(f"sharpness must be at least 1 and step positive, got {sharpness} and {step}")
    n_views = check_cameras(K, cam_from_canonical)
    density = F.softplus(logits.reshape(-1, *logits.shape[-3:]))
    chosen = select_pixels(pixels, n_views, height, width)
    views = []
    for k, camera, index in zip(K, cam_from_canonical, chosen, strict=True):
        origin, directions = pixel_rays(k, camera, index, width)
        views.append(1 - torch.exp(-_optical_depth(density, origin, directions, sharpness, step)))
    out = torch.cat(views, -1)
    out = out if pixels is not None else out.unflatten(-1, (n_views, height, width))
    return out if logits.ndim == 4 else out[0]


def _optical_depth(density: Tensor, origin: Tensor, directions: Tensor, sharpness: float, step: float) -> Tensor:
    """(B, n): integral of density (B, R, R, R), per voxel of path, along rays of one camera inside the cube."""
    near, far = cube_interval(origin.expand_as(directions), directions)
    hit = torch.nonzero(far > near)[:, 0]
    depth = density.new_zeros(len(density), len(directions))
    if len(hit) == 0:
        return depth
    near, chord, rays = near[hit], (far - near)[hit], directions[hit]
    length = chord * rays.norm(dim=-1) * density.shape[-1]  # voxels
    # Every ray takes as many as the cube's diagonal needs: a pixel must not depend on which others are drawn.
    samples = math.ceil(math.sqrt(3) * density.shape[-1] / step)
    middles = (torch.arange(samples, dtype=near.dtype) + 0.5) / samples
    t = near[:, None] + chord[:, None] * middles
    mean = sample_grid(density, origin + rays[:, None] * t[..., None], sharpness).mean(-1)
    return depth.index_copy(1, hit, mean * length.to(mean.dtype))


def ray_march(
    occupancy: Tensor, K: Tensor, cam_from_canonical: Tensor, height: int, width: int, samples: int = 150
) -> Tensor:
    """Plain ray marching as in the paper's Task 4 (4.2.4, with the emission-absorption of PyTorch3D), for comparison.

    Every ray takes `samples` trilinear samples at equal depths between distance -+ half the cube's diagonal,
    and
    S = 1 - prod_k (1 - o_k). No step length enters, so the image depends on the number of samples; the paper
    takes 150.

    Args:
        occupancy: (B, R, R, R) or (R, R, R) in [0, 1].
        K: (V, 3, 3), pixels.  cam_from_canonical: (V, 4, 4), rigid.  Differentiable with respect to all
        three.

    Returns:
        (B, V, H, W) or (V, H, W).
    """
    _check_grid(occupancy, "occupancy")
    check_cameras(K, cam_from_canonical)
    grids = occupancy.reshape(-1, *occupancy.shape[-3:])
    every = torch.arange(height * width)
    views = []
    for k, camera in zip(K, cam_from_canonical, strict=True):
        origin, directions = pixel_rays(k, camera, every, width)
        middle, reach = float(origin.detach().norm()), math.sqrt(3) / 2
        depths = torch.linspace(max(middle - reach, 0.01), middle + reach, samples, dtype=directions.dtype)
        views.append(origin + directions[:, None] * depths[:, None])
    # One call for all views: grid_sample works on them in parallel.
    where = 2 * torch.stack(views).flip(-1)[:, :, :, None].to(grids.dtype)
    volumes = grids[None].expand(len(K), -1, -1, -1, -1)
    sampled = F.grid_sample(volumes, where, padding_mode="zeros", align_corners=False)[..., 0]
    out = 1 - (1 - sampled).clamp_min(1e-6).log().sum(-1).exp()
    out = out.transpose(0, 1).unflatten(-1, (height, width))
    return out if occupancy.ndim == 4 else out[0]
