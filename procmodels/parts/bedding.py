"""What lies on a bed's deck: mattress, pillows, bedclothes that hang down over its edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels.parts.cushions import pillow
from procmodels.parts.primitives import box, sheet
from procmodels.shape import Part

PILLOW = (0.36, 0.19, 0.06)  # width, depth and thickness, where there is room
CLOTH = 0.012  # thickness of bedclothes
CLEAR = 0.004  # between them and the frame that they hang over
SHOULDER = 0.02  # width of the turn at their upper edges
OFF_FLOOR = 0.006


@dataclass(frozen=True)
class Mattress:
    """A mattress from x = right to left, y = front to rear, z = low to top."""

    right: float
    left: float
    front: float
    rear: float
    low: float
    top: float

    @property
    def width(self) -> float:
        return self.left - self.right

    def part(self, name: str) -> Part:
        bevel = 0.25 * min(self.top - self.low, 0.5 * self.width)
        return box(name, (self.right, self.front, self.low), (self.left, self.rear, self.top), bevel=bevel)


def pillows(count: int, mattress: Mattress, name: str = "pillow") -> list[Part]:
    """Pillows on the mattress at its rear end: one, two side by side, further ones in a second row."""
    width, depth, thickness = PILLOW
    depth = min(depth, 0.3 * (mattress.rear - mattress.front))
    parts: list[Part] = []
    y = mattress.rear - 0.01
    for row in _rows(count):
        room = mattress.width / row
        # One alone may be a bolster.
        wide = 0.84 * room if row == 1 and count == 1 else min(width, 0.84 * room)
        for i in range(row):
            x = mattress.right + (i + 0.5) * room
            place = (x, y - depth / 2, mattress.top)
            parts.append(pillow(f"{name} {len(parts) + 1}", place, wide, depth, thickness))
        y -= 1.02 * depth
    return parts


def before_pillows(count: int, mattress: Mattress) -> float:
    """y that pillows leave free."""
    depth = min(PILLOW[1], 0.3 * (mattress.rear - mattress.front))
    return mattress.rear - 0.015 - 1.02 * depth * len(_rows(count))


def _rows(count: int) -> list[int]:
    """Pillows in each row, from the head."""
    return [n for n in (min(count, 2), count - 2) if n > 0]


@dataclass(frozen=True)
class Clothes:
    """A cover over a mattress up to y = rear, which hangs down over the edges of its frame.

    hang    how far, of the height of the mattress's top
    spread  how far its lower edge stands out
    side    x of the frame's side, and its height there; foot: y of the frame's foot and its height, None where a
            higher one holds the cover within
    """

    rear: float
    hang: float
    spread: float
    side: tuple[float, float]
    foot: tuple[float, float] | None

    def part(self, mattress: Mattress) -> Part:
        """The cover."""
        half, rise = mattress.width / 2, np.array([[mattress.top], [mattress.top + CLOTH]])
        across, drop = self._profile(mattress.top, self.side[0] - half, self.side[1])
        x = np.concatenate([-half - across, np.zeros((2, 1)), half + across[:, ::-1]], 1)
        z = np.concatenate([drop, rise, drop[:, ::-1]], 1)
        if self.foot:
            out, fall = self._profile(mattress.top, mattress.front - self.foot[0], self.foot[1])
            y = np.concatenate([mattress.front - out, np.full((2, 1), self.rear)], 1)
            down = np.concatenate([fall, rise], 1)
        else:
            y, down = np.array([[mattress.front, self.rear]] * 2), np.concatenate([rise, rise], 1)
        faces = [
            np.stack(np.broadcast_arrays(x[i], y[i][:, None], np.minimum(z[i], down[i][:, None])), -1) for i in (1, 0)
        ]
        return sheet("bedclothes", *faces)

    def _profile(self, top: float, wider: float, frame: float) -> tuple[np.ndarray, np.ndarray]:
        """Of what hangs over an edge, from its lower end to the top: places outwards from the mattress and heights,
        each (2, 4): of the inner face and of the outer one.

        wider  how much farther out the frame below z = frame reaches
        """
        end = (1 - self.hang) * top + self.hang * OFF_FLOOR
        bend = frame if end < frame else (top + end) / 2
        out = (max(wider, 0.0) + CLEAR) * (top - np.array([end, bend])) / (top - frame)
        out = np.minimum(out, max(wider, 0.0) + CLEAR) + self.spread * (top - np.array([end, bend])) / top
        inner = np.array([*out, 0.0, -SHOULDER])
        heights = np.array([[end, bend, top, top], [end, bend, top, top + CLOTH]])
        return np.stack([inner, inner + np.array([CLOTH, CLOTH, CLOTH, 0.0])]), heights
