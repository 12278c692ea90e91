"""What the parts of a fit hand to each other: a state, a shape in its place, and what targets and placements answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from procmodels.shape import Shape
from procmodels.space import Params


@dataclass(frozen=True)
class State:
    """A candidate answer.

    units    (n,) scalars as shares of their ranges
    choices  integers, choices and flags
    place    the placement's numbers
    front    which of the ways to stand and face
    """

    units: np.ndarray
    choices: Params
    place: np.ndarray
    front: int = 0

    @property
    def shape_key(self) -> tuple:
        return (self.units.tobytes(), *self.choices.values())

    @property
    def key(self) -> tuple:
        return (*self.shape_key, self.place.tobytes(), self.front)


@dataclass(frozen=True)
class Posed:
    """A shape in its place.

    target_from_shape  (4, 4) similarity to the frame of the target
    cam_from_shape     (V, 4, 4) rigid, in canonical units; K (V, 3, 3) pixels; both empty where there are no views
    """

    shape: Shape
    target_from_shape: np.ndarray
    cam_from_shape: np.ndarray
    K: np.ndarray

    def in_target(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) points of the shape's frame in the target's."""
        return points @ self.target_from_shape[:3, :3].T + self.target_from_shape[:3, 3]


@dataclass(frozen=True)
class Jacobian:
    """Derivatives of m residuals, most of which may not change at all: (p, k) of the residuals `rows` (p,) int."""

    m: int
    rows: np.ndarray
    block: np.ndarray

    @staticmethod
    def of(dense: np.ndarray) -> Jacobian:
        """Of (m, k) derivatives of which few are 0."""
        return Jacobian(len(dense), np.arange(len(dense)), dense)

    def dense(self) -> np.ndarray:
        """(m, k)."""
        out = np.zeros((self.m, self.block.shape[1]), self.block.dtype)
        out[self.rows] = self.block
        return out


class Target(Protocol):
    """What shapes are compared with, coarsely (level 0) to finely.

    weight  squares of residuals that one unit of loss is worth
    usual   loss that a parameter one spread off its usual value may cost: enough to decide what is not to be seen
    noise   loss that an exact answer has at most
    """

    levels: int
    weight: float
    usual: float
    noise: float

    def residuals(self, posed: Posed, level: int, at: Posed) -> np.ndarray:
        """(m,); `at` is the state that derivatives were taken at, where residuals are laid out on its surface."""

    def linearised(self, posed: Posed, level: int, velocities: np.ndarray) -> tuple[np.ndarray, Jacobian]:
        """(m,) residuals at `posed` itself and their derivatives by motions (n, 3, k) of its vertices, in its frame."""

    def loss(self, posed: Posed) -> float:
        """What decides between states, 0 at best."""


class Placement(Protocol):
    """Where a shape may stand. `free` (k,) bool says which of its k numbers may move, `fronts` how many there are."""

    @property
    def free(self) -> np.ndarray: ...
    @property
    def fronts(self) -> int: ...

    def posed(self, shape: Shape, place: np.ndarray, front: int) -> Posed: ...

    def moved(self, place: np.ndarray, delta: np.ndarray) -> np.ndarray:
        """The place moved by (k,)."""

    def velocities(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        """(n, 3, k), or (V, n, 3, k) view by view: how `moved` moves the vertices, in the shape's frame."""

    def turned(self, place: np.ndarray, front: int, to: int) -> np.ndarray:
        """The place when the shape faces another way."""

    def half_turn(self, front: int) -> int | None:
        """The front that looks the other way."""

    def priors(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        """(r,) roots of what an unusual place costs, in units of the loss."""
