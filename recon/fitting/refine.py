"""Polish parameters and alignment on the exact procedural model.

The fit's candidates are polished on silhouettes (recon.fitting.silhouette_search). An object that the class cannot make
is searched once more by distance (recon.fitting.distance_search):
overlaps of outlines are no guide to what is merely similar.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from procmodels import Model
from procmodels.space import Params
from recon.fitting import uncertainty
from recon.fitting.distance_search import DistanceSearch, widest_gap
from recon.fitting.network_starts import FitResult
from recon.fitting.silhouette_search import RefineOptions, SilhouetteSearch
from recon.fitting.uncertainty import Certainty
from recon.geometry.object_windows import object_crops
from recon.scene import Canonical, Poses, ReconstructionError, Silhouettes

log = logging.getLogger("recon")
MET = 0.97  # mean IoU of outlines that are met to a pixel or two
OPEN = 140.0  # degrees round the object without a camera: the hull is not carved there


@dataclass(frozen=True)
class Refined:
    """The result.

    params, canonical   parameters and world_from_canonical, facing the right way
    mean_iou            with the silhouettes used, at window size
    start_iou           the same before any polishing (best candidate)
    alternatives        (description, mean IoU) of other fronts and choices, best first
    certainty           how sure each parameter is
    overlap             the best mean IoU that was found, wherever it had the object stand; None where that is mean_iou
    """

    params: Params
    canonical: Canonical
    mean_iou: float
    start_iou: float
    alternatives: tuple[tuple[str, float], ...]
    certainty: Certainty | None = None
    overlap: float | None = None

    @property
    def evidence(self) -> float:
        """Mean IoU as evidence for the class, alike whether the answer was then moved to the object's place or not."""
        return self.mean_iou if self.overlap is None else self.overlap


def run(
    model: Model,
    poses: Poses,
    silhouettes: Silhouettes,
    canonical: Canonical,
    fitted: FitResult,
    options: RefineOptions = RefineOptions(),
) -> Refined:
    """The best state found from the fit's candidates; never worse than the best of them by IoU, unless it stands
    where the object cannot be, or is much farther from the silhouettes' hull."""
    crops = object_crops(poses.cameras, silhouettes, canonical, options.size, options.max_views)
    search: SilhouetteSearch = SilhouetteSearch(model, crops, options, upright=silhouettes.floor is not None)
    states = [search.state(c.params, canonical, c.turn) for c in fitted.candidates]
    scored = sorted(((search.iou(s), i) for i, s in enumerate(states)), reverse=True)
    start_iou = scored[0][0]
    polished = [search.polish(states[i]) for _, i in scored[: options.candidates]]
    best = search.improve_choices(max(polished, key=search.iou))
    overlap: float | None = None
    if search.iou(best) < MET:
        near = _near(model, poses, silhouettes, canonical, options)
        if near is not None and (nearest := near.better(best)) is not best:
            # From here on all stands in the object's place: rivals, other fronts, and what the parameters may do.
            overlap, search, best = search.iou(best), near, nearest
    best = search.faced(best)
    score, alternatives = search.iou(best), search.alternatives(best)
    sure = uncertainty.run(search, best)
    return Refined(search.params(best), Canonical(best.canonical), score, start_iou, alternatives, sure, overlap)


def _near(
    model: Model, poses: Poses, silhouettes: Silhouettes, canonical: Canonical, options: RefineOptions
) -> DistanceSearch | None:
    """A search by distance, or None when the views leave no closed hull to measure from."""
    if widest_gap(poses.cameras.subset(np.flatnonzero(silhouettes.used)), canonical) > OPEN:
        return None
    try:
        return DistanceSearch(model, poses, silhouettes, canonical, options)
    except ReconstructionError as error:
        log.info("not searched by distance: %s", error)
        return None


def quick_iou(
    model: Model,
    poses: Poses,
    silhouettes: Silhouettes,
    canonical: Canonical,
    fitted: FitResult,
    options: RefineOptions = RefineOptions(),
) -> float:
    """Mean IoU of the fit's best candidate after one coarse polish: cheap evidence for or against a model."""
    search = SilhouetteSearch(
        model, object_crops(poses.cameras, silhouettes, canonical, options.size, options.max_views), options
    )
    best = max((search.state(c.params, canonical, c.turn) for c in fitted.candidates), key=search.iou)
    return search.iou(search.polish(best, blurs=options.blurs[:1], steps=3))
