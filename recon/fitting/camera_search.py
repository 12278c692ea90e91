"""Masks, and cameras of which little or nothing is known: find parameters and cameras together.

Views of a bank that look like the mask start the search; each is then moved by the exact search. One mask does not tell
all of shape and camera; weak priors (recon.fitting.camera_priors) decide what it leaves open. Of several masks the
first is taken alone; the camera of each other one is searched with that shape held; then all moves together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procmodels import Model
from procmodels.space import Params
from recon.fitting import beliefs, moves, uncertainty
from recon.fitting.moves import Face
from recon.fitting.one_view import CameraSearchOptions, OneView, ViewProblem, distinct, problem_of, starts
from recon.fitting.refine import Refined, turned
from recon.fitting.search import Search
from recon.fitting.silhouette_bank import Bank, shape_bank
from recon.fitting.state import State
from recon.fitting.uncertainty import Calibration, Certainty
from recon.scene import Canonical

ELSEWHERE = 40.0  # degrees: another camera so far round has another front before it


@dataclass(frozen=True)
class FoundView:
    """The answer: refined (its canonical is in the frame of `cam_from_world`, iou at window size) and the camera."""

    refined: Refined
    K: np.ndarray
    cam_from_world: np.ndarray
    azimuth: float
    elevation: float


@dataclass(frozen=True)
class FoundViews:
    """The answer to several masks: parameters, K (V, 3, 3), cam_from_canonical (V, 4, 4) rigid and the mean IoU;
    alternatives and certainty as in Refined."""

    params: Params
    K: np.ndarray
    cam_from_canonical: np.ndarray
    mean_iou: float
    alternatives: tuple[tuple[str, float], ...]
    certainty: Certainty


def find(model: Model, view: OneView, bank: Bank, options: CameraSearchOptions = CameraSearchOptions()) -> FoundView:
    """Parameters and camera that explain the mask best."""
    problem = problem_of(model, [view], options)
    coarse, fine = Search(problem, options.coarse), Search(problem, options.fine)
    begun = starts(problem, bank, options, options.starts)
    polished = distinct(problem, [coarse.step(s, options.coarse.steps[0]) for s in begun], options.finals, 2)
    improved = fine.ranked(fine.improved(s) for s in polished)
    improved = _mixed(fine, improved, [*polished, *begun])
    finals = fine.ranked([*map(fine.finished, improved[: options.finished]), *improved[options.finished :]])
    best, near_by = turned(fine, finals[0])
    mean_iou = problem.agreement(best)
    ranked = [(move, mean_iou - loss) for move, loss in fine.behind(best, near_by)]
    others = _elsewhere(problem, best, finals[1:])
    fronts = [iou for move, iou in ranked if isinstance(move, Face)] + [iou for apart, _, iou in others if apart]
    words = [(str(move), iou) for move, iou in ranked] + [(said, iou) for _, said, iou in others]
    posed = problem.posed(best)
    refined = Refined(
        problem.params(best),
        Canonical(posed.target_from_shape),
        mean_iou,
        max(map(problem.agreement, begun)),
        tuple(sorted(words, key=lambda pair: -pair[1])),
        uncertainty.run(fine, best, _calibration(model), near_by),
        next_front=max(fronts, default=0.0),
    )
    return FoundView(
        refined, _K(view, problem, best), problem.placement.views.cam_from_world[0], *problem.direction(best)
    )


def _mixed(search: Search, states: list[State], donors: list[State]) -> list[State]:
    """The states, best first, and one more that has a group of its parameters from another answer, where that helps."""
    best, tries = states[0], search.schedule.far
    tried = moves.grafts(search.problem, [*states[1:], *donors])
    mixed = search.best_of(best, tried, tries) if tries else best
    return states if search.cost(mixed) >= search.cost(best) else [search.improved(mixed), *states]


def first_look(model: Model, view: OneView, bank: Bank, options: CameraSearchOptions = CameraSearchOptions()) -> float:
    """IoU after a short search: cheap evidence for or against a class."""
    problem = problem_of(model, [view], options)
    search = Search(problem, options.coarse)
    return max(problem.agreement(search.finished(s)) for s in starts(problem, bank, options, 3))


def find_all(
    model: Model, views: Sequence[OneView], params: Params, options: CameraSearchOptions = CameraSearchOptions()
) -> FoundViews:
    """Parameters and cameras that explain several masks best, from the parameters that explain the first."""
    bank = shape_bank(model, params, options.bank)
    states = []
    for view in views:
        alone = problem_of(model, [view], options, held=True)
        search = Search(alone, options.coarse)
        begun = starts(alone, bank, options, options.starts // 2)
        states.append(min((search.finished(s) for s in begun), key=alone.loss))
    problem = problem_of(model, views, options)
    search = Search(problem, options.fine)
    state = problem.state(params, problem.placement.shared([s.place for s in states]))
    state, near_by = search.compared(search.finished(search.improved(search.step(state, options.fine.steps[2]))))
    mean_iou = problem.agreement(state)
    K = np.stack([_K(view, problem, state) for view in views])
    return FoundViews(
        problem.params(state),
        K,
        problem.posed(state).cam_from_shape,
        mean_iou,
        tuple((str(move), mean_iou - loss) for move, loss in search.behind(state, near_by)),
        uncertainty.run(search, state, _calibration(model), near_by),
    )


def _calibration(model: Model) -> Calibration:
    return beliefs.calibration_of(beliefs.table(model.space, "image"))


def _K(view: OneView, problem: ViewProblem, state: State) -> np.ndarray:
    """The whole image's lens."""
    K = view.K.copy()
    K[(0, 1), (0, 1)] *= problem.placement.frames(state.place)[1]
    return K


def _elsewhere(problem: ViewProblem, best: State, others: Sequence[State]) -> list[tuple[bool, str, float]]:
    """(whether from another side, description, IoU less what is odd about it) of the finalists that are seen from
    elsewhere."""
    out, (azimuth, _) = [], problem.direction(best)
    here, mean_iou = problem.loss(best), problem.agreement(best)
    for state in others:
        there, elevation = problem.direction(state)
        apart = round((there - azimuth + 180) % 360 - 180)
        side = abs(apart) > ELSEWHERE
        said = f"{'front' if side else 'camera'} turned by {apart} degrees"
        score = mean_iou - max(0.0, problem.loss(state) - here)
        out.append((side, f"{said}, seen from an elevation of {elevation:.0f} degrees", score))
    return out
