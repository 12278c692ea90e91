"""Upright boards at the sides: what sides of boxes and the arms of armchairs are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels.parts.legs import both
from procmodels.parts.primitives import Plane, sheet, upright
from procmodels.shape import Part


@dataclass(frozen=True)
class Side:
    """The outer face of the left side: x at two places along y, straight between them."""

    front: tuple[float, float]  # x, y
    rear: tuple[float, float]

    def at(self, y: float) -> float:
        """x of the face at y."""
        (x0, y0), (x1, y1) = self.front, self.rear
        return x0 + (x1 - x0) * (y - y0) / (y1 - y0)

    def end(self, y: float, x: float) -> float:
        """y, or the place before it where the face has come as near to the middle as x."""
        (x0, y0), (x1, y1) = self.front, self.rear
        return y if self.at(y) >= x else y0 + (x - x0) * (y1 - y0) / (x1 - x0)


def side_boards(name: str, side: Side, thickness: float, low: Plane, high: Plane, rear_top: float) -> list[Part]:
    """A board at each side, inside of the side's face, between two planes; its rear edge leans from the side's rear
    end below to y = rear_top above."""
    front, rear = side.front[1], side.rear[1]
    ends = [[(front, low), (rear, low)], [(front, high), (side.end(rear_top, 1.05 * thickness), high)]]
    outer = np.array([[(side.at(y), y, plane.at(y)) for y, plane in row] for row in ends])
    # Seen from outside on the left, the front is on the left.
    return both(name, sheet("", outer, outer - np.array([thickness, 0, 0]), convex=True))


def end_boards(side: Side, thickness: float, height: float, under: Plane) -> list[Part]:
    """Boards between the side boards at the front and the rear, from the plane down by a share of its height."""
    parts = []
    for name, y in (("front", side.front[1] + thickness / 2), ("rear", side.rear[1] - thickness / 2)):
        width = 2 * (min(side.at(y - thickness / 2), side.at(y + thickness / 2)) - thickness)
        size = (width, thickness)
        low = Plane((1 - height) * under.at(y))
        parts.append(upright(f"board {name}", (0, y), (0, y), size, size, low, under))
    return parts
