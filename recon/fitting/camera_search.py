"""One mask, and a camera of which little or nothing is known: find parameters and camera together.

Views of a bank that look like the mask start the search; each is then moved by the exact search
(recon.fitting.view_search). One mask does not tell all of shape and camera; weak priors
(recon.fitting.camera_priors) decide what it leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels import Model
from recon.fitting import uncertainty
from recon.fitting.refine import Refined
from recon.fitting.silhouette_bank import Bank
from recon.fitting.view_search import CameraSearchOptions, OneView, ViewSearch
from recon.scene import Canonical


@dataclass(frozen=True)
class FoundView:
    """The answer: refined (its canonical is in the frame of `cam_from_world`, iou at window size) and the camera."""

    refined: Refined
    K: np.ndarray
    cam_from_world: np.ndarray
    azimuth: float
    elevation: float


def find(model: Model, view: OneView, bank: Bank, options: CameraSearchOptions = CameraSearchOptions()) -> FoundView:
    """Parameters and camera that explain the mask best."""
    job = ViewSearch(model, view, options)
    starts = job.starts(bank, options.starts)
    polished = job.distinct([job.polish(s) for s in starts], options.finals, 2)
    job.options = options.fine
    finals = sorted((job.climbed(job.improve_choices(s)) for s in polished), key=job.iou, reverse=True)
    best = job.climbed(job.faced(finals[0]))
    refined = Refined(
        job.params(best),
        Canonical(best.canonical),
        job.agreement(best),
        max(map(job.agreement, starts)),
        tuple(sorted([*job.alternatives(best), *job.other_cameras(best, finals[1:])], key=lambda a: -a[1])),
        uncertainty.run(job, best),
    )
    K = view.K.copy()
    K[(0, 1), (0, 1)] *= best.zoom
    return FoundView(refined, K, job.crops.cameras.cam_from_world[0], *job.direction(best))


def first_look(model: Model, view: OneView, bank: Bank, options: CameraSearchOptions = CameraSearchOptions()) -> float:
    """IoU after a short search: cheap evidence for or against a class."""
    job = ViewSearch(model, view, options)
    return max(job.agreement(job.climbed(job.polish(s))) for s in job.starts(bank, 3))
