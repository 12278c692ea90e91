"""Silhouettes of an occupancy grid seen by fixed cameras, as one sparse matrix; the hull from the same rays.

Image model: a voxel with logit l blocks light with density softplus(l) per voxel of path; a ray with path
    lengths w shows
    S = 1 - exp(-sum_i w_i softplus(l_i)) = 1 - prod_i (1 - sigmoid(l_i))^w_i,  0 = background, 1 = object:
    the paper's volume rendering (Task 4) with the integral taken exactly instead of by 150 samples.
For fixed cameras the path lengths never change. They are built once (`ray_operator`); a silhouette is then
    one sparse product for all views and all grids. For cameras that move, see `nnproc.ray_marching`.
Conventions of frames, cameras and voxels: `nnproc.rays`.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import scipy.sparse
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn import functional as F

from nnproc.rays import check_cameras, path_lengths, pixel_rays, select_pixels

# Grids that share one sparse product. Measured: 4 columns cost 2 to 3 times one, 16 leave the cache and cost 10 times.
# Running through rays in tiles or voxels in blocks was tried too: no gain after the reordering is paid for.
_COLUMNS = 4
_HAS_MKL = torch.backends.mkl.is_available()


def _csr(matrix: scipy.sparse.csr_matrix) -> Tensor:
    """The same matrix as a torch CSR tensor; int32 indices, or MKL would convert them at every product."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")
        crow = torch.from_numpy(matrix.indptr).int()
        col = torch.from_numpy(matrix.indices).int()
        return torch.sparse_csr_tensor(crow, col, torch.from_numpy(matrix.data), matrix.shape, check_invariants=False)


def _scipy_csr(matrix: Tensor) -> scipy.sparse.csr_matrix:
    """A scipy view of a torch CSR tensor; no copy."""
    parts = matrix.values(), matrix.col_indices(), matrix.crow_indices()
    return scipy.sparse.csr_matrix(tuple(p.numpy() for p in parts), shape=tuple(matrix.shape))


def _product(matrix: Tensor, columns: Tensor) -> Tensor:
    """(m, B): sparse matrix (m, n) times columns (n, B)."""
    if not _HAS_MKL:  # torch has no CPU sparse product without MKL, e.g. on ARM
        return torch.from_numpy(_scipy_csr(matrix) @ columns.numpy())
    if columns.shape[1] == 1:
        return (matrix @ columns[:, 0])[:, None]
    return matrix @ columns.contiguous()  # row-major right-hand sides are about twice as fast as transposed ones


class _Absorption(torch.autograd.Function):
    """1 - exp(-W softplus(logits)); the backward pass is a CSR product too, with W^T stored."""

    @staticmethod
    @torch.amp.custom_fwd(device_type="cpu", cast_inputs=torch.float32)
    def forward(ctx: Any, logits: Tensor, weight: Tensor, weight_t: Tensor) -> Tensor:
        transmitted = [torch.exp(-_product(weight, F.softplus(part).T)) for part in logits.split(_COLUMNS)]
        ctx.save_for_backward(logits, weight_t, *transmitted)
        return 1 - torch.cat([part.T for part in transmitted])

    @staticmethod
    @once_differentiable
    @torch.amp.custom_bwd(device_type="cpu")
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None, None]:  # type: ignore[override]
        logits, weight_t, *transmitted = ctx.saved_tensors
        parts = zip(grads[0].split(_COLUMNS), transmitted, strict=True)
        by_density = [_product(weight_t, g.T * t).T for g, t in parts]
        return torch.cat(by_density) * torch.sigmoid(logits), None, None


@dataclass(frozen=True)
class RayOperator:
    """Rays of V fixed cameras through an R^3 grid as a sparse matrix; rays are ordered view by view.

    weight    (n_rays, R^3) CSR, path lengths in voxels; weight_t (R^3, n_rays) CSR, its transpose
    view      (n_rays,) int64, which camera a ray belongs to
    pixel     (n_rays,) int64, row * width + column in that camera's image
    shape     (V, height, width) of the images
    resolution  R
    """

    weight: Tensor
    weight_t: Tensor
    view: Tensor
    pixel: Tensor
    shape: tuple[int, int, int]
    resolution: int

    @property
    def n_rays(self) -> int:
        return len(self.view)

    def render(self, logits: Tensor) -> Tensor:
        """Silhouettes in [0, 1] of logits (B, R, R, R) or (R, R, R): (B, n_rays) or (n_rays,).

        In the operator's precision, also under autocast. Differentiable once, with respect to the logits.
        """
        side = (self.resolution,) * 3
        if logits.ndim not in (3, 4) or logits.shape[-3:] != side:
            raise ValueError(
                f"logits must be (B, {side[0]}, {side[0]}, {side[0]}) or without B, got {tuple(logits.shape)}"
            )
        flat = logits.reshape(-1, self.resolution**3).to(self.weight.dtype)
        return _Absorption.apply(flat, self.weight, self.weight_t).reshape(*logits.shape[:-3], self.n_rays)

    def gather(self, images: Tensor) -> Tensor:
        """Values of images (V, H, W) at the rays: (n_rays,), for example a mask to compare `render` with."""
        if images.shape != self.shape:
            raise ValueError(f"images must be {self.shape}, got {tuple(images.shape)}")
        return images[self.view, self.pixel.div(self.shape[2], rounding_mode="floor"), self.pixel % self.shape[2]]

    def scatter(self, values: Tensor, fill: float = 0.0) -> Tensor:
        """Ray values (..., n_rays) as images (..., V, H, W), `fill` where no ray is. Differentiable."""
        if values.shape[-1:] != (self.n_rays,):
            raise ValueError(f"values must be (..., {self.n_rays}), got {tuple(values.shape)}")
        n_views, height, width = self.shape
        images = values.new_full((*values.shape[:-1], n_views * height * width), fill)
        return images.index_copy(-1, self.view * height * width + self.pixel, values).unflatten(-1, self.shape)


