"""How a shape's vertices move with its scalars: by finite differences of builds, which cost a millisecond each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from procmodels import Model
from procmodels.shape import Shape
from procmodels.space import Params

STEP = 2e-3  # of a scalar's range: what its finite difference is taken over
CLOSE = 0.08  # of a scalar's range: so far on vertices move nearly as here


@dataclass(frozen=True)
class Nearby:
    """A shape and what single scalars make of it.

    units  (n,) scalars of the shape, as shares of their ranges
    steps  by number of a scalar: a small step, a share of its range, and the shape there, made of the same vertices
    """

    units: np.ndarray
    shape: Shape
    steps: dict[int, tuple[float, Shape]]

    def serves(self, units: np.ndarray, shape: Shape) -> bool:
        """Whether another shape's vertices move as this one's do, nearly."""
        return bool(np.abs(units - self.units).max(initial=0) <= CLOSE) and alike(shape, self.shape)


def around(model: Model, values: Params, units: np.ndarray, scalars: np.ndarray, shape: Shape) -> Nearby:
    """Shapes round one of these values; `scalars` (k,) int, those that do something. One whose step makes other
    vertices either way is left out."""
    steps: dict[int, tuple[float, Shape]] = {}
    for i in scalars.tolist():
        scalar, unit = model.space.scalars[i], float(units[i])
        for step in (-STEP, STEP) if unit > 0.5 else (STEP, -STEP):
            if not 0 <= unit + step <= 1:
                continue
            changed: dict[str, Any] = {**values, scalar.name: scalar.value_from_unit(unit + step)}
            there = model.build(changed)
            if alike(shape, there):
                steps[i] = step, there
                break
    return Nearby(units, shape, steps)


def alike(a: Shape, b: Shape) -> bool:
    """Whether two shapes are made of the same parts with the same faces."""
    return len(a.parts) == len(b.parts) and all(
        len(p.vertices) == len(q.vertices) and p.faces == q.faces for p, q in zip(a.parts, b.parts, strict=True)
    )
