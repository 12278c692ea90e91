"""A search for parameters and alignment on the exact procedural model against silhouettes: a state and its moves.

Given choices and integers, the scalars and the seven numbers of the alignment are moved by Gauss-Newton steps on
blurred silhouettes (derivatives by finite differences: a mesh and its outlines cost milliseconds). Around that, one
discrete parameter or the front is changed at a time, and a change is kept when the mean IoU of the silhouettes rises.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from tqdm import tqdm

from procmodels import Model
from procmodels.shape import Shape
from procmodels.space import Params
from recon.geometry.align import quarter_turn
from recon.geometry.object_windows import Crops
from recon.geometry.raster import coverage
from recon.geometry.raster import silhouettes as silhouettes_of
from recon.scene import Canonical, cam_from_canonical

HALF_TURN = "front turned by 180 degrees"
NEARLY = 0.1  # of what is left unexplained: so much worse may the likelier of two fronts be


@dataclass(frozen=True)
class RefineOptions:
    """How the exact search runs."""

    size: int = 112  # pixels along each side of a window
    max_views: int = 32  # spread evenly over the photos; more add time and little else
    blurs: tuple[float, ...] = (4.0, 1.5)  # pixels, one series of Gauss-Newton steps each, coarse to fine
    steps: int = 5  # Gauss-Newton steps a blur
    candidates: int = 3  # of the fit's, that are polished at all
    sweeps: int = 3  # rounds over the discrete parameters
    tries: int = 4  # the most promising changes of a round that are polished
    scalar_step: float = 0.03  # finite difference of a scalar, share of its range
    pose_step: float = 0.009  # finite difference of the alignment, canonical units or radians


@dataclass(frozen=True)
class State:
    """Scalars as shares of their ranges (n,), discrete values, and where the object is."""

    units: np.ndarray
    discrete: Params
    canonical: np.ndarray
    turn: int


Residuals = Callable[[State], np.ndarray]  # whose squares are to become small; of one length for states alike


class SilhouetteSearch:
    """The silhouettes to be met, and ways to move a state towards them.

    free  (n + 7,) 1 for what may move, 0 for what is held: scalars, then rotation, translation and size as in `moved`
    """

    def __init__(self, model: Model, crops: Crops, options: RefineOptions, upright: bool = False) -> None:
        """`upright`: the object stands on a floor that is known better than outlines tell its tilt."""
        self.model, self.crops, self.options = model, crops, options
        self.hard = (crops.masks >= 0.5) & crops.valid
        self.scalars = model.space.scalars
        self.shapes: dict[tuple, Shape] = {}
        n = len(self.scalars)
        self.free = np.ones(n + 7)
        if upright:
            self.free[n : n + 2] = 0

    def state(self, params: Params, canonical: Canonical, turn: int) -> State:
        """A candidate's state, its canonical frame turned to its front."""
        units = np.array([s.unit_from_value(float(params[s.name])) for s in self.scalars])
        discrete = {p.name: params[p.name] for p in self.model.space.discrete}
        return State(units, discrete, canonical.world_from_canonical @ quarter_turn(turn), turn)

    def params(self, state: State) -> Params:
        """Parameter values in the space's order."""
        values = {s.name: s.value_from_unit(float(u)) for s, u in zip(self.scalars, state.units, strict=True)}
        return self.model.space.validate({**values, **state.discrete})

    def built(self, state: State) -> Shape:
        """The state's shape; most states differ from the one before in their alignment alone."""
        key = (state.units.tobytes(), tuple(state.discrete.items()))
        if key not in self.shapes:
            if len(self.shapes) > 64:
                self.shapes.clear()
            self.shapes[key] = self.model.build(self.params(state))
        return self.shapes[key]

    def images(self, state: State, draw: Callable[..., list[np.ndarray]]) -> np.ndarray:
        """(V, S, S), the shape drawn into the windows by raster.silhouettes (bool) or raster.coverage (shares)."""
        shape = self.built(state)
        cameras = self.crops.cameras
        poses = cam_from_canonical(cameras, Canonical(state.canonical))
        return np.stack(draw(shape, cameras.K, poses, cameras.sizes))

    def iou(self, state: State) -> float:
        """Mean IoU over the views."""
        images = self.images(state, silhouettes_of) & self.crops.valid
        union = (images | self.hard).sum((1, 2))
        return float(np.mean((images & self.hard).sum((1, 2)) / np.maximum(union, 1)))

    def moved(self, state: State, delta: np.ndarray) -> State:
        """The state moved by (scalars, rotation vector, translation, log scale), the last seven in its own frame."""
        n = len(self.scalars)
        change = np.eye(4)
        change[:3, :3] = np.exp(delta[n + 6]) * cv2.Rodrigues(delta[n : n + 3])[0]
        change[:3, 3] = delta[n + 3 : n + 6]
        units = np.clip(state.units + delta[:n], 0, 1)
        return replace(state, units=units, canonical=_similarity(state.canonical @ change))

    def polish(self, state: State, blurs: tuple[float, ...] | None = None, steps: int | None = None) -> State:
        """Gauss-Newton steps, coarse to fine; the best state by IoU among those visited."""
        best, best_iou = state, self.iou(state)
        for blur in blurs or self.options.blurs:
            damping, residuals = 1e-3, partial(self._residual, blur=blur)
            for _ in range(steps or self.options.steps):
                state, damping, improved = self.step(state, residuals, damping)
                if not improved:
                    break
            if (iou := self.iou(state)) > best_iou:
                best, best_iou = state, iou
        return best

    def _residual(self, state: State, blur: float) -> np.ndarray:
        difference = (self.images(state, coverage) - self.crops.masks) * self.crops.valid
        # Two box filters: near enough to a Gaussian of this width, at a tenth of its time.
        side = 2 * round((np.sqrt(6 * blur**2 + 1) - 1) / 2) + 1
        return np.concatenate([cv2.blur(cv2.blur(d, (side, side)), (side, side)).ravel() for d in difference])

    def linearised(self, state: State, blur: float) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (m,) of the blurred outlines, and their derivatives (m, n + 7) as `moved` counts changes."""
        return self.slopes(state, partial(self._residual, blur=blur))

    def slopes(self, state: State, residuals: Residuals) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (m,) of a state, and their derivatives (m, n + 7) by finite differences, 0 for what is held."""
        here, sizes = residuals(state), self.probes(state)
        J = np.zeros((len(here), len(sizes)))
        for i in np.flatnonzero(self.free[: len(sizes)]):
            J[:, i] = (residuals(self.moved(state, np.eye(len(sizes))[i] * sizes[i])) - here) / sizes[i]
        return here, J

    def probes(self, state: State) -> np.ndarray:
        """(n + 7,) finite differences; a scalar at its upper end is probed downwards."""
        scalars = np.where(state.units + self.options.scalar_step > 1, -1, 1) * self.options.scalar_step
        return np.concatenate([scalars, np.full(7, self.options.pose_step)])

    def step(self, state: State, residuals: Residuals, damping: float) -> tuple[State, float, bool]:
        """One damped Gauss-Newton step; returns the state, the next damping, and whether it lowered the error."""
        here, J = self.slopes(state, residuals)
        hessian, gradient = J.T @ J, J.T @ here
        for _ in range(4):
            delta = -np.linalg.solve(hessian + np.diag(damping * np.diag(hessian) + 1e-6), gradient)
            delta = np.clip(delta, -0.25, 0.25)
            trial = self.moved(state, delta)
            if (residuals(trial) ** 2).sum() < (here**2).sum() * (1 - 1e-4):
                return trial, damping / 3, True
            damping *= 10
        return state, damping, False

    def neighbours(self, state: State) -> Iterator[tuple[str, State]]:
        """States that differ in one discrete value or in the front."""
        for p in self.model.space.discrete:
            for i in range(p.grid_steps):
                value = p.grid_value(i)
                if value != state.discrete[p.name]:
                    yield f"{p.name} = {value}", replace(state, discrete={**state.discrete, p.name: value})
        for k in (1, 2, 3):
            yield (
                HALF_TURN if k == 2 else f"front turned by {90 * k} degrees",
                replace(state, canonical=state.canonical @ quarter_turn(k), turn=(state.turn + k) % 4),
            )

    def improve_choices(self, state: State) -> State:
        """Change one thing at a time while the IoU rises."""
        score = self.iou(state)
        for _ in tqdm(range(self.options.sweeps), desc="refine", unit="sweep", disable=None):
            ranked = sorted(((self.iou(s), i, s) for i, (_, s) in enumerate(self.neighbours(state))), reverse=True)
            trials = [self.polish(s, steps=3) for _, _, s in ranked[: self.options.tries]]
            best = max(trials, key=self.iou)
            if self.iou(best) <= score + 1e-4:
                break
            state = self.polish(best)
            score = self.iou(state)
        final = self.polish(state, blurs=(self.options.blurs[-1], 0.8), steps=2 * self.options.steps)
        return final if self.iou(final) > score else state

    def faced(self, state: State) -> State:
        """The state, or the same object facing the other way when its values say that it is seen from behind and the
        outlines are explained nearly as well."""
        other = self.model.turned_round(self.params(state)) if self.model.turned_round else None
        turned = [s for name, s in self.neighbours(state) if name == HALF_TURN]
        if other is None or not turned:
            return state
        units = np.array([s.unit_from_value(float(other[s.name])) for s in self.scalars])
        discrete = {p.name: other[p.name] for p in self.model.space.discrete}
        found = self.improve_choices(self.polish(replace(turned[0], units=units, discrete=discrete)))
        score = self.iou(state)
        return found if self.iou(found) >= score - NEARLY * (1 - score) - 5e-4 else state

    def alternatives(self, state: State) -> tuple[tuple[str, float], ...]:
        """The other fronts polished, and the other choices as they are, best first."""
        scored = []
        for name, neighbour in self.neighbours(state):
            polished = self.polish(neighbour, steps=2) if name.startswith("front") else neighbour
            scored.append((name, self.iou(polished)))
        return tuple(sorted(scored, key=lambda pair: -pair[1]))


def _similarity(matrix: np.ndarray) -> np.ndarray:
    """The nearest similarity: rounding of many small moves must not build up into shear."""
    u, s, vt = np.linalg.svd(matrix[:3, :3])
    out = matrix.copy()
    out[:3, :3] = s.mean() * u @ vt
    return out
