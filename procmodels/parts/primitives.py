"""Boxes, beams, cylinders, plates, sheets and turned bodies as plain arrays: closed, their faces looking outwards.

Most of them are lofts: closed rings of vertices, one after the other, joined by quadrilaterals and capped at both ends.
The faces of a kind depend on counts alone and are made once; a part costs a few microseconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from procmodels.parts.topology import (
    ACROSS,
    CUBE,
    CUBE_FACES,
    bevelled_cube,
    corner_signs,
    loft_faces,
    outline_arcs,
    polygon,
    section,
    sheet_faces,
    torus_faces,
    turned_faces,
)
from procmodels.shape import Part

Point = Sequence[float] | np.ndarray


class Plane(NamedTuple):
    """A plane z + slope * y that is level from left to right."""

    z: float
    slope: float = 0.0

    def at(self, y: float) -> float:
        """Its height at y."""
        return self.z + self.slope * y


LEVEL = Plane(0.0)


def box(name: str, low: Point, high: Point, bevel: float = 0.0, matrix: np.ndarray | None = None) -> Part:
    """An axis-aligned box between two corners, its edges rounded by `bevel`, then moved by a (4, 4) matrix.

    The rounding is that of Blender's bevel of two segments: arcs along the edges, at each corner a point of a sphere.
    """
    near, far = np.array(low, float), np.array(high, float)
    # In the single precision of Blender's meshes: a plane on the border between two layers of voxels falls into the
    # layer that networks know which were trained on them.
    middle, size = ((near + far) / 2).astype(np.float32), (far - near).astype(np.float32)
    if bevel:
        signs, depths, faces = bevelled_cube()
        bevel = min(bevel, float(size.min()) / 2)
        part = Part(name, (middle + signs * (size / 2)) - bevel * (signs * depths), faces, convex=True)
    else:
        part = Part(name, (middle + CUBE * size).astype(float), CUBE_FACES, convex=True)
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
    rings = section(cut, sides) * halves + np.array([[start], [end]])
    return Part(name, rings.reshape(-1, 3), loft_faces(2, sides), convex=True)


def upright(
    name: str,
    foot: Point,
    head: Point,
    foot_size: tuple[float, float],
    head_size: tuple[float, float],
    low: Plane = LEVEL,
    high: Plane = LEVEL,
    sides: int = 4,
) -> Part:
    """A post between two planes that may slope to the front: feet stand flat, heads fit under a tilted seat.

    foot, head  (x, y) of the centres of its ends; sizes: along x and y; low, high: the planes of the ends
    """
    halves = np.array([[(*foot_size, 0.0)], [(*head_size, 0.0)]]) / 2
    ends = [[(foot[0], foot[1], low.at(foot[1]))], [(head[0], head[1], high.at(head[1]))]]
    rings = section("Z", sides) * halves + np.array(ends)
    start, along = rings[0], rings[1] - rings[0]
    # Each edge goes on until it meets the plane: the sides stay flat.
    cuts = [
        start + along * ((p.z + p.slope * start[:, 1] - start[:, 2]) / (along[:, 2] - p.slope * along[:, 1]))[:, None]
        if p.slope
        else ring
        for p, ring in zip((low, high), rings, strict=True)
    ]
    return Part(name, np.concatenate(cuts), loft_faces(2, sides), convex=True)


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
    rings = polygon(segments) @ across * radii + np.array([[bottom], [top]])
    return Part(name, rings.reshape(-1, 3), loft_faces(2, segments), convex=True)


def loft(name: str, rings: np.ndarray, convex: bool = False) -> Part:
    """A body of rings (k, n, 3), each counter-clockwise seen from where the next one lies; the ends are flat caps."""
    k, n, _ = rings.shape
    return Part(name, rings.reshape(-1, 3), loft_faces(k, n), convex)


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
    return (np.array([width, depth]) / 2) * (corner_signs(arc) * (1 - share) + outline_arcs(arc) * share)


def lathe(name: str, profile: Sequence[tuple[float, float]], centre: Point = (0.0, 0.0), segments: int = 16) -> Part:
    """A body turned about a vertical axis: (radius, z) from the bottom to the top, no radius 0."""
    radii, heights = np.array(profile).T
    rings = np.empty((len(radii), segments, 3))
    rings[:, :, :2] = radii[:, None, None] * polygon(segments) + np.array(centre)
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
    outline = polygon(sides) * (np.array(size) / 2)
    rings = path[:, None] + outline[None, :, :1] * across[:, None] + outline[None, :, 1:] * second[:, None]
    return loft(name, rings, convex=len(path) == 2)


def torus(name: str, radius: float, thickness: float, z: float, segments: int = 20, sides: int = 6) -> Part:
    """A round tube bent to a level ring about the z axis; radius to the middle of the tube."""
    tube = polygon(sides) * (thickness / 2)
    rings = np.empty((segments, sides, 3))
    rings[..., :2] = polygon(segments)[:, None] * (radius + tube[:, :1])
    rings[..., 2] = z + tube[:, 1]
    return Part(name, rings.reshape(-1, 3), torus_faces(segments, sides))


def sheet(name: str, front: np.ndarray, back: np.ndarray, convex: bool = False) -> Part:
    """A body between two sheets of points (rows, columns, 3).

    Seen from before the front sheet columns run to the right and rows upwards.
    """
    rows, columns, _ = front.shape
    vertices = np.concatenate([front.reshape(-1, 3), back.reshape(-1, 3)])
    return Part(name, vertices, sheet_faces(rows, columns), convex)


def mirrored(part: Part, name: str) -> Part:
    """The part on the other side of the plane x = 0."""
    return Part(name, part.vertices * (-1.0, 1.0, 1.0), turned_faces(part.faces), part.convex)


def rotation(axis: str, degrees: float, about: Iterable[float] = (0, 0, 0)) -> np.ndarray:
    """(4, 4) rotation about the line through `about` along axis "X", "Y" or "Z"."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = ACROSS[axis]
    matrix = np.eye(4)
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = c, -s, s, c
    centre = np.array(list(about), float)
    matrix[:3, 3] = centre - matrix[:3, :3] @ centre
    return matrix


def _is_concave(radii: np.ndarray, heights: np.ndarray) -> bool:
    """Whether the profile radius(z) nowhere turns inwards, so that the turned body is convex."""
    rise, grow = np.diff(heights), np.diff(radii)
    return bool((rise[:-1] * grow[1:] - rise[1:] * grow[:-1] <= 1e-12).all())
