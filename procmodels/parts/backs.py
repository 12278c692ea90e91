"""Backs of seats: what is built into a surface that leans, bends towards the top and wraps round the sitter.

A place on the surface is (u, v, offset): u from -1 (right) to 1 (left) across, v from 0 (the seat) to 1 (the top) up,
and an offset from the face that the sitter leans on, towards the rear, a length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procmodels.parts.primitives import Plane, loft, sheet
from procmodels.shape import Part

ROWS = 5
MIDDLE = np.array([-2, -1, 0, 1, 2]) / 3  # columns between the corners
# The same of a frame, to its middle, and its rows: thin bars would hang free beside a coarse arc or bend.
ACROSS, UP = np.arange(-5, 1) / 6, np.linspace(0, 1, 9)
TURN = np.cos(np.linspace(0, np.pi / 2, 4)), np.sin(np.linspace(0, np.pi / 2, 4))  # a quarter of a circle
LEAST = 0.01  # a lower gap is none, in shares of the back's height


@dataclass(frozen=True)
class Back:
    """The surface of a back; lengths in the model's units, angles in degrees.

    width      from side to side, of its rear, on the seat; flare: how much wider its upper end is, as a share
    foot       y of the middle of its rear edge on the seat
    floor      the plane of the seat that it stands on
    top        z of its upper end
    rake       from upright, of its lower half; bend: how much more the upper end leans, growing from the middle
    wrap       how far the sides come forward beside the middle
    thickness  at right angles to the surface
    gap        from the seat to its lower edge, of its height
    roundness  of its upper corners: 0 square, 1 a hoop
    top_rail   height of a frame's upper rail, of its height above the gap
    """

    width: float
    foot: float
    floor: Plane
    top: float
    rake: float
    bend: float
    wrap: float
    thickness: float
    gap: float
    roundness: float
    top_rail: float
    flare: float

    @property
    def height(self) -> float:
        """From the seat to the top."""
        return self.top - self.floor.at(self.foot)

    def share(self, z: float) -> float:
        """v of a height in the middle of the back."""
        return 1 - (self.top - z) / self.height

    @cached_property
    def arc(self) -> float:
        """Half the angle of the arc in plan, radians: nearly 0 is flat, the most is half a circle."""
        return min(max(2 * math.atan(2 * self.wrap / self.width), 1e-3), math.pi / 2)

    @cached_property
    def post(self) -> float:
        """Width of posts, square where there is room, of half the back's width."""
        return min(2 * self.thickness / self.width, 0.35)

    @cached_property
    def rail(self) -> float:
        """Height of a lower rail, of the back's height."""
        return min(self.thickness / self.height, 0.2 * (1 - self.gap))

    @cached_property
    def upper(self) -> float:
        """The same of the upper rail."""
        return self.top_rail * (1 - self.gap)

    @cached_property
    def corner(self) -> tuple[float, float]:
        """Radii of the upper corners in u and v."""
        u = 0.02 + 0.97 * self.roundness
        return u, min(u * self.width / 2 / self.height, 0.6 * (1 - self.gap))

    def end(self, u: np.ndarray) -> np.ndarray:
        """v of the upper edge at u."""
        radius_u, radius_v = self.corner
        beyond = np.clip((np.abs(u) - 1 + radius_u) / radius_u, 0, 1)
        return 1 - radius_v * (1 - np.sqrt(1 - beyond * beyond))

    @cached_property
    def lean(self) -> float:
        """How far the lower half goes backwards for every unit of height."""
        return math.tan(math.radians(self.rake))

    @cached_property
    def front(self) -> float:
        """y of the middle of the front face on the seat."""
        return self.foot - self.thickness * math.hypot(1, self.lean)

    def profile(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """y of the middle of the front face at v, and how far it goes backwards there for every unit of height."""
        upper = np.maximum(v - 0.5, 0)
        slope = np.tan((self.rake + 2 * self.bend * upper) * (math.pi / 180))
        # The bend is small: half way between its ends the slope is the mean of theirs.
        rise = self.lean * (v - upper) + upper * (self.lean + slope) / 2
        return self.front + self.height * rise, slope

    def points(self, u: np.ndarray, v: np.ndarray, offset: np.ndarray | float) -> np.ndarray:
        """(..., 3) of places on the surface or off it."""
        sin, cos = math.sin(self.arc), math.cos(self.arc)
        # The sides' thickness lies across: it takes from the width of the front.
        room = self.width / 2
        sides = self.thickness * sin / (1 + self.thickness * sin / room)
        half = np.maximum(room - sides * (1 - offset / self.thickness), 0.3 * room)
        along, (front, slope) = self.arc * u, self.profile(v)
        across = np.cos(along)
        forward, deep = self.wrap / (1 - cos) * (1 - across), offset * across
        # The lower end follows the seat.
        start = self.front - forward + deep * math.hypot(1, self.lean)
        low = self.floor.z + self.floor.slope * start
        x = half * (1 + self.flare * v) * np.sin(along) / sin
        y = front - forward + deep * np.sqrt(1 + slope * slope)
        out = np.empty((*np.broadcast_shapes(x.shape, y.shape), 3))
        out[..., 0], out[..., 1], out[..., 2] = x, y, low + (self.top - low) * v
        return out

    @cached_property
    def side(self) -> float:
        """y of its sides on the seat, the middle of their thickness."""
        return float(self.points(np.array(1.0), np.array(0.0), self.thickness / 2)[1])

    def sheet(self, name: str, u: np.ndarray, v: np.ndarray, low: float = 0.0, high: float = 1.0) -> Part:
        """A body over a grid of places, u and v together (rows, columns); low, high: its faces, in thicknesses."""
        offset = self.thickness * np.array([low, high])[:, None, None]
        front, back = self.points(u, v, offset)
        return sheet(name, front, back)

    def columns(self) -> np.ndarray:
        """(13,) u of columns that lie close where the upper corners are round."""
        turn = np.sin(np.linspace(0, np.pi / 2, 4))
        inner = 1 - self.corner[0]
        side = inner + self.corner[0] * turn
        return np.concatenate([-side[::-1], inner * MIDDLE, side])


def panel(back: Back) -> list[Part]:
    """A board or a cushion from its gap to the top, on two posts where there is a gap."""
    u, low = back.columns(), _lower(back)
    v = low + np.linspace(0, 1, ROWS)[:, None] * (back.end(u) - low)
    parts = [back.sheet("back panel", u, v)]
    if low:
        places = (1 - back.corner[0]) * MIDDLE[[0, -1]]  # where the panel has columns too
        high = low + 0.5 * (back.end(places) - low)
        parts += _strips(back, "back post", places, min(back.post, 0.15) / 2, np.zeros(2), high, (0.3, 0.9))
    return parts


def shell(back: Back, depth: float) -> list[Part]:
    """A sheet that grows out of the seat in a curve; `depth`: of the seat."""
    radius = 0.3 * min(back.height * (1 - back.corner[1]), depth)
    turn = np.linspace(0, np.pi / 2, 4)
    low, forward = radius / back.height * (1 - np.cos(turn)), radius * (1 - np.sin(turn))
    u = back.columns()
    share = np.linspace(0, 1, ROWS)[1:, None]
    v = np.concatenate([np.repeat(low[:, None], len(u), 1), low[-1] + share * (back.end(u) - low[-1])])
    front, rear = back.points(u, v, back.thickness * np.array([0, 1])[:, None, None])
    for face in (front, rear):
        face[:4] -= forward[:, None, None] * (0, 1, back.floor.slope)
    return [sheet("back shell", front, rear)]


def hbars(back: Back, count: int, fill: float) -> list[Part]:
    """Bars from side to side between two posts; `fill`: the share of its room that a bar takes."""
    u, v = np.array([1 - back.post, 1]), UP[:, None]
    parts = [back.sheet(f"back post {side}", np.sort(sign * u), v) for side, sign in (("left", 1), ("right", -1))]
    pitch = (1 - back.gap) / count
    across = np.linspace(-1, 1, 9) * (1 - back.post / 2)
    for i in range(count):
        high = 1 - i * pitch
        rows = np.array([[high - fill * pitch], [high]])
        parts.append(back.sheet(f"back bar {i + 1}", across, rows, 0.15, 0.85))
    return parts


def frame(back: Back) -> list[Part]:
    """Posts joined by a rail along the top, in one piece, and a lower rail where there is a gap."""
    radius_u, radius_v = back.corner
    wide, high = back.post, back.upper
    sides = []
    for inset_u, inset_v in ((0.0, 0.0), (wide, high)):  # the outer edge, the inner edge
        most_u, most_v = max(radius_u, inset_u * 1.02), max(radius_v, inset_v * 1.02)
        u = -1 + most_u - (most_u - inset_u) * TURN[0]
        v = 1 - most_v + (most_v - inset_v) * TURN[1]
        u = np.concatenate([np.full(len(UP) - 1, inset_u - 1), u, (1 - most_u) * ACROSS])
        v = np.concatenate([UP[:-1] * (1 - most_v), v, np.full(len(ACROSS), 1 - inset_v)])
        # The other half mirrors all but the middle.
        sides.append((np.concatenate([u, -u[-2::-1]]), np.concatenate([v, v[-2::-1]])))
    (u0, v0), (u1, v1) = sides
    u, v = np.stack([u0, u1, u1, u0], 1), np.stack([v0, v1, v1, v0], 1)
    parts = [loft("back frame", back.points(u, v, back.thickness * np.array([0.0, 0, 1, 1])))]
    if low := _lower(back):
        across = np.linspace(-1, 1, 9) * (1 - wide / 2)
        rows = np.array([[low], [low + back.rail]])
        parts.append(back.sheet("back rail", across, rows, 0.1, 0.9))
    return parts


def vbars(back: Back, count: int, fill: float) -> list[Part]:
    """Upright bars in a frame; `fill`: the share of its room that a bar takes."""
    inner = 1 - back.post
    u = inner * (2 * (np.arange(count) + 0.5) / count - 1)
    return frame(back) + _strips(back, "back bar", u, fill * inner / count, *_within(back, u), (0.25, 0.75))


def splat(back: Back, fill: float) -> list[Part]:
    """A frame with one board in the middle that is narrower half way up; `fill`: its share of the room at its ends."""
    low, high = (float(v[0]) for v in _within(back, np.zeros(1)))
    share = np.linspace(0, 1, 7)[:, None]
    half = fill * (1 - back.post) * (1 - 0.45 * np.sin(np.pi * share))
    board = back.sheet("back splat", half * np.array([-1, 0, 1]), low + share * (high - low) + np.zeros(3), 0.3, 0.7)
    return [*frame(back), board]


def cross(back: Back, fill: float) -> list[Part]:
    """A frame with two crossed bars, one before the other; `fill`: twice a bar's share of the room at its ends."""
    inner = 1 - back.post / 2
    low, high = (float(v[0]) for v in _within(back, np.array([inner])))
    share = np.linspace(-1, 1, 8)[:, None]
    half = fill / 2 * (1 - back.post) / 2 * np.array([-1, 1])
    v = low + (share + 1) / 2 * (high - low) + np.zeros(2)
    reach = inner - half[1]
    return [
        *frame(back),
        back.sheet("back bar rising", reach * share + half, v, 0.15, 0.5),
        back.sheet("back bar falling", -reach * share + half, v, 0.5, 0.85),
    ]


def cushion(back: Back, thickness: float, low: float) -> Part:
    """A domed cushion before the back, from `low` (a share of its height) to its top, or a frame's rail."""
    u, high = 0.9 * np.linspace(-1, 1, 6), max(0.95, 1 - back.upper / 2)
    v = low + np.linspace(0, 1, 5)[:, None] * (np.minimum(back.end(u), high) - low)
    swell = np.pad(np.ones((3, 4)), 1, constant_values=0.4)
    return sheet("back cushion", back.points(u, v, -thickness * swell), back.points(u, v, np.zeros((5, 6))))


def _lower(back: Back) -> float:
    """The gap, 0 where it is none."""
    return back.gap if back.gap > LEAST else 0.0


def _within(back: Back, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """v of the ends of upright bars at u: within the rails, or on the seat."""
    low = _lower(back)
    return np.full(len(u), low + back.rail / 2 if low else 0.0), back.end(u) - back.upper / 2


def _strips(
    back: Back,
    name: str,
    u: np.ndarray,
    half: float,
    low: np.ndarray,
    high: np.ndarray,
    depth: tuple[float, float],
) -> list[Part]:
    """Upright bars round the (n,) places u, between (n,) heights, between two depths in thicknesses."""
    v = low[:, None, None] + np.linspace(0, 1, 4)[:, None] * (high - low)[:, None, None]
    across = u[:, None, None] + half * np.array([-1, 1])
    offset = back.thickness * np.array(depth)[:, None, None, None]
    faces = back.points(across, v, offset)
    return [sheet(f"{name} {i + 1}", front, rear) for i, (front, rear) in enumerate(zip(*faces, strict=True))]
