"""Boxes, beams, cylinders, plates, sheets and turned bodies as plain arrays: closed, their faces looking outwards.

Most of them are lofts: closed rings of vertices, one after the other, joined by quadrilaterals and capped at both ends.
The faces of a kind depend on counts alone and are made once; a part costs a few microseconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import product

import numpy as np

from procmodels.shape import Part, Polygon

Point = Sequence[float] | np.ndarray
# Corners of a cube in the order 4 x + 2 y + z, and its sides.
_CUBE = np.array(list(product((0.0, 1.0), repeat=3)))
_SIDES: tuple[Polygon, ...] = ((0, 1, 3, 2), (2, 3, 7, 6), (6, 7, 5, 4), (4, 5, 1, 0), (2, 6, 4, 0), (7, 3, 1, 5))
# For a section across an axis: the two other axes, so that first x second points along it.
_ACROSS = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}
_SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def box(name: str, low: Point, high: Point, bevel: float = 0.0, matrix: np.ndarray | None = None) -> Part:
    """An axis-aligned box between two corners, its edges rounded by `bevel`, then moved by a (4, 4) matrix.

    The rounding is that of Blender's bevel of two segments: arcs along the edges, at each corner a point of a sphere.
    """
    near, far = np.array(low, float), np.array(high, float)
    if bevel:
        signs, depths, faces = _bevelled_cube()
        bevel = min(bevel, float((far - near).min()) / 2)
        part = Part(name, (near + far) / 2 + signs * ((far - near) / 2 - bevel * depths), faces, convex=True)
    else:
        part = Part(name, near + (far - near) * _CUBE, _SIDES, convex=True)
    return part if matrix is None else part.moved(matrix)


def beam(
    name: str,
    start: Point,
    end: Point,
    size: tuple[float, float],
    end_size: tuple[float, float] | None = None,
    cut: str = "Z",
    sides: int = 4,
) -> Part:
    """A straight member from start to end, the centres of its ends, which lie across the axis `cut` (feet stand flat).

    size  lengths of the section along the two other axes, in the order of "X": y, z; "Y": z, x; "Z": x, y
    end_size  the same at the end (a taper); sides: 4 for a rectangle, more for an ellipse
    """
    axis, end_size = "XYZ".index(cut), end_size or size
    if end[axis] < start[axis]:
        start, end, size, end_size = end, start, end_size, size
    halves = np.zeros((2, 1, 3))
    for half, (a, b) in zip(halves[:, 0], (size, end_size), strict=True):
        half[axis - 2], half[axis - 1] = a / 2, b / 2
    rings = _section(cut, sides) * halves + np.array([[start], [end]])
    return Part(name, rings.reshape(-1, 3), _loft_faces(2, sides), convex=True)


def cylinder(
    name: str, radius: float, bottom: Point, top: Point, segments: int = 24, top_radius: float | None = None
) -> Part:
    """A cylinder (or cone frustum) between the centres of its two end discs, which lie across its axis."""
    axis = [t - b for b, t in zip(bottom, top, strict=True)]
    length = math.sqrt(sum(a * a for a in axis))
    x, y, z = (a / length for a in axis)
    # The smallest turn from Z to the axis; straight down it is half a turn about X.
    share = 1 / (1 + z) if z > -1 + 1e-12 else 0.0
    across = np.array([(1 - x * x * share, -x * y * share, -x), (-x * y * share, 1 - y * y * share, -y)])
    if not share:
        across = np.array([(1.0, 0, 0), (0, -1.0, 0)])
    radii = np.array([[[radius]], [[radius if top_radius is None else top_radius]]])
    rings = _outline(segments) @ across * radii + np.array([[bottom], [top]])
    return Part(name, rings.reshape(-1, 3), _loft_faces(2, segments), convex=True)


def loft(name: str, rings: np.ndarray, convex: bool = False) -> Part:
    """A body of rings (k, n, 3), each counter-clockwise seen from where the next one lies; the ends are flat caps."""
    k, n, _ = rings.shape
    return Part(name, rings.reshape(-1, 3), _loft_faces(k, n), convex)


def plate(name: str, outline: np.ndarray, low: float, high: float) -> Part:
    """A flat plate of a convex outline (n, 2), counter-clockwise seen from above, between two heights."""
    rings = np.empty((2, len(outline), 3))
    rings[:, :, :2] = outline
    rings[0, :, 2], rings[1, :, 2] = low, high
    return loft(name, rings, convex=True)


def rounded(width: float, depth: float, roundness: float, arc: int = 5) -> np.ndarray:
    """(4 arc, 2) outline, counter-clockwise, from rectangle (0) to ellipse (1): its corners are quarters of ellipses
    that take `roundness` of the half sides, of which a hundredth stays at both ends so that all vertices are apart.
    """
    share = 0.01 + 0.98 * roundness
    return (np.array([width, depth]) / 2) * (_corner_signs(arc) * (1 - share) + _outline_arcs(arc) * share)


def lathe(name: str, profile: Sequence[tuple[float, float]], centre: Point = (0.0, 0.0), segments: int = 16) -> Part:
    """A body turned about a vertical axis: (radius, z) from the bottom to the top, no radius 0."""
    radii, heights = np.array(profile).T
    rings = np.empty((len(radii), segments, 3))
    rings[:, :, :2] = radii[:, None, None] * _outline(segments) + np.array(centre)
    rings[:, :, 2] = heights[:, None]
    return loft(name, rings, convex=_is_concave(radii, heights))


def sweep(name: str, path: np.ndarray, across: np.ndarray, size: tuple[float, float], sides: int = 4) -> Part:
    """A member along a path.

    path    (k, 3) centres of its sections
    across  (k, 3) unit vectors along the section's first side; the second is at right angles to it and the path
    size    lengths of the two sides; sides: 4 for a rectangle, more for an ellipse
    """
    along = np.gradient(path, axis=0)
    second = np.cross(along, across)
    second /= np.sqrt((second * second).sum(1))[:, None]
    outline = _outline(sides) * (np.array(size) / 2)
    rings = path[:, None] + outline[None, :, :1] * across[:, None] + outline[None, :, 1:] * second[:, None]
    return loft(name, rings, convex=len(path) == 2)


def sheet(name: str, front: np.ndarray, back: np.ndarray, convex: bool = False) -> Part:
    """A body between two sheets of points (rows, columns, 3).

    Seen from before the front sheet columns run to the right and rows upwards.
    """
    rows, columns, _ = front.shape
    vertices = np.concatenate([front.reshape(-1, 3), back.reshape(-1, 3)])
    return Part(name, vertices, _sheet_faces(rows, columns), convex)


def mirrored(part: Part, name: str) -> Part:
    """The part on the other side of the plane x = 0."""
    return Part(name, part.vertices * (-1.0, 1.0, 1.0), _reversed(part.faces), part.convex)


def rotation(axis: str, degrees: float, about: Iterable[float] = (0, 0, 0)) -> np.ndarray:
    """(4, 4) rotation about the line through `about` along axis "X", "Y" or "Z"."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = _ACROSS[axis]
    matrix = np.eye(4)
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = c, -s, s, c
    centre = np.array(list(about), float)
    matrix[:3, 3] = centre - matrix[:3, :3] @ centre
    return matrix


