"""Table tops: an outline from rectangle to ellipse, or an L, and the room that it leaves for what stands below."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procmodels.parts.primitives import box, plate
from procmodels.parts.topology import corner_signs, loft_faces, outline_arcs
from procmodels.shape import Part

ARC = 7  # vertices in each quarter of the outline, the middle one at 45 degrees
LEAST = 0.01  # less round than this is a rectangle


@dataclass(frozen=True)
class Top:
    """A level plate centred over the origin; lengths in the model's units.

    roundness  0 rectangle, 1 ellipse; corners are quarters of circles as long as it is small
    low, high  z of its faces
    """

    width: float
    depth: float
    roundness: float
    low: float
    high: float

    @cached_property
    def _radii(self) -> np.ndarray:
        """(2,) half axes of the corners' quarters of ellipses."""
        halves = np.array([self.width, self.depth]) / 2
        # All vertices are apart.
        share = 0.0 if self.is_rectangle else min(self.roundness, 1 - LEAST)
        short = halves.min()
        return share * (short + share * (halves - short))

    @property
    def is_rectangle(self) -> bool:
        """Whether its corners are square."""
        return self.roundness < LEAST

    @cached_property
    def room(self) -> tuple[float, float]:
        """x, y of the point of a corner's arc at 45 degrees: what has its corner there lies below the top."""
        x, y = np.array([self.width, self.depth]) / 2 - (1 - math.sqrt(0.5)) * self._radii
        return float(x), float(y)

    def outline(self, size: tuple[float, float] | None = None) -> np.ndarray:
        """(n, 2) counter-clockwise, or one of the same kind whose corners at 45 degrees lie at x, y of `size`."""
        halves = np.array([self.width, self.depth]) / 2
        outline = corner_signs(ARC) * (halves - self._radii) + outline_arcs(ARC) * self._radii
        return outline if size is None else outline * (np.array(size) / self.room)

    def plate(self, name: str, low: float, high: float, size: tuple[float, float] | None = None) -> Part:
        """A plate of its outline, or of one like it, between two heights."""
        if self.is_rectangle:
            x, y = size or self.room
            return box(name, (-x, -y, low), (x, y, high))
        return plate(name, self.outline(size), low, high)

    def towards(self, degrees: float) -> tuple[float, float]:
        """x, y of the outline's point whose corner's arc looks in that direction, from +X; upwards, the middle."""
        angle = math.radians(degrees)
        c, s = math.cos(angle), math.sin(angle)
        inner = np.array([self.width, self.depth]) / 2 - self._radii
        x, y = inner * (np.sign(round(c, 9)), np.sign(round(s, 9))) + self._radii * (c, s)
        return float(x), float(y)


def angled(name: str, width: float, depth: float, arm: tuple[float, float], low: float, high: float) -> Part:
    """An L-shaped plate, its inner corner towards the front and the right.

    arm  the depth of the arm along the rear, and the width of the one that comes forward at the left
    """
    x, y = width / 2, depth / 2
    corner = (x - arm[1], y - arm[0])
    # Counter-clockwise from the corner that lies across the inner one.
    outline = np.array([(x, y), (-x, y), (-x, corner[1]), corner, (corner[0], -y), (x, -y)])
    rings = np.empty((2, 6, 3))
    rings[:, :, :2] = outline
    rings[0, :, 2], rings[1, :, 2] = low, high
    halves = ((0, 1, 2, 3), (0, 3, 4, 5))  # both convex
    caps = tuple(h[::-1] for h in halves) + tuple(tuple(6 + i for i in h) for h in halves)
    return Part(name, rings.reshape(-1, 3), caps + loft_faces(2, 6)[2:])
