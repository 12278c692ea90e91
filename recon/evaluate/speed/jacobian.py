"""Rows of `speed` about derivatives of outlines: exact ones beside finite differences that draw once a number.

The agreement is told in the row: the exact derivatives of the windows' shares against central differences over steps
so small that hardly an edge passes the corner of a pixel, where shares have a kink and no derivative.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from procmodels import Model, load
from procmodels.parts.primitives import box
from procmodels.shape import Part
from procmodels.space import Params, ParamSpace, Scalar
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.evaluate.speed.pairs import Subject
from recon.evaluate.speed.rows import Side, SpeedOptions, SpeedRow, in_turn
from recon.fitting.mask_target import Masks
from recon.fitting.placement import Similarity
from recon.fitting.problem import Problem
from recon.fitting.refine import RefineOptions
from recon.fitting.state import State
from recon.geometry.object_windows import Crops, object_crops
from recon.geometry.raster import coverage, coverage_slopes

BOARDS = 25
STEP = 0.009  # of each number, as the version before this engine took
UNIT, FINE = 3e-4, 1e-6  # steps of scalars, whose vertices have 32 bits, and of the place, for the agreement


def boards() -> Model:
    """Twenty-five boards in a row on a floor, each as high as its own scalar."""
    heights = tuple(Scalar(f"height_{i}", 0.3, 1.0, 8) for i in range(BOARDS))

    def build(params: Params) -> list[Part]:
        tops = enumerate(float(params[h.name]) for h in heights)
        parts = [box(f"board {i}", (i / 20, 0, 0), (i / 20 + 0.035, 0.1, top)) for i, top in tops]
        return [box("floor", (0, -0.3, -0.05), (BOARDS / 20, 0.5, 0)), *parts]

    return Model("boards", ParamSpace("boards", heights), build, Path("boards.safetensors"))


def jacobians(_: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """A chair and boards, each anywhere before cameras all round, near the answer."""
    return [_row(model, options) for model in (load("paper/chair"), boards())]


def _row(model: Model, options: SpeedOptions) -> SpeedRow:
    rng = np.random.default_rng(0)
    cameras, place = orbit(options.jacobian_views)
    truth, near = model.space.sample(rng), model.space.sample(rng)
    near |= {p.name: truth[p.name] for p in model.space.discrete}
    crops = object_crops(drawn_scene(model.build(truth), cameras, place), options.jacobian_size)
    target = Masks.of(crops, RefineOptions().levels[-1:])

    def begun() -> tuple[Problem, State]:
        """A problem that has built nothing yet."""
        problem = Problem(model, target, Similarity(crops.cameras))
        return problem, problem.state(near, place.world_from_canonical)

    def exact() -> object:
        problem, state = begun()
        return problem.linearised(state, 0)

    def drawn() -> object:
        problem, state = begun()
        here = problem.residuals(state, 0)
        steps = STEP * np.where(np.arange(problem.free(state).size) < len(state.units), _inward(state), 1)
        return [(problem.residuals(problem.moved(state, step), 0) - here) / step.sum() for step in np.diag(steps)]

    ours, other = in_turn([Side(exact), Side(drawn)], options.repeats, options.least)
    numbers = len(model.space.scalars) + 7
    what = f"derivatives of {options.jacobian_views} windows of {options.jacobian_size}^2 by {numbers} numbers"
    against = f"finite differences, {numbers + 1} drawings; off by {disagreement(*begun(), crops):.1g} of their norm"
    return SpeedRow(f"{what}, {model.name}: exact", against, ours, other)


def _inward(state: State) -> np.ndarray:
    """(n + 7,) 1 or -1: ways to go that do not leave a scalar's range."""
    return np.concatenate([np.where(state.units > 0.5, -1, 1), np.ones(7)])


def disagreement(problem: Problem, state: State, crops: Crops) -> float:
    """The norm of exact less central differences as a share of the latter's, over pixels without a kink."""
    posed = problem.posed(state)
    _, slopes = coverage_slopes(posed.shape, posed.K, posed.cam_from_shape, crops.cameras.sizes)
    velocities = problem.velocities(state, posed, problem.nearby(state))
    found = np.zeros((crops.masks.size, velocities.shape[-1]))
    found[slopes.pixels] = slopes.along(velocities)

    def shares(at: State) -> np.ndarray:
        there = problem.posed(at)
        images = coverage(there.shape, there.K, there.cam_from_shape, crops.cameras.sizes, np.float64)
        return np.stack(images).ravel()

    off = total = 0.0
    for i, step in enumerate(np.eye(found.shape[1])):
        h = UNIT if i < len(state.units) else FINE
        here, ahead, behind = (shares(problem.moved(state, s * h * step)) for s in (0, 1, -1))
        expected = (ahead - behind) / (2 * h)
        smooth = np.abs(ahead + behind - 2 * here) / h < 1e-2 * np.abs(expected).max()
        off += float(np.square(found[smooth, i] - expected[smooth]).sum())
        total += float(np.square(expected[smooth]).sum())
    return float(np.sqrt(off / total))


PARTS = (jacobians,)
