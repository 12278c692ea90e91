"""Cushions, from crisp to plump, and soft pillows: two bulging sheets sewn together along their rim."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from procmodels.parts.primitives import loft, rounded
from procmodels.parts.topology import corner_signs
from procmodels.shape import Part, Polygon

CELLS = 10  # along each side of a sheet; even, so that the mesh is symmetric
PINCH = 0.08  # how far the middle of a side is pulled in, of half the pillow's size: the corners stand out
FULLNESS = 0.8  # exponent of the bulge: smaller is plumper
SEAM = 0.3  # height of the seam, of the pillow's thickness
CRISP, PLUMP = 0.06, 0.5  # radius of a cushion's edges, of its thickness
CROWN = 0.3  # the most that the middle of a plump cushion rises over its edges, of its thickness
# A cushion's rings from its underside: height and inset in edge radii, counted from below, then from the crown's foot.
_BELOW = np.array([(0.0, 1.0), (0.3, 0.3), (1.0, 0.0)])
_ABOVE = np.array([(-1.0, 0.0), (-0.3, 0.3), (0.0, 1.0)])
PRESSED = 0.7  # where the bulge is higher than this, the underside lies flat


def cushion(name: str, outline: np.ndarray, low: float, high: float, softness: float) -> Part:
    """A cushion lying flat: a convex outline (n, 2), counter-clockwise from above, between two heights.

    softness  0: crisp edges and a level top; 1: round edges and a domed top
    """
    thickness, middle = high - low, (outline.min(0) + outline.max(0)) / 2
    size = np.ptp(outline, axis=0)
    radius = min(thickness * (CRISP + (PLUMP - CRISP) * softness) * (1 - CROWN * softness), 0.3 * size.min())
    foot = high - CROWN * softness * thickness
    heights = np.concatenate([low + radius * _BELOW[:, 0], foot + radius * _ABOVE[:, 0], [high]])
    insets = np.concatenate([radius * _BELOW[:, 1], radius * _ABOVE[:, 1], [0.38 * size.min()]])
    rings = np.empty((7, len(outline), 3))
    rings[:, :, :2] = middle + (outline - middle) * (1 - 2 * insets[:, None] / size)[:, None]
    rings[:, :, 2] = heights[:, None]
    return loft(name, rings)


def square(low: tuple[float, float], high: tuple[float, float], softness: float) -> np.ndarray:
    """(n, 2) outline of a cushion between two corners, its own corners rounder the softer it is."""
    (x0, y0), (x1, y1) = low, high
    corner = (0.03 + 0.17 * softness) * min(x1 - x0, y1 - y0)
    sides = np.array([x1 - x0, y1 - y0]) - 2 * corner
    return rounded(2 * corner, 2 * corner, 1.0, arc=3) + corner_signs(3) * sides / 2 + np.array([x0 + x1, y0 + y1]) / 2


def pillow(name: str, middle: tuple[float, float, float], width: float, depth: float, thickness: float) -> Part:
    """A pillow lying flat, `middle` being the middle of its underside; width along X, depth along Y."""
    # Cells get smaller towards the rim, where the cloth turns round.
    turn = np.linspace(-np.pi / 2, np.pi / 2, CELLS + 1)
    u, v = np.meshgrid(np.sin(turn), np.sin(turn), indexing="ij")
    bulge = np.clip(np.outer(np.cos(turn), np.cos(turn)), 0, 1) ** FULLNESS
    x = u * (1 - PINCH * (1 - v**2)) * width / 2
    y = v * (1 - PINCH * (1 - u**2)) * depth / 2
    above = thickness * (SEAM + (1 - SEAM) * bulge)
    below = thickness * SEAM * (1 - np.minimum(bulge / PRESSED, 1))

    inside, faces = _sewn()
    sheets = [np.stack([x, y, above], -1).reshape(-1, 3), np.stack([x, y, below], -1)[inside]]
    return Part(name, np.concatenate(sheets) + middle, faces)


@lru_cache
def _sewn() -> tuple[np.ndarray, tuple[Polygon, ...]]:
    """Cells (CELLS + 1, CELLS + 1) bool inside of the rim, and the faces of both sheets.

    The lower sheet has the upper one's vertices on the rim, and its own inside.
    """
    upper = np.arange((CELLS + 1) ** 2).reshape(CELLS + 1, CELLS + 1)
    inside = np.zeros(upper.shape, bool)
    inside[1:-1, 1:-1] = True
    lower = upper.copy()
    lower[inside] = upper.size + np.arange(inside.sum())
    # It is seen from the other side: its triangles run the other way round.
    return inside, tuple(_triangles(upper) + [(a, c, b) for a, b, c in _triangles(lower)])


def _triangles(sheet: np.ndarray) -> list[tuple[int, int, int]]:
    """Every cell of a grid of vertex numbers, cut from the corner far from the middle to the one near it.

    At the pillow's corners no other cut would do: it would put one triangle into both sheets.
    """
    half, out = (len(sheet) - 1) / 2, []
    for i, j in np.ndindex(len(sheet) - 1, len(sheet) - 1):
        a, b, c, d = (int(sheet[k]) for k in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
        if (i < half) != (j < half):
            a, b, c, d = b, c, d, a
        out += [(a, b, c), (a, c, d)]
    return out
