"""Where the search on views of a known place begins: the network's answers and random shapes, ranked by outlines.

The network is shown the hull in the frame of every front hypothesis; of each answer the likeliest combinations of its
choices are taken. Random shapes of the prior stand beside them, since a network that is wrong is wrong with all of
them. A build and a few coarse outlines cost two milliseconds, so that all are compared exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch

from datasets.hulls import skin
from nnproc.infer import WeightsError, likely_params, load_network
from nnproc.latent_fit import FitOptions as LatentOptions
from nnproc.latent_fit import fit, hull_starts, silhouette_objective
from nnproc.ray_operator import RayOperator, ray_operator
from procmodels import Model
from procmodels.space import Params
from recon.fitting.mask_target import Level, Masks
from recon.fitting.placement import Similarity
from recon.fitting.problem import Problem
from recon.fitting.state import State
from recon.geometry.align import quarter_turn
from recon.geometry.object_windows import Crops, object_crops
from recon.geometry.visual_hull import Hull
from recon.scene import Canonical, InputError, Scene, cam_from_canonical
from recon.system.progress import hidden

TURNS = (0, 1, 2, 3)


@dataclass(frozen=True)
class FitOptions:
    """What is compared, and how many."""

    size: int = 64  # pixels along each side of a window
    max_views: int = 8
    look: Level = field(default_factory=lambda: Level(4, blur=1))  # how the windows are looked at
    likely: int = 12  # combinations of choices of each answer of the network
    random: int = 160  # shapes of the prior, each in all fronts
    kept: int = 4  # of every front: a wrong one may look better before it is polished
    seed: int = 0
    # The latent itself is searched too (paper, section 4.2.4), by the silhouettes of a trained decoder; None: not.
    latent: LatentOptions | None = None


@dataclass(frozen=True)
class Candidate:
    """Parameters, their front hypothesis (quarter turns), and the error of their coarse outlines (lower is better)."""

    params: Params
    turn: int
    loss: float


@dataclass(frozen=True)
class FitResult:
    """The best candidates, best first."""

    candidates: tuple[Candidate, ...]


def run(model: Model, scene: Scene, hull: Hull, options: FitOptions = FitOptions()) -> FitResult:
    """Candidates for refinement, of different choices or fronts. Raises InputError when the class's weights cannot be
    used."""
    try:
        network = load_network(model.space, model.weights)
    except WeightsError as error:
        raise InputError(str(error)) from error
    crops = object_crops(scene, options.size, options.max_views)
    grids = np.stack([np.rot90(skin(hull.grid), -turn, (0, 1)) for turn in TURNS])
    told = [
        (params, turn)
        for turn, answers in zip(TURNS, likely_params(network, grids, options.likely), strict=True)
        for params in answers
    ]
    if options.latent is not None and network.has_decoder:
        operator = _rays(crops, scene.canonical)
        objective = silhouette_objective(operator, operator.gather(torch.from_numpy(crops.masks)))
        begun = hull_starts(network, hull.grid, TURNS)
        bar = not hidden()
        told += [(f.params, f.turn) for f in fit(network, objective, options.latent, TURNS, begun, progress=bar)]
    rng = np.random.default_rng(options.seed)
    drawn = [model.space.sample(rng) for _ in range(options.random)]
    problem = Problem(model, Masks.of(crops, [options.look]), Similarity(crops.cameras))
    entries = [*told, *((params, turn) for params in drawn for turn in TURNS)]
    return FitResult(_best(problem, scene.canonical, entries, options.kept))


def _rays(crops: Crops, canonical: Canonical) -> RayOperator:
    """The windows' pixels that lie in the photos, as rays through the decoder's grid."""
    size, poses = crops.masks.shape[1], cam_from_canonical(crops.cameras, canonical)
    K, shown = torch.from_numpy(crops.cameras.K), torch.from_numpy(crops.valid)
    return ray_operator(K, torch.from_numpy(poses), size, size, pixels=shown)


def state(problem: Problem, canonical: Canonical, params: Params, turn: int) -> State:
    """Parameters in the canonical box, turned to their front."""
    return problem.state(params, canonical.world_from_canonical @ quarter_turn(turn), turn)


def _best(
    problem: Problem, canonical: Canonical, entries: list[tuple[Params, int]], count: int
) -> tuple[Candidate, ...]:
    """The best combinations of choices, `count` of every front, best first."""
    chosen: dict[tuple, Candidate] = {}
    for params, turn in entries:
        begun = state(problem, canonical, params, turn)
        found = Candidate(params, turn, problem.smooth(begun, 0))
        key = (turn, *begun.choices.values())
        if key not in chosen or found.loss < chosen[key].loss:
            chosen[key] = found
    ranked = sorted(chosen.values(), key=lambda c: c.loss)
    kept = [c for turn in TURNS for c in [c for c in ranked if c.turn == turn][:count]]
    return tuple(sorted(kept, key=lambda c: c.loss))
