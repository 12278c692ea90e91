"""Fronts of drawers and doors: boards of their own before a body, with a gap between them; and blocks of drawers."""

from __future__ import annotations

from collections.abc import Sequence

from procmodels.parts.primitives import box
from procmodels.shape import Part

Span = tuple[float, float]


def front(name: str, x: Span, z: Span, y: Span, gap: float) -> Part:
    """One front before the body's face at y[1], half a gap within its own field."""
    half = min(gap / 2, 0.2 * (x[1] - x[0]), 0.2 * (z[1] - z[0]))
    return box(name, (x[0] + half, y[0], z[0] + half), (x[1] - half, y[1], z[1] - half))


def fields(span: Span, count: int) -> list[Span]:
    """The span cut into as many equal ones."""
    step = (span[1] - span[0]) / count
    return [(span[0] + i * step, span[0] + (i + 1) * step) for i in range(count)]


def grid(name: str, x: Span, rows: Sequence[Span], y: Span, leaves: int, gap: float) -> list[Part]:
    """Fronts for every row, numbered from below, and so many beside each other; what is higher than wide is a door.

    name  with {} in the place of "door" or "drawer"
    """
    parts = []
    for i, z in enumerate(rows):
        for j, field in enumerate(fields(x, leaves)):
            what = name.format("door" if z[1] - z[0] > field[1] - field[0] else "drawer")
            parts.append(front(f"{what} {i + 1}" + f" {j + 1}" * (leaves > 1), field, z, y, gap))
    return parts


def block(name: str, x: Span, y: Span, z: Span, count: int, thickness: float, gap: float) -> list[Part]:
    """A body with drawers towards -Y; all of it lies within the three spans.

    name  with {} in the place of what is meant: "body" or "drawer"
    """
    face = y[0] + min(thickness, 0.2 * (y[1] - y[0]))
    body = box(name.format("body"), (x[0], face, z[0]), (x[1], y[1], z[1]))
    drawers = [
        front(f"{name.format('drawer')} {i + 1}", x, f, (y[0], face), gap) for i, f in enumerate(fields(z, count))
    ]
    return [body, *drawers]
