"""What is in a part of a case: boards and dividers where it is open, fronts of doors and drawers where it is closed."""

from __future__ import annotations

from dataclasses import dataclass

from procmodels.parts import fronts
from procmodels.parts.cases import BOARD, Span, levels
from procmodels.parts.primitives import box
from procmodels.parts.sizes import limited
from procmodels.shape import Part

STAGGER = 0.3  # of the lesser bay beside it: how far an alternating divider stands off its place


@dataclass(frozen=True)
class Field:
    """What fronts cover, and how.

    half    half its width; z: its heights; face: y of the fronts' outer faces
    rows    heights of fronts above each other, from the lowest, relative; leaves: fronts beside each other in a bay
    gap     between two fronts
    """

    half: float
    z: Span
    face: float
    rows: list[float]
    leaves: int
    gap: float


@dataclass(frozen=True)
class Bays:
    """Bays beside each other in a part of a case.

    name     before the parts' names: "" or "lower "
    x, z     the room between sides, and between boards
    y        the front edges of the case and the rear of its boards
    columns  widths of the bays, relative
    rows     heights of the openings from the lowest, relative
    board    thickness of boards and dividers
    """

    name: str
    x: Span
    y: Span
    z: Span
    columns: list[float]
    rows: list[float]
    board: float

    @property
    def divider(self) -> float:
        """Thickness of dividers."""
        return limited(self.board, 0.4 * (self.x[1] - self.x[0]) / len(self.columns), BOARD)

    def bays(self) -> list[Span]:
        """x of each bay."""
        return levels(self.x, self.columns, self.divider)

    def open(self, divider: str, recess: float) -> list[Part]:
        """Boards from side to side and dividers between them: filled, posts at the front, or alternating.

        recess  how far both lie behind the case's front edges
        """
        y = (self.y[0] + recess, self.y[1])
        gaps, parts = levels(self.z, self.rows, self.board), self._boards(f"{self.name}board", self.x, y)
        deep = y[1] if divider != "posts" else min(y[0] + self.divider, y[1])
        bays = self.bays()
        for i, (left, right) in enumerate(zip(bays, bays[1:], strict=False)):
            off = STAGGER * min(left[1] - left[0], right[1] - right[0]) if divider == "alternating" else 0.0
            for j, (low, high) in enumerate(gaps):
                move = off if j % 2 else -off
                name = f"{self.name}divider {i + 1} row {j + 1}"
                parts.append(box(name, (left[1] + move, y[0], low), (right[0] + move, deep, high)))
        return parts

    def closed(self, field: Field, open_bays: str) -> list[Part]:
        """Dividers, and fronts before every bay but for those that are open: "inner", "outer" or "none"."""
        bays, y, parts = self.bays(), (field.face, self.y[0]), []
        pairs = list(zip(bays, bays[1:], strict=False))
        for i, (left, right) in enumerate(pairs):
            low, high = (left[1], self.y[0], self.z[0]), (right[0], self.y[1], self.z[1])
            parts.append(box(f"{self.name}divider {i + 1}", low, high))
        edges = [-field.half, *((a[1] + b[0]) / 2 for a, b in pairs), field.half]
        for i, bay in enumerate(bays):
            if open_bays == ("outer" if i in (0, len(bays) - 1) else "inner"):
                parts += self._boards(f"{self.name}board {i + 1}", bay, self.y)
            else:
                name, x = f"{self.name}{{}} {i + 1}", (edges[i], edges[i + 1])
                parts += fronts.grid(name, x, levels(field.z, field.rows, 0.0), y, field.leaves, field.gap)
        return parts

    def _boards(self, name: str, x: Span, y: Span) -> list[Part]:
        """Boards between the openings, numbered from below."""
        gaps = levels(self.z, self.rows, self.board)
        return [
            box(f"{name} {i + 1}", (x[0], y[0], below[1]), (x[1], y[1], above[0]))
            for i, (below, above) in enumerate(zip(gaps, gaps[1:], strict=False))
        ]
