"""Ends and sides of beds: upright boards, or frames with bars, whose upper edge may be arched and rounded, and lean.

A place is (x, z) seen from the front and an offset from the face towards the mattress, away from it, a length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procmodels.parts.primitives import box, loft, sheet
from procmodels.shape import Part

SHARPEST = 0.02  # radius of a square corner, of that of the roundest
MIDDLE = np.array([-2, -1, 0, 1, 2]) / 3  # columns between the corners
THIN = 0.6  # of the thickness: rails and bars within a frame


@dataclass(frozen=True)
class Head:
    """An upright end of a bed, its middle at x = 0; lengths in the model's units.

    width      from side to side
    inner      y of the face towards the mattress, below the deck
    away       1: the mattress lies before it (the head); -1: behind it (the foot)
    thickness  along Y
    low        z of its lower edge; rail: z of the lower edge of the rail that it ends the deck with
    deck       z of the bed's deck, from where it leans and is counted
    top        z of its highest place
    slope      how far it leans away from the mattress, of the height above the deck
    arch       how much lower its sides are than its middle, of that height
    roundness  of its upper corners, 0 square
    post       width of its posts
    """

    width: float
    inner: float
    away: int
    thickness: float
    low: float
    rail: float
    deck: float
    top: float
    slope: float = 0.0
    arch: float = 0.0
    roundness: float = 0.0
    post: float = 0.0

    @property
    def half(self) -> float:
        return self.width / 2

    @property
    def height(self) -> float:
        """Above the deck."""
        return self.top - self.deck

    @cached_property
    def radius(self) -> float:
        """Of the upper corners."""
        most = min(0.98 * self.half, 0.8 * self.height * (1 - self.arch))
        return most * (SHARPEST + (1 - SHARPEST) * self.roundness)

    @cached_property
    def side(self) -> float:
        """Width of posts where there is room between them."""
        return min(self.post, 0.3 * self.half)

    @cached_property
    def upper(self) -> float:
        """Height of the rail along the top, where there is room."""
        return min(self.side, 0.3 * self.height * (1 - self.arch))

    def edge(self, x: np.ndarray) -> np.ndarray:
        """z of the upper edge at x."""
        beyond = np.clip(np.abs(x) - self.half + self.radius, 0, self.radius)
        corner = self.radius - np.sqrt(np.maximum(self.radius**2 - beyond * beyond, 0))
        return self.top - self.arch * self.height * (x / self.half) ** 2 - corner

    def reach(self, z: np.ndarray) -> np.ndarray:
        """How far from the middle a bar may go at height z: to the middle of the post or of the rail along the top."""
        x = np.linspace(0, self.half - self.side / 2, 24)
        return np.interp(-z, -(self.edge(x) - self.upper / 2), x)

    def points(self, x: np.ndarray, z: np.ndarray, offset: np.ndarray | float) -> np.ndarray:
        """(..., 3) of places."""
        back = offset + self.slope * np.maximum(z - self.deck, 0)
        return np.stack(np.broadcast_arrays(x, self.inner + self.away * back, z), -1)

    def sheet(self, name: str, x: np.ndarray, z: np.ndarray, near: float, far: float) -> Part:
        """A body over a grid of places between two offsets, in thicknesses."""
        front, back = (self.points(x, z, self.thickness * o) for o in (near, far)[:: self.away])
        return sheet(name, front, back, convex=not self.slope)


def build(kind: str, name: str, head: Head, bars: int, fill: float) -> list[Part]:
    """The parts of a head: panel, vbars or hbars; `fill`: the share of its room that a bar takes."""
    if kind == "panel":
        return [_panel(f"{name}board", head)]
    within = _upright_bars if kind == "vbars" else _level_bars
    return [*_frame(name, head), *within(f"{name} bar", head, bars, fill)]


def _panel(name: str, head: Head) -> Part:
    turn = np.sin(np.linspace(0, np.pi / 2, 5))
    outer = head.half - head.radius + head.radius * turn
    x = np.concatenate([-outer[::-1], (head.half - head.radius) * MIDDLE, outer])
    z = np.stack([np.full_like(x, head.low), np.full_like(x, head.deck), head.edge(x)])
    return head.sheet(name, x, z, 0.0, 1.0)


def _frame(name: str, head: Head) -> list[Part]:
    """Two posts joined along the top, in one piece, and the rail at the end of the deck."""
    turn = np.linspace(0, np.pi / 2, 5)
    edges = []
    for inset_x, inset_z in ((0.0, 0.0), (head.side, head.upper)):  # the outer edge, the inner edge
        radius_x, radius_z = max(head.radius, 1.02 * inset_x), max(head.radius, 1.02 * inset_z)
        # The corner as it is without an arch; then all of the upper edge comes down by it.
        start = head.half - radius_x
        x = -start - (radius_x - inset_x) * np.cos(turn)
        z = head.top - radius_z + (radius_z - inset_z) * np.sin(turn)
        x = np.concatenate([[x[0], x[0]], x, start * MIDDLE[:3]])
        z = np.concatenate([[head.low, head.deck], z, np.full(3, head.top - inset_z)])
        z[2:] -= head.arch * head.height * (x[2:] / head.half) ** 2
        edges.append((np.concatenate([x, -x[-2::-1]]), np.concatenate([z, z[-2::-1]])))
    (x0, z0), (x1, z1) = edges
    x, z = np.stack([x0, x1, x1, x0], 1), np.stack([z0, z1, z1, z0], 1)
    offset = head.thickness * np.array([0.0, 0, 1, 1])[:: head.away]
    y = np.sort([head.inner + head.away * head.thickness * o for o in (0.0, 0.5 + THIN / 2)])
    inner = head.half - head.side / 2
    rail = box(f"{name} rail", (-inner, y[0], head.rail), (inner, y[1], head.deck))
    return [loft(f"{name} frame", head.points(x, z, offset)), rail]


def _upright_bars(name: str, head: Head, count: int, fill: float) -> list[Part]:
    """Bars from the deck's end to the rail along the top."""
    room = 2 * (head.half - head.side) / count
    middle = room * (np.arange(count) - (count - 1) / 2)
    x = middle[:, None, None] + fill * room / 2 * np.array([-1, 1])
    x = np.clip(x, head.side - head.half, head.half - head.side)
    share = np.array([0.0, 1.0])[:, None]
    z = head.deck + share * (head.edge(x) - head.upper / 2 - head.deck)
    return [_bar(f"{name} {i + 1}", head, *place) for i, place in enumerate(zip(x + 0 * z, z, strict=True))]


def _level_bars(name: str, head: Head, count: int, fill: float) -> list[Part]:
    """Bars from side to side."""
    low = np.array([head.deck, float(head.edge(np.zeros(1))[0]) - head.upper])
    room = (low[1] - low[0]) / count
    middle = low[0] + room * (np.arange(count) + 0.5)
    z = middle[:, None, None] + fill * room / 2 * np.array([-1, 1])[:, None]
    x = head.reach(z[:, 1:]) * np.array([-1, 1])
    return [_bar(f"{name} {i + 1}", head, *place) for i, place in enumerate(zip(x + 0 * z, z + 0 * x, strict=True))]


def _bar(name: str, head: Head, x: np.ndarray, z: np.ndarray) -> Part:
    part = head.sheet(name, x, z, 0.5 - THIN / 2, 0.5 + THIN / 2)
    return Part(name, part.vertices, part.faces, convex=True)


def turned(parts: list[Part], middle: float) -> list[Part]:
    """Parts of a head as a side at the left: what leant to the rear leans outwards; its middle is at y = middle."""
    moved = []
    for p in parts:
        x, y, z = p.vertices.T
        moved.append(Part(p.name, np.stack([y, middle - x, z], 1), p.faces, p.convex))
    return moved
