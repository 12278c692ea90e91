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
FLARE = 0.012  # how far their lower edge stands out
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
    parts, y = [], mattress.rear - 0.01
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


def bedclothes(mattress: Mattress, rear: float, outside: float, deck: float, hang: float, over_foot: bool) -> Part:
    """A cover over the mattress up to y = rear, which hangs down its sides.

    outside    half the width of the frame that it hangs over below z = deck
    hang       how far, of the height of the mattress's top
    over_foot  it hangs over the foot as well; else it ends there
    """
    end = (1 - hang) * mattress.top + hang * OFF_FLOOR
    half = mattress.width / 2
    across, drop = _profile(half, outside - half, mattress.top, deck, end)
    middle = np.zeros((2, 1))
    rise = np.array([[mattress.top], [mattress.top + CLOTH]])
    x = np.concatenate([-across, middle, across[:, ::-1]], 1)
    z = np.concatenate([drop, rise, drop[:, ::-1]], 1)
    if over_foot:
        out, fall = _profile(0.0, 0.0, mattress.top, deck, end)
        y = np.concatenate([mattress.front - out, np.full((2, 1), rear)], 1)
        down = np.concatenate([fall, rise], 1)
    else:
        y = np.array([[mattress.front, rear]] * 2)
        down = np.concatenate([rise, rise], 1)
    sheets = [
        np.stack(np.broadcast_arrays(x[i], y[i][:, None], np.minimum(z[i], down[i][:, None])), -1) for i in (1, 0)
    ]
    return sheet("bedclothes", *sheets)


def _profile(half: float, wider: float, top: float, deck: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Of what hangs over an edge, from its lower end to the top: places outwards and heights, each (2, 4): of the inner
    face and of the outer one.

    half  from the middle to the mattress's edge; wider: how much farther out the frame below z = deck reaches
    """
    out = max(wider, 0.0) + CLEAR
    below = end < deck
    bend = deck if below else (top + end) / 2

    def at(z: float) -> float:
        """How far out the cloth hangs at z."""
        return out * min(1.0, (top - z) / (top - deck))

    flare = FLARE * (top - end) / top
    inner = np.array([at(end) + flare, at(bend) + 0.3 * flare, 0.0, -SHOULDER])
    heights = np.array([[end, bend, top, top], [end, bend, top, top + CLOTH]])
    return half + np.stack([inner, inner + np.array([CLOTH, CLOTH, CLOTH, 0.0])]), heights
