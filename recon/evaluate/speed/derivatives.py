"""Rows of `speed` on the exact fit: derivatives of outlines beside finite differences of drawn outlines."""

from __future__ import annotations

import numpy as np

from procmodels import Model, load
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.evaluate.speed.pairs import Subject
from recon.evaluate.speed.rows import Side, SpeedOptions, SpeedRow, in_turn
from recon.fitting.mask_target import Level, Masks
from recon.fitting.placement import Similarity
from recon.fitting.problem import Problem
from recon.fitting.state import State
from recon.geometry.object_windows import object_crops

VIEWS, SIDE = 32, 112  # of the windows
STEP = 2e-3  # of the finite differences: a share of a scalar's range, canonical units or radians


def jacobians(_: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """A model of few scalars and one of many."""
    rows = []
    for name in ("paper/chair", "chair"):
        problem, state = _problem(load(name))
        numbers = int(problem.free(state).sum())

        def ours(problem: Problem = problem, state: State = state) -> None:
            problem.forget()
            problem.linearised(state, 0)

        def drawn(problem: Problem = problem, state: State = state) -> None:
            problem.forget()
            differences(problem, state)

        seconds = in_turn([Side(ours), Side(drawn)], options.repeats, options.least)
        what = f"derivatives by {numbers} numbers, {VIEWS} windows of {SIDE}^2, {name}: of edges"
        rows.append(SpeedRow(what, "finite differences, a drawing for every number", *seconds))
    return rows


def differences(problem: Problem, state: State) -> np.ndarray:
    """(m, n + k) derivatives of the residuals by drawing once more for every number that may move."""
    here = problem.residuals(state, 0)
    out = np.zeros((len(here), len(problem.free(state))))
    for i in np.flatnonzero(problem.free(state)):
        step = -STEP if i < len(state.units) and state.units[i] > 0.5 else STEP
        out[:, i] = (problem.residuals(problem.moved(state, step * np.eye(out.shape[1])[i]), 0, state) - here) / step
    return out


def _problem(model: Model) -> tuple[Problem, State]:
    """A shape of the prior before windows of another one, at full size and as sharp as they are."""
    true, other = (model.space.sample(np.random.default_rng(i)) for i in (0, 1))
    cameras, place = orbit(VIEWS)
    crops = object_crops(drawn_scene(model.build(true), cameras, place), SIDE, VIEWS)
    problem = Problem(model, Masks.of(crops, [Level(1)]), Similarity(crops.cameras))
    return problem, problem.state(
        {**true, **{s.name: other[s.name] for s in problem.scalars}}, place.world_from_canonical
    )


PARTS = (jacobians,)
