"""Backs and arms of sofas: walls that roll over, flare and lean, open arms, a wall that goes all round (a tub).

All are of the left side, the sitter's, at +X; fronts look to -Y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels.parts.primitives import box, loft, sheet
from procmodels.shape import Part

WAIST = 0.45  # how much thinner a rolled arm is below its roll
CHORD = 0.12  # half width of a roll's top, of its radius
# Heights of an arm's sections round its roll, of its radius from its middle.
_ROLL = np.array([-0.995, -0.8, -0.4, 0.0, 0.45, 0.75, 0.93, 1.0])


@dataclass(frozen=True)
class Arm:
    """An arm along Y; lengths in the model's units.

    inner, width  x of its face towards the seat, and its thickness
    front, rear   y of its ends
    low, top      z of its ends; seat: z from where it flares, and falls to the front
    roll          0: a board; 1: a scroll along its top over a thinner board
    flare         how far it leans outwards for every unit of height over the seat; lean: its rear end, backwards
    fall          how much lower its front is, of the height over the seat
    """

    inner: float
    width: float
    front: float
    rear: float
    low: float
    top: float
    seat: float
    roll: float = 0.0
    flare: float = 0.0
    lean: float = 0.0
    fall: float = 0.0

    @property
    def foot(self) -> float:
        """x of its outer face at the bottom."""
        return self.inner + self.width * (1 - WAIST * self.roll)

    def wall(self, name: str) -> Part:
        """The arm as one body."""
        # Flatter than round where there is little height over the seat.
        radius, half = min(self.width / 2, 0.4 * (self.top - self.seat)), self.width / 2
        z = np.concatenate([[self.low, self.seat], self.top - radius + radius * _ROLL])
        chord = half * np.sqrt(np.maximum(1 - _ROLL * _ROLL, CHORD * CHORD))
        upper, centre = _ROLL > 0, self.inner + half
        outer = np.where(upper, centre + chord, np.maximum(centre + chord, self.foot))
        outer = (1 - self.roll) * (self.inner + self.width) + self.roll * outer
        inner = self.inner + self.roll * np.where(upper, half - chord, 0.0)
        inner, outer = np.concatenate([[self.inner] * 2, inner]), np.concatenate([[self.foot] * 2, outer])
        plain = not (self.roll or self.flare or self.lean or self.fall)
        return loft(name, self._rings(inner, outer, z), convex=plain)

    def _rings(self, inner: np.ndarray, outer: np.ndarray, z: np.ndarray) -> np.ndarray:
        """(n, 4, 3) level sections between two faces, flared, leant and let down to the front."""
        over = np.maximum(z - self.seat, 0)
        rings = np.empty((len(z), 4, 3))
        rings[:, :, 0] = np.stack([inner, outer, outer, inner], 1) + self.flare * over[:, None]
        rings[:, :2, 1] = self.front
        rings[:, 2:, 1] = (self.rear + self.lean * over)[:, None]
        rings[:, :, 2] = z[:, None]
        rings[:, :2, 2] -= self.fall * over[:, None]
        return rings

    def open(self, name: str, post: float) -> list[Part]:
        """The arm as a rail on two posts so thick along Y."""
        x0, x1 = self.inner, self.inner + self.width
        height = min(0.6 * self.width, 0.3 * (self.top - self.low))
        post = min(post, 0.3 * (self.rear - self.front))
        low = self.top - height
        parts = [box(f"{name} rail", (x0, self.front, low), (x1, self.rear, self.top))]
        for end, y in (("front", self.front), ("rear", self.rear - post)):
            parts.append(box(f"{name} post {end}", (x0, y, self.low), (x1, y + post, low)))
        return parts


@dataclass(frozen=True)
class Tub:
    """A wall round a seat from one arm over the back to the other, its rear corners round.

    half, rear      of the outside: half its width, y of its rear
    side, wall      thickness of its arms and of its back
    front           y of the arms' ends
    radius          of the corners
    low, seat       z of its lower edge, and from where it leans
    arm             z of the arms; the back ends at 1
    lean            of the back, backwards for every unit of height
    """

    half: float
    rear: float
    side: float
    wall: float
    front: float
    radius: float
    low: float
    seat: float
    arm: float
    lean: float

    def path(self, inside: bool) -> np.ndarray:
        """(n, 2) places from the right arm's front end round the back to the left's."""
        half, rear = (self.half - self.side, self.rear - self.wall) if inside else (self.half, self.rear)
        rx, ry = self.radius, self.radius
        if inside:
            rx, ry = (max(self.radius - t, 0.15 * self.radius) for t in (self.side, self.wall))
            rx, ry = min(rx, 0.98 * half), min(ry, 0.98 * (rear - self.front))
        turn = np.linspace(0, np.pi / 2, 7)
        corner = np.stack([half - rx + rx * np.cos(turn), rear - ry + ry * np.sin(turn)], 1)
        middle = (self.front + corner[0, 1]) / 2
        left = np.concatenate([[(half, self.front), (half, middle)], corner, [(0.0, rear)]])
        return np.concatenate([left * (-1, 1), left[-2::-1]])

    def part(self) -> Part:
        """The wall."""
        n = 10
        rise = np.concatenate([[0, 0], _smooth(np.linspace(0, 1, 7)), [1]])
        rise = np.concatenate([rise, rise[n - 2 :: -1]])
        top = self.arm + (1 - self.arm) * rise
        z = np.stack([np.full_like(top, self.low), np.full_like(top, self.seat), top])
        faces = []
        for inside in (True, False):
            x, y = self.path(inside).T
            back = self.lean * rise * np.maximum(z - self.seat, 0)
            faces.append(np.stack([np.broadcast_to(x, z.shape), y + back, z], -1))
        return sheet("back", *faces)

    def floor(self, front: float) -> np.ndarray:
        """(n, 2) outline of the room within, up to y = front, counter-clockwise from above."""
        path = self.path(True)[::-1]
        x = path[0, 0]
        start = [(-x, front), (x, front)] if front < self.front - 1e-6 else []
        return np.concatenate([np.reshape(start, (-1, 2)), path])

    def room(self) -> tuple[float, float]:
        """y of what pillows lean on, and how far from the middle they may stand."""
        path = self.path(True)[len(self.path(True)) // 2 :]
        x = 0.6 * (self.half - self.side)
        return float(np.interp(x, path[:10, 0], path[:10, 1])), x


def _smooth(share: np.ndarray) -> np.ndarray:
    return share * share * (3 - 2 * share)


def back(name: str, ends: tuple[float, float], front: float, rear: float, low: float, seat: float, lean: float) -> Part:
    """A board from x to x and y to y up to z = 1 that leans backwards over the seat's height."""
    z = np.array([low, seat, 1.0])[:, None] + np.zeros(2)
    x = np.array(ends) + np.zeros((3, 1))
    shift = lean * np.maximum(z - seat, 0)
    near, far = (np.stack([x, y + shift, z], -1) for y in (front, rear))
    return sheet(name, near, far, convex=not lean)
