"""How a held-out shape is found again: our searches, these refined, the paper's protocol on our network, the baseline.

Each method takes the class's Bench and a Case and returns a parameter set. Section 4.2 of the paper defines the tasks:
2 shape to parameters directly, 3 by optimisation of a latent against the shape, 4 against four silhouettes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from scipy.optimize import minimize
from torch import Tensor

from nnproc.infer import params_from_grids
from nnproc.latent_fit import PAPER, Objective, fit, grid_objective
from nnproc.network import NNProc
from nnproc.parameter_search import Bank, SearchOptions, draw_grid, draw_silhouettes, search
from nnproc.ray_marching import ray_march
from nnproc.ray_operator import RayOperator
from procmodels import Model
from procmodels.space import Params
from recon.evaluate.data.held_out import STRIDE, Case, cameras, known_shapes, masks, operator
from recon.evaluate.metrics import chamfer
from recon.fitting import known_place
from recon.fitting.problem import Problem

PAPER_GRID = replace(PAPER, steps=1000)  # Task 3 (REFERENCE: 1,000 steps)
EVALUATIONS = 100  # of the baseline, as in the paper
BASELINE_SAMPLES = 2000  # surface points a mesh in the baseline's objective


@dataclass(frozen=True)
class Bench:
    """What a method works with; folders as in known_shapes."""

    model: Model
    network: NNProc
    work: Path
    data: Path

    def known(self, what: str) -> tuple[RayOperator | None, Bank]:
        """Rays and bank of "paper" or "spread" cameras; no rays for "grid"."""
        return _rays_and_bank(self.model, what, self.work, self.data)


@lru_cache(maxsize=3)  # a class has three; its networks share them
def _rays_and_bank(model: Model, what: str, work: Path, data: Path) -> tuple[RayOperator | None, Bank]:
    rays = None if what == "grid" else operator(what, STRIDE)
    return rays, known_shapes(model, what, rays, work, data)


Method = Callable[[Bench, Case], Params]


def direct(bench: Bench, case: Case) -> Params:
    """Task 2: PD(SE(grid))."""
    return params_from_grids(bench.network, case.grid[None])[0]


def _grid_answers(bench: Bench, case: Case) -> tuple[list[Params], list[Params]]:
    """From a grid: ours, best first, and the bank's nearest shapes. No shape encoder, only SD(PE(p))."""
    _, known = bench.known("grid")
    target = torch.from_numpy(case.grid).flatten().float()
    found = search(bench.network, draw_grid, target, known, corrected=False)
    return [f.params for f in found], _nearest(bench, known, target)


def _mask_answers(bench: Bench, case: Case, what: str) -> tuple[list[Params], list[Params]]:
    """As _grid_answers, from the masks of "paper" or "spread" cameras."""
    rays, known = bench.known(what)
    assert rays is not None
    target = rays.gather(masks(case.shape, what))
    found = search(bench.network, draw_silhouettes(rays), target, known)
    return [f.params for f in found], _nearest(bench, known, target)


def _nearest(bench: Bench, known: Bank, target: Tensor) -> list[Params]:
    return bench.network.codec.params(known.vectors[known.nearest(target, SearchOptions().starts)])


def search_grid(bench: Bench, case: Case) -> Params:
    """Task 3, ours."""
    return _grid_answers(bench, case)[0][0]


def refined_grid(bench: Bench, case: Case) -> Params:
    """Task 3, ours, then the exact model against the grid."""
    found, nearest = _grid_answers(bench, case)
    problem = known_place.in_grid(bench.model, case.grid)
    return problem.params(known_place.run(problem, [*found, *nearest]).state)


def paper_grid(bench: Bench, case: Case) -> Params:
    """Task 3 as published."""
    objective = grid_objective(torch.from_numpy(case.grid).float(), total=True)
    return fit(bench.network, objective, PAPER_GRID)[0].params


def search_masks(what: str) -> Method:
    """Task 4, ours, for "paper" or "spread" cameras."""
    return lambda bench, case: _mask_answers(bench, case, what)[0][0]


def refined_masks(what: str) -> Method:
    """Task 4, ours, then the exact model against the masks; cameras and canonical frame are known."""

    def found(bench: Bench, case: Case) -> Params:
        answers, nearest = _mask_answers(bench, case, what)
        problem = mask_problem(bench.model, case, what)
        return problem.params(known_place.run(problem, [*answers, *nearest]).state)

    return found


def mask_problem(model: Model, case: Case, what: str) -> Problem:
    """The exact masks of a shape in "paper" or "spread" cameras."""
    K, cam_from_canonical = (c.numpy() for c in cameras(what))
    return known_place.in_masks(model, masks(case.shape, what).numpy() > 0.5, K, cam_from_canonical)


def paper_masks(what: str) -> Method:
    """Task 4 as published: plain ray marching, 150 samples a ray, from one start at zero."""

    def found(bench: Bench, case: Case) -> Params:
        return fit(bench.network, _marching(what, masks(case.shape, what)), PAPER)[0].params

    return found


def _marching(what: str, target: Tensor) -> Objective:
    K, cam_from_canonical = cameras(what)
    height, width = target.shape[-2:]

    def loss(logits: Tensor, turns: Tensor) -> Tensor:
        drawn = ray_march(torch.sigmoid(logits), K, cam_from_canonical, height, width)
        return (drawn - target).square().flatten(1).sum(1)

    return loss


def cobyqa(bench: Bench, case: Case) -> Params:
    """The paper's baseline: derivative-free search on D_chamfer from a random start, discrete parameters relaxed."""
    space, rng = bench.model.space, np.random.default_rng([7, int(case.grid.sum())])
    start = rng.random(space.width)

    def distance(x: np.ndarray) -> float:
        built = bench.model.build(space.decode(np.clip(x, 0, 1))).to_trimesh()
        return chamfer(built, case.mesh, BASELINE_SAMPLES)

    result = minimize(
        distance, start, method="COBYQA", bounds=[(0, 1)] * space.width, options={"maxfev": EVALUATIONS, "scale": False}
    )
    return space.decode(np.clip(result.x, 0, 1))


# Task -> method's name -> the method. Ablations use our methods with their own networks.
METHODS: dict[str, dict[str, Method]] = {
    "2": {"ours": direct, "cobyqa": cobyqa},
    "3": {"ours": search_grid, "refined": refined_grid, "paper": paper_grid},
    "4 paper": {"ours": search_masks("paper"), "refined": refined_masks("paper"), "paper": paper_masks("paper")},
    "4 spread": {"ours": search_masks("spread"), "refined": refined_masks("spread"), "paper": paper_masks("spread")},
}