def ray_operator(
    K: Tensor,
    cam_from_canonical: Tensor,
    height: int,
    width: int,
    resolution: int = 64,
    pixels: Tensor | Sequence[Tensor] | None = None,
    dtype: torch.dtype = torch.float32,
) -> RayOperator:
    """Build the sparse operator of V fixed cameras; about 0.1 s per million crossings, built in float64.

    Args:
        K: (V, 3, 3), pixels.  cam_from_canonical: (V, 4, 4), rigid or a similarity, canonical units.
        height, width: of every image, pixels. Views of different sizes: give the largest, and `pixels`.
        resolution: voxels along each side of the canonical cube.
        pixels: every pixel (None), a (V, H, W) bool mask, or V tensors of flat indices row * width + column.
            Rays that miss the cube stay as empty rows: they render to 0 and cost nothing.
        dtype: of the path lengths and so of the silhouettes: float32, or float64 for checks.

    Raises:
        ValueError: wrong shapes, no ray at all, or more crossings than int32 indices can hold.
    """
    n_views = check_cameras(K, cam_from_canonical)
    chosen = select_pixels(pixels, n_views, height, width)
    K, cam_from_canonical = K.detach().double(), cam_from_canonical.detach().double()
    parts = []
    for k, camera, index in zip(K, cam_from_canonical, chosen, strict=True):
        origin, directions = pixel_rays(k, camera, index, width)
        parts.append(path_lengths(origin.expand_as(directions), directions, resolution))
    counts, voxels, lengths = (torch.cat(column) for column in zip(*parts, strict=True))
    if not len(counts) or len(lengths) >= 2**31:
        raise ValueError(f"the operator needs 1 to 2^31 crossings, got {len(counts)} rays and {len(lengths)} crossings")
    crow = torch.cat([counts.new_zeros(1), counts.cumsum(0)]).int()
    weight = scipy.sparse.csr_matrix(
        (lengths.to(dtype).numpy(), voxels.numpy(), crow.numpy()), shape=(len(counts), resolution**3)
    )
    view = torch.repeat_interleave(torch.arange(n_views), torch.tensor([len(index) for index in chosen]))
    shape = (n_views, height, width)
    return RayOperator(_csr(weight), _csr(weight.T.tocsr()), view, torch.cat(chosen), shape, resolution)


def view_votes(operator: RayOperator, masks: Tensor) -> tuple[Tensor, Tensor]:
    """What every view says about every voxel: W_v^T mask / W_v^T 1.

    Args:
        masks: (V, H, W), bool or in [0, 1] (a soft mask), 1 = object.

    Returns:
        inside (V, R, R, R), share of the path through a voxel that lies on rays of the mask (0 where unseen);
        path (V, R, R, R), total path length in voxels of a view's rays through a voxel (0 where unseen).
    """
    values, columns, crow = (
        operator.weight.values(),
        operator.weight.col_indices(),
        operator.weight.crow_indices().long(),
    )
    on_mask = operator.gather(masks).to(values.dtype)
    ray_starts = torch.searchsorted(operator.view, torch.arange(operator.shape[0] + 1))
    inside, path = [], []
    for first, last in zip(ray_starts[:-1].tolist(), ray_starts[1:].tolist(), strict=True):
        entries = slice(int(crow[first]), int(crow[last]))
        weights = torch.repeat_interleave(on_mask[first:last], crow[first : last + 1].diff())
        voxels, lengths = columns[entries], values[entries]
        total = torch.bincount(voxels, lengths, operator.resolution**3)
        inside.append(torch.bincount(voxels, lengths * weights, operator.resolution**3) / total.clamp_min(1e-12))
        path.append(total)
    side = (len(inside), *(operator.resolution,) * 3)
    return torch.stack(inside).reshape(side), torch.stack(path).reshape(side)


def visual_hull(
    operator: RayOperator,
    masks: Tensor,
    fraction: float = 0.85,
    min_views: int = 2,
    inside: float = 0.5,
    trust: Tensor | None = None,
) -> Tensor:
    """Solid hull of silhouettes: a voxel stays when enough of the views that see it find it inside.

    A view finds a voxel inside when at least `inside` of the path through it belongs to rays of the mask.
    Voxels between two rays of a view, or outside its image or its chosen pixels, are not seen by that view,
    which then has no vote: keep pixels no larger than a voxel, and do not crop away background that should
    carve.

    Args:
        masks: (V, H, W), bool or in [0, 1], 1 = object.
        fraction: share of the (trusted) views that must agree; 1 carves with every view, for exact masks;
            0.85 tolerates one bad view in seven.
        min_views: voxels seen by fewer views go.
        inside: share of the path that must lie in the mask; small keeps outlines fat, near 1 makes them thin.
        trust: (V,) weight of each view's vote, None for equal ones.

    Returns:
        (R, R, R) bool.
    """
    n_views = operator.shape[0]
    trust = torch.ones(n_views) if trust is None else trust
    if trust.shape != (n_views,):
        raise ValueError(f"trust must be ({n_views},), got {tuple(trust.shape)}")
    share, path = view_votes(operator, masks)
    seen = path > 0
    weight = seen * trust.to(share.dtype)[:, None, None, None]
    agree = (weight * (share >= inside)).sum(0)
    # A hair of slack: float sums of whole votes must not fall below their own share.
    return (agree >= fraction * weight.sum(0) - 1e-6) & (seen.sum(0) >= min_views)
