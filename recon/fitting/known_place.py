"""Parameters of the exact model when place and size are known: from four masks, or from a surface grid.

Nothing but the parameters is free, so that a build and its images cost a few milliseconds and dozens of choices can be
tried. A network's answers are the starts; none of them is made worse by the target's loss. What the target does not
show stands in the middle of what it allows.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from procmodels import Model
from procmodels.space import Params
from recon.fitting.mask_target import Level, Masks
from recon.fitting.placement import Fixed
from recon.fitting.problem import Problem
from recon.fitting.search import Schedule, Solution, solve
from recon.fitting.state import State
from recon.fitting.surface_target import VoxelGrid
from recon.fitting.undecided import centred, likely
from recon.scene import Cameras

LEVELS = (Level(4, blur=1), Level(2), Level(1))
ANYWHERE = 96  # random shapes that are looked at when all starts were lost
SCHEDULE = Schedule(
    looked=16,
    batches=2,
    sweeps=5,
    gain=1e-2,
    fronts=False,
    jumps=(0.1, 0.3, 0.5, 0.7, 0.9),
    far=40,
    settle=tuple(0.06 / 2**i for i in range(8)),
    coarse=True,
)
PIXELS = (1.5e-4, 5e-3)  # shares of all pixels that may differ in a good answer, and do in a lost one
VOXELS = (1e-3, 0.1)  # shares of the filled voxels


def in_masks(model: Model, masks: np.ndarray, K: np.ndarray, cam_from_canonical: np.ndarray) -> Problem:
    """The problem of masks (V, H, W) bool in cameras K (V, 3, 3), cam_from_canonical (V, 4, 4)."""
    target = Masks(masks, np.ones(masks.shape, bool), LEVELS)
    names = tuple(f"view {i}" for i in range(len(K)))
    return Problem(model, target, Fixed(Cameras(names, K, cam_from_canonical, target.sizes)))


def in_grid(model: Model, grid: np.ndarray) -> Problem:
    """The problem of a surface grid (R, R, R) bool in the canonical frame."""
    return Problem(model, VoxelGrid(grid), Fixed())


def run(problem: Problem, starts: Iterable[Params], schedule: Schedule = SCHEDULE) -> Solution:
    """The best state found from the starts; deterministic."""
    good, lost = losses(problem)
    schedule = replace(schedule, good=good, lost=lost)
    found = solve(problem, _states(problem, starts), schedule)
    state = likely(problem, centred(problem, found.state))
    return replace(found, state=state, loss=problem.loss(state))


def losses(problem: Problem) -> tuple[float, float]:
    """The loss that leaves few doubts of choices, and that of an answer which is not even near."""
    if isinstance(problem.target, VoxelGrid):
        return VOXELS
    return PIXELS[0] / problem.target.weight, PIXELS[1] / problem.target.weight


def _states(problem: Problem, starts: Iterable[Params]) -> Iterator[State]:
    """The starts, then random shapes."""
    space, rng = problem.model.space, np.random.default_rng(0)
    for params in itertools.chain(starts, (space.sample(rng) for _ in range(ANYWHERE))):
        yield problem.state(params, np.zeros(0))
