"""Arms of chairs, both sides alike: posts with a rail, pads on a post, boards, walls that go on from the back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels.parts.backs import Back
from procmodels.parts.boards import Side, side_boards
from procmodels.parts.legs import both
from procmodels.parts.primitives import Plane, beam, box, sheet, upright
from procmodels.parts.seats import Seat
from procmodels.shape import Part


@dataclass(frozen=True)
class Arms:
    """top: z of the arms; size: their width; front: y of their front end; seat: z of the seat there."""

    top: float
    size: float
    front: float
    seat: float

    def height(self, share: float) -> float:
        """Of a rail or pad: a share of its width, where there is room above the seat."""
        return min(share * self.size, 0.6 * (self.top - self.seat))


def posts(arms: Arms, seat: Seat, back: Back) -> list[Part]:
    """A post at the front of each side, and a rail from it to the side of the back."""
    bar = arms.height(0.7)
    x = seat.corner_width(arms.front) - arms.size / 2
    y = arms.front + bar / 2
    low = arms.top - bar
    # Into the rail, which may slope.
    post = upright("", (x, y), (x, y), (bar, bar), (bar, bar), seat.top, Plane(low + bar / 2))
    u = 1 - back.post / 2
    v = min(back.share(low + bar / 2), float(back.end(np.array(u))) - 0.02)
    end = back.points(np.array(u), np.array(v), back.thickness / 2)
    start, end[2] = (x, arms.front, low + bar / 2), min(end[2], low + bar / 2)
    rail = beam("", start, tuple(end), (bar, arms.size), (bar, min(arms.size, end[0])), cut="Y")
    return both("arm post {}", post) + both("armrest {}", rail)


def pads(arms: Arms, seat: Seat, back: Back) -> list[Part]:
    """A pad on one post at each side."""
    length = 0.6 * (back.side - arms.front)
    height, post = arms.height(0.6), min(0.5 * arms.size, 0.2 * length)
    rear = arms.front + length
    x = min(seat.corner_width(arms.front), seat.corner_width(rear)) - arms.size / 2
    y = arms.front + 0.6 * length
    low = arms.top - height
    stem = upright("", (x, y), (x, y), (post, 1.4 * post), (post, 1.4 * post), seat.top, Plane(low))
    pad = box("", (x - arms.size / 2, arms.front, low), (x + arms.size / 2, rear, arms.top))
    return both("arm post {}", stem) + both("armrest {}", pad)


def boards(arms: Arms, side: Side, back: Back) -> list[Part]:
    """A board at each side on the seat, its rear edge following the back."""
    v = min(back.share(arms.top), 1.0)
    rear = float(back.profile(np.array(v))[0]) + back.thickness / 2
    return side_boards("arm panel {}", side, arms.size, back.floor, Plane(arms.top), rear)


def walls(arms: Arms, seat: Seat, back: Back) -> list[Part]:
    """Walls along the edge of the seat, from the side of the back to the front, falling to the arms' height."""
    share = np.linspace(0, 1, 7)
    u, v = np.array(1.0), float(back.end(np.array(1.0)))
    start, end = back.points(u, np.array([0.0, v]), back.thickness / 2)
    thick = 1 / (2 / arms.size + 1 / start[0])  # thinner than the room beside the middle
    y = arms.front + (start[1] - arms.front) * share
    rise = share**2
    edge = np.array([seat.half_width(float(t)) for t in y])
    top = arms.top + (end[2] - arms.top) * rise
    lean = (end[1] - start[1]) * rise
    floor = seat.top.z + seat.top.slope * y
    low, high = (
        np.stack([edge + (place[0] - edge) * rise, y + dy, z], -1)
        for place, dy, z in ((start, 0, floor), (end, lean, top))
    )
    face = np.stack([low, (low + high) / 2, high])
    return both("arm wall {}", sheet("", face, face - np.array([thick, 0, 0])))
