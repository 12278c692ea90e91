"""What of a primitive depends on counts alone: unit outlines and faces, each made once."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import product

import numpy as np

from procmodels.shape import Polygon

# For a section across an axis: the two other axes, so that first x second points along it.
ACROSS = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}
# Corners of a cube of side 1 in the order 4 x + 2 y + z, and its sides.
CUBE = np.array(list(product((-0.5, 0.5), repeat=3)), np.float32)
CUBE_FACES: tuple[Polygon, ...] = ((0, 1, 3, 2), (2, 3, 7, 6), (6, 7, 5, 4), (4, 5, 1, 0), (2, 6, 4, 0), (7, 3, 1, 5))
_SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


@lru_cache
def polygon(sides: int) -> np.ndarray:
    """(sides, 2), counter-clockwise: a square of side 2, or corners on the unit circle, one of them at (0, 1)."""
    if sides == 4:
        return _SQUARE
    angles = np.pi / 2 + 2 * np.pi * np.arange(sides) / sides
    return np.stack([np.cos(angles), np.sin(angles)], 1)


@lru_cache
def section(cut: str, sides: int) -> np.ndarray:
    """(sides, 3) outline across an axis, in the order in which the axis's coordinates grow."""
    section = np.zeros((sides, 3))
    section[:, list(ACROSS[cut])] = polygon(sides)
    return section


@lru_cache
def outline_arcs(arc: int) -> np.ndarray:
    """(4 arc, 2) points of the unit circle, `arc` in each quarter, both its ends among them."""
    angles = np.concatenate([np.linspace(0, np.pi / 2, arc) + i * np.pi / 2 for i in range(4)])
    return np.stack([np.cos(angles), np.sin(angles)], 1)


@lru_cache
def corner_signs(arc: int) -> np.ndarray:
    """(4 arc, 2) corners of the square of side 2, each `arc` times."""
    return np.repeat(np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]), arc, axis=0)


@lru_cache
def loft_faces(rings: int, sides: int) -> tuple[Polygon, ...]:
    faces: list[Polygon] = [tuple(reversed(range(sides))), tuple(range((rings - 1) * sides, rings * sides))]
    for ring, i in product(range(rings - 1), range(sides)):
        a, b = ring * sides + i, ring * sides + (i + 1) % sides
        faces.append((a, b, b + sides, a + sides))
    return tuple(faces)


@lru_cache
def torus_faces(rings: int, sides: int) -> tuple[Polygon, ...]:
    faces: list[Polygon] = []
    for ring, i in product(range(rings), range(sides)):
        a, b, following = ring * sides + i, ring * sides + (i + 1) % sides, (ring + 1) % rings * sides
        faces.append((a, following + i, following + (i + 1) % sides, b))
    return tuple(faces)


@lru_cache
def sheet_faces(rows: int, columns: int) -> tuple[Polygon, ...]:
    number = np.arange(rows * columns).reshape(rows, columns)
    behind = rows * columns
    faces: list[Polygon] = []
    for i, j in product(range(rows - 1), range(columns - 1)):
        cell = tuple(int(number[k]) for k in ((i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)))
        faces += [cell, tuple(n + behind for n in reversed(cell))]
    # The rim, counter-clockwise as seen from before the front sheet.
    rim = [*number[0, :-1], *number[:-1, -1], *number[-1, :0:-1], *number[:0:-1, 0]]
    for a, b in zip(rim, rim[1:] + rim[:1], strict=True):
        faces.append((int(b), int(a), int(a) + behind, int(b) + behind))
    return tuple(faces)


@lru_cache
def bevelled_cube() -> tuple[np.ndarray, np.ndarray, tuple[Polygon, ...]]:
    """Signs (56, 3) of the cube's corners, depths (56, 3) of vertices within them in bevels, and faces.

    A vertex lies at sign * (half side - bevel * depth). Seven belong to a corner: one on each of its three sides, one
    in the middle of each edge's arc, one in the middle.
    """
    arc, ball = 1 - math.sqrt(1 / 2), 1 - math.sqrt(1 / 3)
    on_side, on_edge = 1 - np.eye(3), np.where(np.eye(3) > 0, 1, arc)  # row: the side's or edge's axis
    depths = np.tile(np.concatenate([on_side, on_edge, np.full((1, 3), ball)]), (8, 1))
    corners = np.array(list(product((-1, 1), repeat=3)))

    def first(axis: int, s: int, u: int, v: int) -> int:
        """Number of the first vertex at a corner with sign s along an axis, u and v along the next two."""
        place = np.roll((s, u, v), axis)
        return 7 * int((corners == place).all(1).argmax())

    faces: list[Polygon] = []
    for axis in range(3):
        for s in (-1, 1):
            faces.append(tuple(first(axis, s, u, v) + axis for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))))
        for u, v in product((-1, 1), repeat=2):
            low, high = first(axis, -1, u, v), first(axis, 1, u, v)
            strips = ((axis + 1) % 3, (axis + 2) % 3)  # from each of the two sides to the middle of the arc
            faces += [(low + k, high + k, high + 3 + axis, low + 3 + axis) for k in strips]
    for corner in range(0, 56, 7):
        faces += [(corner + a, corner + 3 + (a + 1) % 3, corner + 6, corner + 3 + (a + 2) % 3) for a in range(3)]
    signs = np.repeat(corners, 7, axis=0).astype(np.float32)
    return signs, depths, tuple(_outward(f, signs * (2 - depths)) for f in faces)


def _outward(face: Polygon, points: np.ndarray) -> Polygon:
    """The face turned so that it looks away from the origin, which lies inside."""
    a, b, c = points[list(face[:3])]
    return face if np.dot(np.cross(b - a, c - a), a + b + c) > 0 else _turned(face)


def _turned(face: Polygon) -> Polygon:
    """The other way round, from the same vertex: it is cut into the same triangles."""
    return (face[0], *face[:0:-1])


@lru_cache(maxsize=1024)
def turned_faces(faces: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
    return tuple(_turned(f) for f in faces)
