"""Where things of a sofa lie, seen from above: the straight part, and perhaps a corner part before its left end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels.parts.sofa_bases import Foot

Area = tuple[float, float, float, float]  # x, x, y, y

JOINT = 0.006  # between neighbouring cushions
EDGE = 0.02  # from a leg to the sides


@dataclass(frozen=True)
class Plan:
    """Lengths in the model's units.

    half         half the width, over the arms
    front, rear  y of the ends of the straight part; wall: thickness of its back, 0 none
    right, left  thickness of the arms along the sides, 0 none; arm_front: y of their front ends
    corner       x of the right side of the corner part and y of its front end, if there is one
    side         thickness of the wall along its left side, 0 none: then `left` is the arm across its front end
    cut          how far legs at the rear stand in from the corners, which are round
    """

    half: float
    front: float
    rear: float
    wall: float
    right: float
    left: float
    arm_front: float
    corner: tuple[float, float] | None = None
    side: float = 0.0
    cut: float = 0.0

    @property
    def x_right(self) -> float:
        """Where the seat begins."""
        return self.right - self.half

    @property
    def x_left(self) -> float:
        """Where the straight part's seat ends."""
        return self.half - (self.side or self.left)

    @property
    def x_seats(self) -> float:
        """Where the seats before the corner part end."""
        return self.corner[0] if self.corner else self.x_left

    @property
    def y_back(self) -> float:
        """The face of the back, where it stands on the seat."""
        return self.rear - self.wall

    @property
    def end(self) -> float:
        """Thickness of the arm across the front end of the corner part."""
        return self.left if self.side else 0.0

    def areas(self) -> list[Area]:
        """Of the base: the straight part and the corner part."""
        areas = [(self.x_right, self.x_left, self.front, self.y_back)]
        if self.corner:
            x, y = self.corner
            areas.append((x, self.half - self.side, y + self.end, self.front))
        return areas

    def outer_areas(self) -> list[Area]:
        """The same with arms and backs."""
        areas = [(-self.half, self.half, self.front, self.rear)]
        return areas + ([(self.corner[0], self.half, self.corner[1], self.front)] if self.corner else [])

    def seats(self, count: int) -> list[Area]:
        """Seat cushions: side by side, then those of the corner part."""
        x = np.linspace(self.x_right, self.x_seats, count + 1)
        rows = [(float(a), float(b), self.front, self.y_back) for a, b in zip(x, x[1:], strict=False)]
        if self.corner:
            rows.append((self.corner[0], self.x_left, self.front, self.y_back))
            rows += self.areas()[1:]
        return [_apart(r) for r in rows]

    def backs(self, count: int, thickness: float) -> list[Area]:
        """Back cushions along the straight part, from right to left."""
        x = np.linspace(self.x_right, self.x_left, count + 1)
        y = (self.y_back - thickness, self.y_back)
        return [_apart((float(a), float(b), *y), JOINT, 0.0) for a, b in zip(x, x[1:], strict=False)]

    def side_backs(self, count: int, before: float, thickness: float) -> list[Area]:
        """Back cushions so thick along the corner part's wall, about as wide as `count` of the straight part's, which
        are thick by `before`."""
        if not self.side or not self.corner:
            return []
        start, stop = self.corner[1] + self.end, self.y_back - before
        number = max(1, round((stop - start) / (self.x_left - self.x_right) * count))
        y = np.linspace(start, stop, number + 1)
        x = (self.x_left - thickness, self.x_left)
        return [_apart((*x, float(a), float(b)), 0.0, JOINT) for a, b in zip(y, y[1:], strict=False)]

    def feet(self, size: float, waist: float) -> list[Foot]:
        """Legs near the corners, below arms where there are some; waist: how much thinner arms are at the bottom."""
        gap = size / 2 + EDGE
        feet = []
        for side, sign, arm in (("right", -1, self.right), ("left", 1, 0.0 if self.side else self.left)):
            x = sign * (self.half - waist * arm - gap)
            front = max(self.arm_front, self.front) if arm else self.front
            feet.append(Foot(f"rear {side}", x - sign * self.cut, self.rear - gap - self.cut, (sign, 1)))
            if side == "right" or not self.corner:
                feet.append(Foot(f"front {side}", x, front + gap, (sign, -1)))
        if self.corner:
            y = self.corner[1] + waist * self.end + gap
            feet.append(Foot("front left", self.half - gap, y, (1, -1)))
            feet.append(Foot("front middle", self.corner[0] + gap, y, (-1, -1)))
        return feet


def _apart(area: Area, dx: float = JOINT, dy: float = 0.0) -> Area:
    """The area, smaller where it has neighbours."""
    x0, x1, y0, y1 = area
    return x0 + dx / 2, x1 - dx / 2, y0 + dy / 2, y1 - dy / 2
