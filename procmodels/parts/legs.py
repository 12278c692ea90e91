"""What a seat or a top stands on: four legs, folding legs, sleds, stars, pedestals, side boards; and their stretchers.

All stand on z = 0 and reach up to the plane `under`; left is +X, the side of the one who sits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from procmodels.parts.primitives import (
    Plane,
    beam,
    cylinder,
    lathe,
    mirrored,
    rotation,
    sheet,
    torus,
    upright,
)
from procmodels.shape import Part

Place = tuple[float, float]  # x, y
INWARDS = 0.11  # the most that feet lean inwards, of their height


@dataclass(frozen=True)
class Leg:
    """The line through the middle of a leg of the left side, and its square section at both ends."""

    head: Place
    foot: Place
    top: float  # z of the head
    size: float
    foot_size: float

    @staticmethod
    def under(plane: Plane, head: Place, lean: tuple[float, float], size: float, taper: float) -> Leg:
        """A leg below a plane; `lean` is how far the foot stands outwards and away from the middle, of its height.

        Feet that lean inwards never cross the middle: where there is little room they lean less.
        """
        height, foot_size = plane.at(head[1]), size * taper
        foot = []
        for place, slope in zip((head[0], abs(head[1])), lean, strict=True):
            if slope < 0:
                slope *= min(1.0, max(place - foot_size / 2, 0.0) / (INWARDS * height))
            foot.append(place + slope * height)
        return Leg(head, (foot[0], math.copysign(foot[1], head[1])), height, size, foot_size)

    def at(self, z: float) -> tuple[float, float, float]:
        """The middle at a height."""
        share = z / self.top
        return (
            self.foot[0] + share * (self.head[0] - self.foot[0]),
            self.foot[1] + share * (self.head[1] - self.foot[1]),
            z,
        )

    def size_at(self, z: float) -> float:
        """Side of the section at a height."""
        return self.foot_size + z / self.top * (self.size - self.foot_size)

    def part(self, name: str, under: Plane) -> Part:
        """The leg, thicker where it leans much: its section is level."""
        # Measured across its own line, a leg is as thick as asked.
        x, y = (math.hypot(1, (h - f) / self.top) for h, f in zip(self.head, self.foot, strict=True))
        sizes = [(s * x, s * y) for s in (self.foot_size, self.size)]
        return upright(name, self.foot, self.head, sizes[0], sizes[1], high=under)


def both(name: str, part: Part) -> list[Part]:
    """A part of the left side, named with {} in the side's place, and its mirror image."""
    left = Part(name.format("left"), part.vertices, part.faces, part.convex)
    return [left, mirrored(part, name.format("right"))]


def four(front: Leg, rear: Leg, under: Plane) -> list[Part]:
    """Four legs."""
    return both("leg front {}", front.part("", under)) + both("leg rear {}", rear.part("", under))


def stretchers(kind: str, front: Leg, rear: Leg, share: float) -> list[Part]:
    """Bars between four legs at a share of their height: none, sides, H (with one across), box (all round)."""
    if kind == "none":
        return []
    a, b = front.at(share * front.top), rear.at(share * rear.top)
    # Thinner than the legs, and clear of the floor and the seat.
    room = min(min(z, leg.top - z) for leg, (_, _, z) in ((front, a), (rear, b)))
    size = min(0.6 * min(front.size_at(a[2]), rear.size_at(b[2])), 1.2 * room)
    section = (size, size)
    parts = both("stretcher {}", beam("", a, b, section, cut="Y"))
    if kind == "H":
        x, y, z = ((p + q) / 2 for p, q in zip(a, b, strict=True))
        parts.append(beam("stretcher middle", (-x, y, z), (x, y, z), section, cut="X"))
    if kind == "box":
        for name, (x, y, z) in (("front", a), ("rear", b)):
            parts.append(beam(f"stretcher {name}", (-x, y, z), (x, y, z), section, cut="X"))
    return parts


def aprons(front: Leg, rear: Leg, height: float, under: Plane, behind: float = 0.0) -> list[Part]:
    """Boards under the seat between four legs, down to a share of the legs' height.

    behind  the share that the rear one reaches down, where that is more; without a height it is the only one
    """
    half = apron_half(front, rear)
    high = [leg.at(leg.top) for leg in (front, rear)]
    parts = []
    if height:
        low = [leg.at((1 - height) * leg.top) for leg in (front, rear)]
        parts += both("apron {}", _board(np.array([low, high]), (half, 0, 0), under))
    for name, leg, share in (("front", front, height), ("rear", rear, max(height, behind))):
        if share:
            rows = [[(-x, y, z), (x, y, z)] for x, y, z in (leg.at((1 - share) * leg.top), leg.at(leg.top))]
            board = _board(np.array(rows), (0, -half, 0), under)
            parts.append(Part(f"apron {name}", board.vertices, board.faces, board.convex))
    return parts


