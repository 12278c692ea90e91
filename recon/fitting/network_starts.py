"""Fit the network's latent to all silhouettes at once, over the four front hypotheses, and decode parameters."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from nnproc.infer import WeightsError, load_network
from nnproc.latent_fit import FitOptions as LatentOptions
from nnproc.latent_fit import fit, hull_starts, silhouette_objective
from procmodels import Model
from procmodels.space import Params
from recon.geometry.object_windows import object_crops
from recon.geometry.visual_hull import Hull, crop_operator
from recon.scene import Canonical, InputError, Poses, Silhouettes

TURNS = (0, 1, 2, 3)


@dataclass(frozen=True)
class FitOptions:
    """What the latent is compared with; `latent` says how it is searched."""

    size: int = 64  # pixels along each side of a window: about one a voxel
    max_views: int = 16  # more add time and little else
    latent: LatentOptions = field(default_factory=LatentOptions)


@dataclass(frozen=True)
class Candidate:
    """Parameters of a latent, its front hypothesis (quarter turns), and its silhouette error (lower is better)."""

    params: Params
    turn: int
    loss: float


@dataclass(frozen=True)
class FitResult:
    """The best candidates, best first."""

    candidates: tuple[Candidate, ...]


def run(
    model: Model,
    poses: Poses,
    silhouettes: Silhouettes,
    canonical: Canonical,
    hull: Hull,
    options: FitOptions = FitOptions(),
) -> FitResult:
    """Candidates for refinement. Raises InputError when the class's weights cannot be used."""
    try:
        network = load_network(model.space, model.weights)
    except WeightsError as error:
        raise InputError(str(error)) from error
    crops = object_crops(poses.cameras, silhouettes, canonical, options.size, options.max_views)
    operator = crop_operator(crops, canonical)
    objective = silhouette_objective(operator, operator.gather(torch.from_numpy(crops.masks)))
    starts = hull_starts(network, hull.grid, TURNS)
    fits = fit(network, objective, options.latent, TURNS, starts, progress=True)
    return FitResult(tuple(Candidate(f.params, f.turn, f.loss) for f in fits))
