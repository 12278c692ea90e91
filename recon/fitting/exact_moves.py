"""Moves of an exact search among the scalars: Gauss-Newton on smooth residuals, then small steps by counted ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from procmodels import Model
from procmodels.shape import Shape
from procmodels.space import Params
from recon.fitting.exact_targets import ExactTarget


@dataclass(frozen=True)
class ExactOptions:
    """How wide and how long the search is."""

    starts: int = 4  # of different choices, that are polished coarsely
    sweeps: int = 5  # rounds over the choices
    tries: int = 4  # most promising changes of a round that are polished
    far: int = 40  # tries among all combinations, when the exact loss is not good
    jumps: tuple[float, ...] = (0.1, 0.3, 0.5, 0.7, 0.9)  # where else in its range a scalar is tried
    steps: tuple[int, int, int] = (3, 2, 8)  # Gauss-Newton steps of a start, of a changed choice, of the last polish
    differences: tuple[float, ...] = (0.03, 0.02, 0.01)  # of a scalar's range, a level each; the last serves the rest
    settle: tuple[float, ...] = (0.02, 0.008, 0.003, 0.001)  # last steps, as root mean squares of the residuals' change
    points: int = 500  # surface points of each shape, when shapes that look alike are compared
    alike: int = 20  # of these, at most
    combined: int = 120  # combinations of several choices that are tried for it
    anywhere: int = 96  # random shapes that are looked at when all starts were lost
    restarts: int = 3  # of these, that are polished


@dataclass(frozen=True)
class State:
    """Scalars as shares of their ranges (n,), and the discrete values."""

    units: np.ndarray
    discrete: Params

    @property
    def key(self) -> tuple:
        return (self.units.tobytes(), *self.discrete.values())


class Moves:
    """A target, what was built for it, and steps from state to state."""

    def __init__(self, model: Model, target: ExactTarget, options: ExactOptions) -> None:
        self.model, self.target, self.options = model, target, options
        self.builds = 0
        self._shapes: dict[tuple, Shape] = {}
        self._losses: dict[tuple, float] = {}

    def state(self, params: Params) -> State:
        """A start."""
        space = self.model.space
        units = np.array([np.clip(s.unit_from_value(float(params[s.name])), 0, 1) for s in space.scalars])
        return State(units, {p.name: params[p.name] for p in space.discrete})

    def params(self, state: State) -> Params:
        """Parameter values in the space's order."""
        scalars = self.model.space.scalars
        values = {s.name: s.value_from_unit(float(u)) for s, u in zip(scalars, state.units, strict=True)}
        return self.model.space.validate({**values, **state.discrete})

    def shape(self, state: State) -> Shape:
        """The state's shape, built once."""
        if state.key not in self._shapes:
            if len(self._shapes) > 400:
                self._shapes.clear()
            self._shapes[state.key] = self.model.build(self.params(state))
            self.builds += 1
        return self._shapes[state.key]

    def exact(self, state: State) -> float:
        """The target's exact loss."""
        if state.key not in self._losses:
            self._losses[state.key] = self.target.loss(self.shape(state))
        return self._losses[state.key]

    def smooth(self, state: State, level: int) -> float:
        """What polishing at a level lowers."""
        return float(np.square(self.residuals(state, level, self.shape(state))).sum())

    def coarse(self, state: State) -> float:
        """The smooth loss that choices are compared by."""
        return self.smooth(state, 0)

    def residuals(self, state: State, level: int, reference: Shape) -> np.ndarray:
        """(n,) of the target."""
        return self.target.residuals(self.shape(state), level, reference)

    def polish(self, state: State, level: int, steps: int) -> State:
        """Damped Gauss-Newton steps of the scalars."""
        damping = 1e-2
        if not len(state.units):
            return state
        for _ in range(steps):
            reference = self.shape(state)
            here = self.residuals(state, level, reference)
            J = self.slopes(state, level)
            hessian, gradient, loss = J.T @ J, J.T @ here, here @ here
            for _ in range(3):
                free = _free(state.units, gradient)
                step = np.zeros(len(state.units))
                damped = hessian + np.diag(damping * np.diag(hessian) + 1e-9)
                step[free] = -np.linalg.solve(damped[np.ix_(free, free)], gradient[free]) if free.any() else 0
                trial = moved(state, np.clip(step, -0.25, 0.25))
                lower = float(np.square(self.residuals(trial, level, reference)).sum())
                if lower < loss * (1 - 1e-4):
                    break
                damping *= 8
            else:
                return state
            state, damping = trial, damping / 4
            if loss - lower < 1e-2 * loss:
                break
        return state

    def finish(self, state: State) -> State:
        """Polished at every level; the best by exact loss of what was visited."""
        visited = [state]
        for level in range(self.target.levels):
            visited.append(self.polish(visited[-1], level, self.options.steps[2]))
        return self.settle(min(visited, key=self.exact))

    def slopes(self, state: State, level: int) -> np.ndarray:
        """(residuals, scalars) derivatives by finite differences; a scalar in the upper half is probed downwards."""
        reference = self.shape(state)
        here = self.residuals(state, level, reference)
        size = self.options.differences[min(level, len(self.options.differences) - 1)]
        deltas = np.diag(np.where(state.units > 0.5, -size, size))
        return np.stack([(self.residuals(moved(state, d), level, reference) - here) / d.sum() for d in deltas], 1)

    def settle(self, state: State) -> State:
        """Small steps by the exact loss itself: counted pixels tell apart what their smooth shares blur.

        Steps go along directions that change the residuals equally much and independently.
        """
        if not len(state.units):
            return state
        J = self.slopes(state, self.target.levels - 1)
        values, vectors = np.linalg.eigh(J.T @ J + 1e-4 * np.eye(len(state.units)))
        loss = self.exact(state)
        for size in self.options.settle if loss > 0 else ():
            for _ in range(3):
                before = loss
                for direction in (vectors * np.clip(size / np.sqrt(values), 0, 0.1)).T:
                    for way in (direction, -direction):
                        trial = moved(state, way)
                        if (lower := self.exact(trial)) < loss:
                            state, loss = trial, lower
                            break
                if loss == before:
                    break
        return state


def moved(state: State, delta: np.ndarray) -> State:
    """The state with its scalars moved by (n,) shares of their ranges."""
    return replace(state, units=np.clip(state.units + delta, 0, 1))


def _free(units: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """(n,) bool: scalars that may move; those at an end of their range that want to leave it may not."""
    return ~(((units <= 0) & (gradient > 0)) | ((units >= 1) & (gradient < 0)))