def apron_half(front: Leg, rear: Leg) -> float:
    """Half the thickness of aprons."""
    return min(0.25 * min(front.size, rear.size), 0.02)


def _board(rows: np.ndarray, half: tuple[float, float, float], under: Plane) -> Part:
    """A board round the middle sheet (2, columns, 3), `half` towards the side that it is seen from, below a plane."""
    front, back = rows + half, rows - half
    for face in (front, back):
        face[1, :, 2] = under.z + under.slope * face[1, :, 1]
    return sheet("", front, back)


def sled(front: Leg, rear: Leg, rear_posts: bool, under: Plane) -> list[Part]:
    """Two runners on the floor below posts; without rear posts a bar joins the runners there (cantilever)."""
    size = min(front.size, 0.5 * front.top, 0.5 * rear.top)
    section = (size, size)
    half = size / 2
    start, end = (*front.foot, half), (*rear.foot, half)
    parts = both("leg front {}", front.part("", under))
    parts += both("runner {}", beam("", start, end, section, cut="Y"))
    if rear_posts:
        return parts + both("leg rear {}", rear.part("", under))
    x, y = rear.foot
    return [*parts, beam("runner rear", (-x, y, half), (x, y, half), section, cut="X")]


def fold(front: Leg, rear: Leg, under: Plane) -> list[Part]:
    """Legs that cross at each side, each pair side by side: from the front of the seat to the rear foot, and back."""
    size, taper = min(front.size, front.head[0] / 2.5, rear.head[0] / 2.5), front.foot_size / front.size
    outer = Leg(front.head, (front.foot[0], rear.foot[1]), front.top, size, size * taper)
    head = (rear.head[0] - size, rear.head[1])
    foot = (max(rear.foot[0] - size, size * taper / 2), front.foot[1])
    inner = Leg(head, foot, rear.top, size, size * taper)
    parts = both("leg outer {}", outer.part("", under)) + both("leg inner {}", inner.part("", under))
    for name, leg in (("outer", outer), ("inner", inner)):
        x, y, z = leg.at(0.12 * leg.top)
        bar = min(0.5 * leg.size_at(z), z)
        parts.append(beam(f"bar {name}", (-x, y, z), (x, y, z), (bar, bar), cut="X"))
    return parts


def star(
    radius: float, arms: int, turn: float, castors: bool, size: float, under: Plane, ring: float | None = None
) -> list[Part]:
    """A column on arms that reach out along the floor, or over it on castors.

    turn  of the first arm away from the rear, of the angle between two
    ring  share of the column's height at which it carries a ring for the feet; None: it has none
    """
    height = under.at(0)
    arm = min(0.04, 0.15 * height)
    wheel = min(0.03, 0.1 * height) if castors else 0.0
    hub = 2 * wheel + 2 * arm
    tip = 1.8 * wheel + 0.4 * arm  # middle of an arm's end: over a castor, or on the floor
    member = beam("", (0, 0, hub - 0.6 * arm), (radius, 0, tip), (1.2 * arm, arm), (0.8 * arm, 0.8 * arm), cut="X")
    wheels = cylinder("", wheel, (radius, -0.6 * wheel, wheel), (radius, 0.6 * wheel, wheel), 10) if castors else None
    parts = _column(hub - arm, size, under, ring, 0.7 * radius)
    for i in range(arms):
        about = rotation("Z", 90 + 360 * (i + turn) / arms)
        for name, part in (("star arm", member), ("castor", wheels)):
            if part is not None:
                moved = part.moved(about)
                parts.append(Part(f"{name} {i + 1}", moved.vertices, moved.faces, moved.convex))
    return parts


def pedestal(radius: float, size: float, under: Plane, ring: float | None = None) -> list[Part]:
    """A column on a disc that swells towards it; ring: as of a star."""
    half, height = size / 2, min(0.06, 0.3 * under.at(0))
    profile = [(radius, 0.0), (radius, 0.25 * height), (0.55 * radius + 0.45 * half, 0.45 * height), (half, height)]
    return [lathe("foot", profile), *_column(height, size, under, ring, 0.7 * radius)]


def _column(low: float, size: float, under: Plane, ring: float | None, radius: float) -> list[Part]:
    """A round post from z = low, and perhaps a ring round it, on two bars through it."""
    parts = [upright("column", (0, 0), (0, 0), (size, size), (size, size), Plane(low), under, sides=12)]
    if ring is None:
        return parts
    # Not so wide that a tilted seat would come down on it.
    room = under.at(0) - low
    radius = min(radius, 0.3 * room / max(abs(under.slope), 1e-9))
    z, bar = low + 0.7 * ring * room, min(0.016, 0.6 * size, 0.1 * room)
    return [
        *parts,
        torus("foot ring", radius, 1.4 * bar, z),
        beam("ring bar across", (-radius, 0, z), (radius, 0, z), (bar, bar), cut="X"),
        beam("ring bar along", (0, -radius, z), (0, radius, z), (bar, bar), cut="Y"),
    ]
