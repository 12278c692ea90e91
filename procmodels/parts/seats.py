"""Seats: a slab that may slope to the rear, its outline from rectangle to ellipse, and a cushion on it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procmodels.parts.primitives import Plane, loft, rounded
from procmodels.shape import Part

# A cushion's rings from its underside: height, and size beside the seat's outline.
_CUSHION = np.array([(0.0, 0.93), (0.3, 0.96), (0.75, 0.95), (1.0, 0.85)])


@dataclass(frozen=True)
class Seat:
    """A slab centred over the origin, its front towards -Y; lengths in the model's units.

    width      of the front edge
    taper      width of the rear edge beside that of the front edge
    roundness  0 rectangle, 1 ellipse
    top, under planes of its two faces
    """

    width: float
    depth: float
    taper: float
    roundness: float
    top: Plane
    under: Plane

    @cached_property
    def corner(self) -> float:
        """How far towards a corner of the full rectangle the outline reaches, of the half sides."""
        return 1 - (0.01 + 0.98 * self.roundness) * (1 - math.sqrt(0.5))

    @property
    def front(self) -> float:
        """y of the line on which front legs and posts stand: there the outline has its front corners."""
        return -self.corner * self.depth / 2

    @property
    def rear(self) -> float:
        """y of the line on which the back stands."""
        return self.corner * self.depth / 2

    def scale(self, y: float) -> float:
        """Width at y beside that of the front edge, by the taper."""
        return 1 + (self.taper - 1) * (y / self.depth + 0.5)

    def half_width(self, y: float) -> float:
        """x of the outline at y."""
        share = 0.01 + 0.98 * self.roundness
        beyond = max(abs(y) / (self.depth / 2) - 1 + share, 0.0) / share
        return self.width / 2 * self.scale(y) * (1 - share + share * math.sqrt(max(1 - beyond * beyond, 0.0)))

    def corner_width(self, y: float) -> float:
        """x that the outline reaches everywhere between its corners, at y."""
        return self.corner * self.width / 2 * self.scale(y)

    def outline(self) -> np.ndarray:
        """(n, 2), counter-clockwise from above."""
        outline = rounded(self.width, self.depth, self.roundness)
        outline[:, 0] *= 1 + (self.taper - 1) * (outline[:, 1] / self.depth + 0.5)
        return outline

    def slab(self) -> Part:
        """The seat itself."""
        outline = self.outline()
        rings = np.empty((2, len(outline), 3))
        rings[:, :, :2] = outline
        for ring, plane in zip(rings, (self.under, self.top), strict=True):
            ring[:, 2] = plane.z + plane.slope * outline[:, 1]
        return loft("seat", rings, convex=True)

    def cushion(self, thickness: float, beside: float = 0.0) -> Part:
        """A domed cushion on top of the slab, a little smaller, pressed into it a hair; `beside`: width that arms take
        at each side.
        """
        outline = self.outline()
        outline[:, 0] *= 1 - 2 * beside / (self.width * min(self.taper, 1))
        rings = np.empty((len(_CUSHION), len(outline), 3))
        rings[:, :, :2] = _CUSHION[:, 1, None, None] * outline
        height = thickness * _CUSHION[:, 0]
        height[0] = -min(0.05 * thickness, 0.3 * (self.top.z - self.under.z))
        rings[:, :, 2] = self.top.z + self.top.slope * rings[:, :, 1] + height[:, None]
        return loft("seat cushion", rings, convex=True)
