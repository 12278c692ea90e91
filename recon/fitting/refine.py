"""Polish parameters and alignment on the exact procedural model.

The fit's candidates are polished on silhouettes. An object that the class cannot make is searched once more by distance
(recon.fitting.by_distance): overlaps of outlines are no guide to what is merely similar.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass

from procmodels import Model
from procmodels.space import Params
from recon.fitting import uncertainty, view_starts
from recon.fitting.by_distance import DistanceSearch, widest_gap
from recon.fitting.gauss_newton import descended
from recon.fitting.mask_target import Level, Masks
from recon.fitting.moves import Face
from recon.fitting.placement import Similarity
from recon.fitting.problem import Problem
from recon.fitting.search import Neighbour, Schedule, Search, solve, turned_round
from recon.fitting.state import State
from recon.fitting.uncertainty import Certainty
from recon.fitting.view_starts import FitResult
from recon.geometry.object_windows import object_crops
from recon.scene import Canonical, ReconstructionError, Scene

log = logging.getLogger("recon")
MET = 0.97  # mean IoU of outlines that are met to a pixel or two
OPEN = 140.0  # degrees round the object without a camera: the hull is not carved there
NEARLY = 0.1  # of what is left unexplained: so much worse may the likelier of two fronts be


@dataclass(frozen=True)
class RefineOptions:
    """How the exact search runs."""

    size: int = 112  # pixels along each side of a window
    max_views: int = 32  # spread evenly over the photos; more add time and little else
    levels: tuple[Level, ...] = (Level(4, blur=1), Level(2, blur=1), Level(1, blur=2))  # the last is polished by once
    candidates: int = 8  # of the fit's, that are polished at all
    each: int = 2  # of these, at most, that face one way
    kept: int = 1  # of these, whose choices are searched
    sweeps: int = 3  # rounds over the discrete parameters and fronts
    tries: int = 4  # the most promising changes of a round that are polished
    far: int = 8  # shapes with parts of others that are polished, when the answer is not good
    good: float = 0.005  # 1 - mean IoU of an answer that needs no other choices
    steps: tuple[int, int, int] = (5, 3, 10)  # Gauss-Newton steps a level: of a candidate, of a change, of the answer

    @property
    def schedule(self) -> Schedule:
        """As the search wants it."""
        return Schedule(
            starts=self.candidates,
            each=self.each,
            kept=self.kept,
            sweeps=self.sweeps,
            tries=self.tries,
            far=self.far,
            good=self.good,
            steps=self.steps,
            levels=tuple(range(len(self.levels) - 1)) or (0,),
        )


@dataclass(frozen=True)
class Refined:
    """The result.

    params, canonical   parameters and world_from_canonical, facing the right way
    mean_iou            with the silhouettes used, at window size
    start_iou           the same before any polishing (best candidate)
    alternatives        (description, mean IoU less what is odd about them) of other fronts and choices, best first;
                        none is better than the answer by what accepted it
    certainty           how sure each parameter is
    overlap             the best mean IoU that was found, wherever it had the object stand; None where that is mean_iou
    next_front          mean IoU of the best other front, 0 where there is none
    """

    params: Params
    canonical: Canonical
    mean_iou: float
    start_iou: float
    alternatives: tuple[tuple[str, float], ...]
    certainty: Certainty | None = None
    overlap: float | None = None
    next_front: float = 0.0

    @property
    def evidence(self) -> float:
        """Mean IoU as evidence for the class, alike whether the answer was then moved to the object's place or not."""
        return self.mean_iou if self.overlap is None else self.overlap


def run(model: Model, scene: Scene, fitted: FitResult, options: RefineOptions = RefineOptions()) -> Refined:
    """The best state found from the fit's candidates; never worse than the best of them by IoU, unless it stands
    where the object cannot be, or is much farther from the silhouettes' hull."""
    problem = problem_of(model, scene, options)
    found = solve(problem, _candidates(problem, scene.canonical, fitted), options.schedule)
    search, best = Search(problem, options.schedule), found.state
    overlap: float | None = None
    if 1 - found.loss < MET:
        near = _near(problem, scene)
        if near is not None and (nearest := near.better(best)) is not None:
            # From here on all stands in the object's place: rivals, other fronts, and what the parameters may do.
            overlap, search, best = 1 - found.loss, Search(near.outlines, options.schedule), nearest
    best, near_by = turned(search, best, overlap is None)
    ranked = search.behind(best, near_by)
    mean_iou = 1 - search.problem.loss(best)
    return Refined(
        search.problem.params(best),
        Canonical(search.problem.posed(best).target_from_shape),
        mean_iou,
        1 - found.start,
        tuple((str(move), mean_iou - loss) for move, loss in ranked),
        uncertainty.run(search, best, neighbours=near_by),
        overlap,
        max((mean_iou - loss for move, loss in ranked if isinstance(move, Face)), default=0.0),
    )


def turned(search: Search, state: State, by_outlines: bool = True) -> tuple[State, list[Neighbour]]:
    """The state, a better neighbour, or either facing the likelier way, and the neighbours of that.

    by_outlines  whether outlines accepted the state: only then may they prefer another
    """
    best, neighbours = search.compared(state, rounds=3 if by_outlines else 0)
    round_ = turned_round(search, best, lambda loss: (1 + NEARLY) * loss + 5e-4)
    return (best, neighbours) if round_ is best else (round_, search.polished_neighbours(round_))


def problem_of(model: Model, scene: Scene, options: RefineOptions) -> Problem:
    """Masks in windows on the object, which stands anywhere; upright where the floor is known."""
    crops = object_crops(scene, options.size, options.max_views)
    upright = scene.silhouettes.floor is not None
    return Problem(model, Masks.of(crops, options.levels), Similarity(crops.cameras, upright=upright))


def _candidates(problem: Problem, canonical: Canonical, fitted: FitResult) -> Iterator[State]:
    """The fit's, each turned to its front."""
    for c in fitted.candidates:
        yield view_starts.state(problem, canonical, c.params, c.turn)


def _near(problem: Problem, scene: Scene) -> DistanceSearch | None:
    """A search by distance, or None when the views leave no closed hull to measure from."""
    if widest_gap(scene.used, scene.canonical) > OPEN:
        return None
    try:
        return DistanceSearch(problem, scene)
    except ReconstructionError as error:
        log.info("not searched by distance: %s", error)
        return None


def quick_iou(model: Model, scene: Scene, fitted: FitResult, options: RefineOptions = RefineOptions()) -> float:
    """Mean IoU of the fit's best candidate after one coarse polish: cheap evidence for or against a model."""
    problem = problem_of(model, scene, options)
    best = min(_candidates(problem, scene.canonical, fitted), key=problem.loss)
    return 1 - problem.loss(descended(problem, best, 3, (0,)))
