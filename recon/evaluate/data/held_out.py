"""Held-out shapes of a class with their exact meshes, and banks of training shapes as exact masks or grids."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import trimesh
from torch import Tensor
from tqdm import tqdm

from datasets.synthetic import SyntheticOptions, read, shape_params
from datasets.voxels import surface_grid
from nnproc.parameter_search import Bank, bank
from nnproc.ray_operator import RayOperator, ray_operator
from nnproc.rays import look_at_cameras, paper_cameras
from procmodels import Model
from procmodels.shape import Shape
from procmodels.space import Params
from recon.geometry.raster import silhouettes

log = logging.getLogger(__name__)

SIZE = 128  # pixels, as in the paper
STRIDE = 2  # our search looks at every second pixel along each axis
SPREAD = ([20.0, 110.0, 200.0, 290.0], [15.0, 30.0, 15.0, 30.0], 2.6, 30.0)  # azimuth, elevation, distance, fov
BANK = 2500  # training shapes of each kind, on and off the grid


@dataclass(frozen=True)
class Case:
    """One held-out shape: its parameters, mesh in the canonical frame and (64, 64, 64) bool surface grid."""

    params: Params
    shape: Shape
    mesh: trimesh.Trimesh
    grid: np.ndarray


def cases(model: Model, grid: str, count: int) -> list[Case]:
    """The first `count` held-out shapes, grid = "on" or "off"; training never saw them."""
    out = []
    for i in tqdm(range(count), desc=f"{model.name} {grid}-grid shapes", disable=None):
        params = shape_params(model, f"test_{grid}", i, SyntheticOptions())
        shape = model.build(params)
        out.append(Case(params, shape, shape.to_trimesh(), surface_grid(shape.vertices(), shape.triangles())))
    return out


def cameras(kind: str) -> tuple[Tensor, Tensor]:
    """K (4, 3, 3) and cam_from_canonical (4, 4, 4): "paper" (narrow; the object leaves the image) or "spread"."""
    return paper_cameras(SIZE) if kind == "paper" else look_at_cameras(*SPREAD, SIZE)


def operator(kind: str, stride: int = 1) -> RayOperator:
    """The rays of those cameras through every `stride`-th pixel of both axes."""
    K, cam_from_canonical = cameras(kind)
    rows = torch.arange(0, SIZE, stride)
    pixels = (rows[:, None] * SIZE + rows).flatten()
    return ray_operator(K, cam_from_canonical, SIZE, SIZE, pixels=[pixels] * len(K))


def masks(shape: Shape, kind: str) -> Tensor:
    """(4, 128, 128) float exact masks of a shape."""
    K, cam_from_canonical = cameras(kind)
    sizes = np.full((len(K), 2), SIZE)
    return torch.from_numpy(np.stack(silhouettes(shape, K.numpy(), cam_from_canonical.numpy(), sizes))).float()


def bank_path(model: Model, what: str, work: Path) -> Path:
    """Where a bank of known_shapes is kept."""
    return work / "banks" / f"{model.space.name}_{model.space.hash}_{what}.npz"


def known_shapes(model: Model, what: str, rays: RayOperator | None, work: Path, data: Path) -> Bank:
    """Training shapes as exact grids (what = "grid") or masks at the rays ("paper", "spread"); made once, kept.

    Grids come from the generated pairs in `data` when they are there: the same shapes.
    """
    if rays is None and (data / model.space.name / "manifest.json").is_file():
        pairs = [read(data / model.space.name, which, model.space.hash) for which in ("train_on", "train_off")]
        vectors = np.concatenate([p.vectors[:BANK] for p in pairs])
        return Bank(torch.from_numpy(vectors), np.concatenate([p.bits[:BANK] for p in pairs]), 64**3)
    path = bank_path(model, what, work)
    if path.is_file():
        with np.load(path, allow_pickle=False) as file:
            return Bank(torch.from_numpy(file["vectors"]), file["seen"], int(file["n"]))
    options = SyntheticOptions()
    params = [shape_params(model, which, i, options) for which in ("train_on", "train_off") for i in range(BANK)]
    seen = []
    for p in tqdm(params, desc=f"{model.name} bank, {what}", disable=None):
        shape = model.build(p)
        if rays is None:
            seen.append(surface_grid(shape.vertices(), shape.triangles()).ravel())
        else:
            seen.append(rays.gather(masks(shape, what)).numpy() > 0.5)
    known = bank(torch.from_numpy(np.stack([model.space.encode(p) for p in params])), seen)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    with partial.open("wb") as file:
        np.savez_compressed(file, vectors=known.vectors.numpy(), seen=known.seen, n=known.n)
    partial.replace(path)
    return known
