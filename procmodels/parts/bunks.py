"""What carries a bed's deck high above the floor: corner posts, guards, a ladder."""

from __future__ import annotations

import numpy as np

from procmodels.parts.legs import both
from procmodels.parts.primitives import beam, box
from procmodels.shape import Part

BAR = 0.012  # thickness of guards
LADDER = (0.2, 0.02)  # width, thickness of its sides
STEP = 0.12  # about, between rungs


def posts(half: float, size: float, top: float) -> list[Part]:
    """Four square posts at the corners of a bed that reaches from -half to half and is 1 long, up to z = top."""
    parts = []
    for end, y in (("foot", -0.5), ("head", 0.5 - size)):
        parts += both(f"post {end} {{}}", box("", (half - size, y, 0.0), (half, y + size, top)))
    return parts


def guards(half: float, front: float, rear: float, deck: float, height: float) -> list[Part]:
    """Two bars along each side, from y = front to rear, up to a height above the deck."""
    parts = []
    wide = 0.3 * height
    for name, high in (("lower", 0.6 * height), ("upper", height)):
        bar = box("", (half - BAR, front, deck + high - wide), (half, rear, deck + high))
        parts += both(f"guard {name} {{}}", bar)
    return parts


def ladder(where: str, half: float, low: float, high: float) -> list[Part]:
    """An upright ladder outside of the frame, from the floor up to z = high: at the foot ("end"), or at a side near it.

    low  z of the upper deck's rail, which it reaches over
    """
    width, size = LADDER
    width = min(width, 1.6 * half)
    parts = [box(f"ladder {name}", (x - size / 2, -size, 0.0), (x + size / 2, 0.0, high)) for name, x in _sides(width)]
    steps = max(2, round(low / STEP))
    for i in range(steps):
        z = low * (i + 1) / (steps + 0.5)
        start, end = ((x, -size / 2, z) for x in (-width / 2, width / 2))
        parts.append(beam(f"rung {i + 1}", start, end, (0.7 * size, 0.7 * size), cut="X"))
    if where == "end":
        return [p.moved(_placed((1, 0), (0, 1), (0.0, -0.5))) for p in parts]
    x, y = half, -0.45 + 0.6 * width
    if where == "left":
        return [p.moved(_placed((0, 1), (-1, 0), (x, y))) for p in parts]
    return [p.moved(_placed((0, -1), (1, 0), (-x, y))) for p in parts]


def _sides(width: float) -> tuple[tuple[str, float], tuple[str, float]]:
    return ("side left", width / 2), ("side right", -width / 2)


def _placed(x_axis: tuple[float, float], y_axis: tuple[float, float], place: tuple[float, float]) -> np.ndarray:
    """(4, 4): where the ladder's own axes come to lie."""
    matrix = np.eye(4)
    matrix[:2, 0], matrix[:2, 1], matrix[:2, 3] = x_axis, y_axis, place
    return matrix
