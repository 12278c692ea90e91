"""A part's polygons as triangles with a normal a vertex, as graphics cards want them: smooth by angle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

from procmodels.shape import Part

# Edges below this angle are shaded smooth: a cylinder's facets (15 degrees) vanish, a rounded box edge stays crisp.
SMOOTH_DEGREES = 20.0


class Vertices(NamedTuple):
    """places (m, 3), unit normals (m, 3), uv (m, 2) and triangles (t, 3) int."""

    places: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    triangles: np.ndarray


def with_normals(part: Part) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (m, 3), unit normals (m, 3) and triangles (t, 3) of a part, vertices doubled along sharp edges."""
    found = with_uv(part, None)
    return found.places, found.normals, found.triangles


def with_uv(part: Part, uv: np.ndarray | None) -> Vertices:
    """The same with the uv (c, 2) of the part's corners, face after face: vertices are doubled along its seams too."""
    owner = np.repeat(np.arange(len(part.faces)), [len(f) for f in part.faces])
    vertex = np.concatenate([np.asarray(f, int) for f in part.faces])
    following = np.concatenate([np.roll(f, -1) for f in part.faces])
    areas = np.zeros((len(part.faces), 3))  # Newell: sums to twice the polygon's area along its normal
    np.add.at(areas, owner, np.cross(part.vertices[vertex], part.vertices[following]))
    normals = _unit(areas)

    # A corner's normal: mean over the faces round its vertex that turn away from its own by less than the angle.
    touches = sparse.csr_array((np.ones(len(vertex)), (np.arange(len(vertex)), vertex)))
    corner, other = (touches @ touches.T).nonzero()
    smooth = (normals[owner[corner]] * normals[owner[other]]).sum(1) > np.cos(np.radians(SMOOTH_DEGREES))
    summed = areas[owner].copy()
    keep = smooth & (corner != other)
    np.add.at(summed, corner[keep], areas[owner[other[keep]]])
    summed = _unit(summed)

    places = np.zeros((len(vertex), 2)) if uv is None else uv
    key = np.concatenate([vertex[:, None], np.rint(summed * 1e4), np.rint(places * 1e6)], 1)
    _, first, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    ends = np.cumsum([len(f) for f in part.faces])
    faces = tuple(tuple(f) for f in np.split(number.ravel(), ends[:-1]))
    triangles = Part(part.name, part.vertices, faces).triangles()
    return Vertices(part.vertices[vertex[first]], summed[first], places[first], triangles)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) of length one; up for those without a direction, which files must not hold."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-30, vectors / np.maximum(length, 1e-30), (0.0, 0.0, 1.0))