# What depends on counts alone.


@lru_cache
def _outline(sides: int) -> np.ndarray:
    """(sides, 2), counter-clockwise: a square of side 2, or corners on the unit circle, one of them at (0, 1)."""
    if sides == 4:
        return _SQUARE
    angles = np.pi / 2 + 2 * np.pi * np.arange(sides) / sides
    return np.stack([np.cos(angles), np.sin(angles)], 1)


@lru_cache
def _section(cut: str, sides: int) -> np.ndarray:
    """(sides, 3) outline across an axis, in the order in which the axis's coordinates grow."""
    section = np.zeros((sides, 3))
    section[:, list(_ACROSS[cut])] = _outline(sides)
    return section


@lru_cache
def _outline_arcs(arc: int) -> np.ndarray:
    """(4 arc, 2) points of the unit circle, `arc` in each quarter, both its ends among them."""
    angles = np.concatenate([np.linspace(0, np.pi / 2, arc) + i * np.pi / 2 for i in range(4)])
    return np.stack([np.cos(angles), np.sin(angles)], 1)


@lru_cache
def _corner_signs(arc: int) -> np.ndarray:
    """(4 arc, 2) corners of the square of side 2, each `arc` times."""
    return np.repeat(np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]), arc, axis=0)


@lru_cache
def _loft_faces(rings: int, sides: int) -> tuple[Polygon, ...]:
    faces: list[Polygon] = [tuple(reversed(range(sides))), tuple(range((rings - 1) * sides, rings * sides))]
    for ring, i in product(range(rings - 1), range(sides)):
        a, b = ring * sides + i, ring * sides + (i + 1) % sides
        faces.append((a, b, b + sides, a + sides))
    return tuple(faces)


@lru_cache
def _sheet_faces(rows: int, columns: int) -> tuple[Polygon, ...]:
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
def _bevelled_cube() -> tuple[np.ndarray, np.ndarray, tuple[Polygon, ...]]:
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
    signs = np.repeat(corners, 7, axis=0)
    return signs, depths, tuple(_outward(f, signs * (2 - depths)) for f in faces)


def _outward(face: Polygon, points: np.ndarray) -> Polygon:
    """The face turned so that it looks away from the origin, which lies inside."""
    a, b, c = points[list(face[:3])]
    return face if np.dot(np.cross(b - a, c - a), a + b + c) > 0 else _turned(face)


def _turned(face: Polygon) -> Polygon:
    """The other way round, from the same vertex: it is cut into the same triangles."""
    return (face[0], *face[:0:-1])


@lru_cache(maxsize=1024)
def _reversed(faces: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
    return tuple(_turned(f) for f in faces)


def _is_concave(radii: np.ndarray, heights: np.ndarray) -> bool:
    """Whether the profile radius(z) nowhere turns inwards, so that the turned body is convex."""
    rise, grow = np.diff(heights), np.diff(radii)
    return bool((rise[:-1] * grow[1:] - rise[1:] * grow[:-1] <= 1e-12).all())
