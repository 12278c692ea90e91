"""What sofas stand on, below z = height: legs that may stand apart, plinths, sleds."""

from __future__ import annotations

from dataclasses import dataclass

from procmodels.parts.primitives import Plane, beam, box, upright
from procmodels.shape import Part

RECESS = 0.05  # of a plinth, from the sides


@dataclass(frozen=True)
class Foot:
    """Where a leg's upper end is, and which ways it may slant."""

    name: str
    x: float
    y: float
    outwards: tuple[int, int]  # signs along x and y


def legs(feet: list[Foot], height: float, size: float, slope: float) -> list[Part]:
    """Square legs, their feet away from the middle by `slope` of their height, thinner there."""
    parts = []
    for foot in feet:
        away = [slope * height * sign for sign in foot.outwards]
        below, sizes = (foot.x + away[0], foot.y + away[1]), ((0.8 * size,) * 2, (size,) * 2)
        parts.append(upright(f"leg {foot.name}", below, (foot.x, foot.y), *sizes, high=Plane(height)))
    return parts


def sled(feet: list[Foot], height: float, size: float) -> list[Part]:
    """Upright legs, and runners on the floor between those of a side."""
    parts, bar = legs(feet, height, size, 0.0), min(size, 0.4 * height)
    for side in dict.fromkeys(f.name.split()[-1] for f in feet):
        ends = sorted(((f.x, f.y, bar / 2) for f in feet if f.name.endswith(side)), key=lambda place: place[1])
        if len(ends) > 1:
            parts.append(beam(f"runner {side}", ends[0], ends[-1], (bar, 0.8 * size), cut="Y"))
    return parts


def plinths(areas: list[tuple[float, float, float, float]], height: float) -> list[Part]:
    """Boxes under areas (x, x, y, y), smaller all round."""
    parts = []
    for i, (x0, x1, y0, y1) in enumerate(areas):
        dx, dy = (min(RECESS, 0.2 * (b - a)) for a, b in ((x0, x1), (y0, y1)))
        parts.append(box(f"plinth {i + 1}", (x0 + dx, y0 + dy, 0.0), (x1 - dx, y1 - dy, height)))
    return parts
