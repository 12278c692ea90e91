"""What is fitted: a procedural model, a target that its shapes are compared with, and where the shape may stand.

A target (masks, a hull, a surface, a voxel grid) and a placement (fixed, standing, a similarity, cameras) do not know
of each other; a problem asks the placement where a state's shape stands and the target how far that is from it.
Derivatives are exact: the target says what the motion of every vertex does, and vertices move by finite differences of
builds, which cost a millisecond each and no drawing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from procmodels import Model
from procmodels.shape import Shape
from procmodels.space import Params
from recon.fitting.nearby import Nearby, around
from recon.fitting.state import Jacobian, Placement, Posed, State, Target
from recon.fitting.usual import Usual

WIDE = 0.03  # of a scalar's range: what a finite difference is taken over where no small step will do
KEPT, KEPT_NEARBY = 400, 60  # shapes, and combinations of choices


class Problem:
    """A model to be fitted to a target. What was built and compared is kept."""

    def __init__(self, model: Model, target: Target, placement: Placement, held: bool = False) -> None:
        """`held`: the shape is known, its place alone is sought."""
        self.shape_held = held
        self.model, self.target, self.placement = model, target, placement
        self.scalars = model.space.scalars
        self.usual = Usual(model.space)
        self.builds = 0
        self._shapes: dict[tuple, Shape] = {}
        self._losses: dict[tuple, float] = {}
        self._nearby: dict[tuple, Nearby] = {}

    def forget(self) -> None:
        """What was kept: for those who measure."""
        for kept in (self._shapes, self._losses, self._nearby):
            kept.clear()

    # States

    def state(self, params: Mapping[str, Any], place: np.ndarray, front: int = 0) -> State:
        """A start."""
        return self._of(self.model.space.held(params), place, front)

    def _of(self, params: Mapping[str, Any], place: np.ndarray, front: int) -> State:
        units = np.array([np.clip(s.unit_from_value(float(params[s.name])), 0, 1) for s in self.scalars])
        return State(units, {p.name: params[p.name] for p in self.model.space.discrete}, place, front)

    def held(self, state: State) -> State:
        """The state with what does nothing at its usual values, so that each shape is one state."""
        space = self.model.space
        if not space.conditional:
            return state
        values = self._values(state)
        active = space.active(values)
        if all(p.name in active or values[p.name] == p.usual_value() for p in space.parameters):
            return state
        return self._of(space.held(values), state.place, state.front)

    def params(self, state: State) -> Params:
        """Parameter values in the space's order."""
        return self.model.space.validate(self._values(state))

    def _values(self, state: State) -> Params:
        values = {s.name: s.value_from_unit(float(u)) for s, u in zip(self.scalars, state.units, strict=True)}
        return {**values, **state.choices}

    def active(self, state: State) -> frozenset[str]:
        """Names of the parameters that do something."""
        return self.model.space.active(self._values(state))

    def movable(self, state: State) -> np.ndarray:
        """(n,) bool: the scalars that do something, unless the shape is held."""
        if self.shape_held or not self.model.space.conditional:
            return np.full(len(self.scalars), not self.shape_held)
        active = self.active(state)
        return np.array([s.name in active for s in self.scalars], bool)

    def free(self, state: State) -> np.ndarray:
        """(n + k,) bool: what may move."""
        return np.concatenate([self.movable(state), self.placement.free])

    def moved(self, state: State, delta: np.ndarray) -> State:
        """The state moved by (n + k,): scalars by shares of their ranges, then the place."""
        n = len(self.scalars)
        units = np.clip(state.units + delta[:n], 0, 1)
        place = self.placement.moved(state.place, delta[n:]) if delta[n:].any() else state.place
        return self.held(replace(state, units=units, place=place))

    def shape(self, state: State) -> Shape:
        """The state's shape; many states differ in their places alone."""
        if state.shape_key not in self._shapes:
            if len(self._shapes) > KEPT:
                self._shapes.clear()
            self._shapes[state.shape_key] = self.model.build(self.params(state))
            self.builds += 1
        return self._shapes[state.shape_key]

    def posed(self, state: State) -> Posed:
        """The state's shape in its place."""
        return self.placement.posed(self.shape(state), state.place, state.front)

    # How far they are from the target

    def loss(self, state: State) -> float:
        """What decides between states: the target's loss and what unusual places cost."""
        if state.key not in self._losses:
            posed = self.posed(state)
            unusual = float(np.square(self._priors(posed, state)).sum())
            unusual += self.target.usual * self.usual.rarity(state.choices)
            self._losses[state.key] = self.target.loss(posed) + unusual
        return self._losses[state.key]

    def residuals(self, state: State, level: int, at: State | None = None) -> np.ndarray:
        """(m,) whose squares a polish lowers; `at` is the state whose derivatives led here."""
        posed = self.posed(state)
        met = self.target.residuals(posed, level, posed if at is None else self.posed(at))
        return np.concatenate([met, np.sqrt(self.target.weight) * self._priors(posed, state)])

    def smooth(self, state: State, level: int) -> float:
        """Sum of squared residuals."""
        return float(np.square(self.residuals(state, level)).sum())

    def linearised(self, state: State, level: int) -> tuple[np.ndarray, Jacobian]:
        """The residuals (m,) of a state and their derivatives by the n + k numbers of `moved`, 0 for what is held."""
        posed, free, near = self.posed(state), self.free(state), self.nearby(state)
        met, J = self.target.linearised(posed, level, self.velocities(state, posed, near) * free)
        if unseen := [int(i) for i in np.flatnonzero(self.movable(state)) if i not in near.steps]:
            J = Jacobian.of(J.dense())
            for i in unseen:
                J.block[:, i] = self._drawn_slope(state, posed, i, level)
        root = np.sqrt(self.target.weight)
        unusual, slopes = root * self._priors(posed, state), root * self._prior_slopes(state, posed, near)
        m, more = len(met), len(unusual)
        rows = np.concatenate([J.rows, m + np.arange(more)])
        return np.concatenate([met, unusual]), Jacobian(m + more, rows, np.concatenate([J.block, slopes]))

    def _drawn_slope(self, state: State, posed: Posed, i: int, level: int) -> np.ndarray:
        """(m,) derivative by a scalar whose least step makes other parts, as one of no height does: by differences of
        residuals, over a step that shows the part."""
        step = -WIDE if state.units[i] > 0.5 else WIDE
        there = self.posed(self.moved(state, step * np.eye(len(state.units) + len(self.placement.free))[i]))
        return (self.target.residuals(there, level, posed) - self.target.residuals(posed, level, posed)) / step

    def nearby(self, state: State) -> Nearby:
        """Shapes round the state's, or round one close by: what moves a vertex there moves it here."""
        shape, movable = self.shape(state), self.movable(state)
        key = (*state.choices.values(), movable.tobytes())
        known = self._nearby.get(key)
        if known is None or not known.serves(state.units, shape):
            if len(self._nearby) > KEPT_NEARBY:
                self._nearby.clear()
            values = self._values(state)
            known = self._nearby[key] = around(self.model, values, state.units, np.flatnonzero(movable), shape)
            self.builds += len(known.steps)
        return known

    def velocities(self, state: State, posed: Posed, near: Nearby) -> np.ndarray:
        """(vertices, 3, n + k), or view by view: how they move with each number of the state, in the shape's frame."""
        scalars = np.zeros((*posed.shape.vertices().shape, len(state.units)))
        here = self.placement.posed(near.shape, state.place, state.front)
        before, back = near.shape.vertices(), np.linalg.inv(here.target_from_shape)
        for i, (step, shape) in near.steps.items():
            there, after = self.placement.posed(shape, state.place, state.front), shape.vertices()
            if not np.array_equal(there.target_from_shape, here.target_from_shape):
                moved = back @ there.target_from_shape
                after = after @ moved[:3, :3].T + moved[:3, 3]
            scalars[..., i] = (after - before) / step
        place = self.placement.velocities(posed, state.place)
        if place.ndim == 4:
            scalars = np.broadcast_to(scalars, (len(place), *scalars.shape))
        return np.concatenate([scalars, place], -1)

    def _priors(self, posed: Posed, state: State) -> np.ndarray:
        """Roots of what an unusual place and unusual scalars cost; a scalar that does nothing is at its usual value."""
        off = np.sqrt(self.target.usual) * self.usual.deviations(state.units)
        return np.concatenate([self.placement.priors(posed, state.place), off])

    def _prior_slopes(self, state: State, posed: Posed, near: Nearby) -> np.ndarray:
        """(r, n + k) derivatives of the priors: of places by finite differences, which need no drawing."""
        n, k = len(state.units), len(self.placement.free)

        def priors(shape: Shape, place: np.ndarray) -> np.ndarray:
            return self.placement.priors(self.placement.posed(shape, place, state.front), place)

        here = self.placement.priors(posed, state.place)
        out = np.zeros((len(here), n + k))
        if len(here):
            there = priors(near.shape, state.place)
            for i, (step, shape) in near.steps.items():
                out[:, i] = (priors(shape, state.place) - there) / step
            for i in np.flatnonzero(self.placement.free):
                place = self.placement.moved(state.place, 1e-5 * np.eye(k)[i])
                out[:, n + i] = (priors(posed.shape, place) - here) / 1e-5
        off = np.sqrt(self.target.usual) * self.usual.slopes * self.movable(state)
        return np.concatenate([out, np.pad(off, ((0, 0), (0, k)))])
