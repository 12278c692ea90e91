"""What tops stand on beside four legs: three legs, ends with a post, crossed legs, columns; and bars between four legs.

All stand on z = 0 and reach up to z = top; left is +X.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from procmodels.parts.legs import Leg, both
from procmodels.parts.primitives import Plane, beam, box, lathe, rotation, upright
from procmodels.shape import Part

Place = tuple[float, float]
FEET = {"three": 3, "four": 4, "five": 5}


def leaning(name: str, head: Place, foot: Place, size: float, taper: float, top: float) -> Part:
    """A leg whose thickness is as asked across its own line."""
    wider = [math.hypot(1, (h - f) / top) for h, f in zip(head, foot, strict=True)]
    ends = [(s * wider[0], s * wider[1]) for s in (size * taper, size)]
    return upright(name, foot, head, ends[0], ends[1], high=Plane(top))


def three(heads: tuple[Place, Place], size: float, taper: float, slope: float, top: float) -> list[Part]:
    """A leg at the rear and one at each side of the front; feet lean outwards by `slope` of the height.

    heads  of the rear one and the left one
    """
    parts = []
    for name, (x, y) in zip(("leg rear", "leg front {}"), heads, strict=True):
        out = 1 + slope * top / math.hypot(x, y)
        leg = leaning(name, (x, y), (out * x, out * y), size, taper, top)
        parts += [leg] if x == 0 else both(name, leg)
    return parts


def bars(kind: str, front: Leg, rear: Leg, share: float, thickness: float) -> list[Part]:
    """Stretchers between four legs: sides, H (with one across), box (all round) or X.

    share      of the legs' height: at 0 they lie on the floor
    thickness  of the legs' there
    """
    size = min(thickness * min(front.size_at(0), front.size), 0.4 * front.top)
    z = size / 2 + share * (front.top - size)
    a, b = front.at(z), rear.at(z)
    section = (size, size)
    if kind == "X":
        return [beam(f"stretcher {n}", (-p[0], p[1], z), q, section, cut="X") for n, p, q in (("1", a, b), ("2", b, a))]
    parts = both("stretcher {}", beam("", a, b, section, cut="Y"))
    if kind == "H":
        x, y = ((p + q) / 2 for p, q in zip(a[:2], b[:2], strict=True))
        parts.append(beam("stretcher middle", (-x, y, z), (x, y, z), section, cut="X"))
    if kind == "box":
        for name, (x, y, _) in (("front", a), ("rear", b)):
            parts.append(beam(f"stretcher {name}", (-x, y, z), (x, y, z), section, cut="X"))
    return parts


@dataclass(frozen=True)
class Ends:
    """Two ends alike: x of their middles, their thickness, half the length of what they stand on, z of their tops."""

    x: float
    size: float
    half: float
    top: float

    @property
    def inner(self) -> float:
        """x of their inner faces."""
        return self.x - self.size / 2

    @property
    def board(self) -> float:
        """Thickness of boards between them."""
        return min(self.size, 0.03, 0.2 * self.half)

    def panels(self) -> list[Part]:
        """Boards."""
        low, high = (self.inner, -self.half, 0.0), (self.x + self.size / 2, self.half, self.top)
        return both("panel {}", box("", low, high))

    def aprons(self, height: float, behind: float) -> list[Part]:
        """Boards between panels, under the top; shares of the height at the front and, if that is more, the rear."""
        parts = []
        for name, y, share in (("front", -self.half, height), ("rear", self.half - self.board, max(height, behind))):
            if share:
                low = (-self.inner, y, (1 - share) * self.top)
                parts.append(box(f"apron {name}", low, (self.inner, y + self.board, self.top)))
        return parts

    def trestles(self, post: float, share: float, panel: float) -> list[Part]:
        """A post on a foot under a head at each end, and between the posts a beam at a share of their height.

        post   its width, of the foot's length
        panel  how far a board between the posts reaches down from the top, of the height; 0: none
        """
        bar = min(self.size, 0.2 * self.top)
        half, wide = self.size / 2, post * self.half
        foot = box("", (self.x - half, -self.half, 0), (self.x + half, self.half, bar))
        head = box("", (self.x - half, -0.8 * self.half, self.top - bar), (self.x + half, 0.8 * self.half, self.top))
        thin = 0.8 * half
        stem = box("", (self.x - thin, -wide, bar), (self.x + thin, wide, self.top - bar))
        z, deep = bar / 2 + share * (self.top - bar), min(0.6 * wide, bar)
        beam_ = box("beam", (-self.x, -deep, z - bar / 2), (self.x, deep, z + bar / 2))
        parts = [*both("foot {}", foot), *both("post {}", stem), *both("head {}", head), beam_]
        if panel:
            thick = min(0.2 * self.size, 0.01, 0.15 * self.half)
            parts.append(box("apron rear", (-self.x, -thick, (1 - panel) * self.top), (self.x, thick, self.top)))
        return parts

    def crosses(self) -> list[Part]:
        """Two legs that cross at each end, side by side, and a bar that joins the ends where they do."""
        half, room = self.size / 2, self.half**2 / (self.half + self.size / 2)
        parts = []
        for name, x, y in (("outer", self.x + half / 2, room), ("inner", self.x - half / 2, -room)):
            wide = half * math.hypot(1, 2 * room / self.top) * 2
            leg = upright("", (x, y), (x, -y), (half, wide), (half, wide), high=Plane(self.top))
            parts += both(f"leg {name} {{}}", leg)
        z, bar = self.top / 2, 0.35 * self.size
        return [*parts, box("bar", (-self.x, -bar, z - bar), (self.x, bar, z + bar))]


def pedestal(foot: str, radius: float, size: float, taper: float, top: float) -> list[Part]:
    """A column on a disc, a square plate or three to five feet.

    foot   "disc", "plate", "three", "four" or "five"; radius: how far it reaches
    taper  the column's width at its foot, of that at its head, `size`
    """
    half, low = taper * size / 2, min(0.03, 0.2 * top)
    if foot == "plate":
        plate = box("foot", (-radius, -radius, 0), (radius, radius, low))
        return [plate, upright("column", (0, 0), (0, 0), (2 * half, 2 * half), (size, size), Plane(low), Plane(top))]
    if foot == "disc":
        rise = min(max(0.6 * (radius - half), 0.0), 0.04)
        profile = [(radius, 0.0), (radius, 0.5 * low), (0.4 * radius + 0.6 * half, low), (half, low + rise)]
        low += rise
        parts = [lathe("foot", profile, segments=24)]
    else:
        height = min(0.08, 0.25 * top) + 0.3 * half
        end = 0.35 * height
        arm = min(1.2 * half, 0.1)
        member = beam("", (0, 0, height / 2), (radius, 0, end / 2), (arm, height), (arm, end), cut="X")
        turns = [rotation("Z", 90 + 360 * i / FEET[foot]) for i in range(FEET[foot])]
        arms = [member.moved(t) for t in turns]
        parts = [Part(f"foot {i + 1}", a.vertices, a.faces, a.convex) for i, a in enumerate(arms)]
        low = 0.5 * height
    column = upright("column", (0, 0), (0, 0), (2 * half, 2 * half), (size, size), Plane(low), Plane(top), sides=12)
    return [*parts, column]


@dataclass(frozen=True)
class Angle:
    """What stands below an L whose inner corner looks to the front right.

    reach  x, y of its outer corners; arm: the depth of the arm along the rear, the width of the one at the left
    """

    reach: Place
    arm: Place
    top: float

    def legs(self, size: float, taper: float) -> list[Part]:
        """Five legs."""
        foot = size * taper
        wide = max(size, foot) / 2
        x, y = self.reach[0] - wide, self.reach[1] - wide
        places = {
            "rear": (x, y),
            "rear end": (-x, y),
            "end": (-x, self.reach[1] - self.arm[0] + wide),
            "front": (x, -y),
            "front inner": (self.reach[0] - self.arm[1] + wide, -y),
        }
        ends = (foot, foot), (size, size)
        return [upright(f"leg {n}", at, at, *ends, high=Plane(self.top)) for n, at in places.items()]

    def panels(self, size: float) -> list[Part]:
        """Boards along the left side, across its front and at the other end."""
        x, y = self.reach
        inner = x - size
        return [
            box("panel side", (inner, -y, 0), (x, y, self.top)),
            box("panel front", (x - self.arm[1], -y, 0), (inner, size - y, self.top)),
            box("panel end", (-x, y - self.arm[0], 0), (size - x, y, self.top)),
        ]

    def back(self, size: float, share: float) -> list[Part]:
        """A board along the rear, down from the top by a share of the height."""
        x, y, thick = self.reach[0] - size / 2, self.reach[1] - size / 2, min(0.5 * size, 0.04)
        return [box("apron rear", (-x, y - thick / 2, (1 - share) * self.top), (x, y + thick / 2, self.top))]
