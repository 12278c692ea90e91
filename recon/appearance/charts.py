"""A shape's surface in flat pieces: polygons of one part that touch and look about the same way, laid into a plane."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from procmodels.shape import Part, Shape

WIDEST = np.cos(np.radians(55.0))  # polygons turned further from the piece's first one begin another piece
SAME = 1e-6  # canonical units: vertices this near are one


@dataclass(frozen=True)
class Chart:
    """A flat piece.

    part   its part's number
    faces  (k,) int, numbers of its polygons in the part
    flat   (c, 2) float, places of the polygons' corners in the plane, face after face; canonical units, seen from
           outside, the lower left corner of their box at the origin, the box's longer side along x
    """

    part: int
    faces: np.ndarray
    flat: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """(2,) width and height in canonical units."""
        return self.flat.max(0)


def charts(shape: Shape) -> list[Chart]:
    """All of a shape's surface; every polygon is in one chart."""
    return [chart for i, part in enumerate(shape.parts) for chart in _of_part(i, part)]


def _of_part(number: int, part: Part) -> Iterator[Chart]:
    normals, areas = _normals(part)
    neighbours = _neighbours(part)
    free = np.ones(len(part.faces), bool)
    for seed in np.argsort(-areas, kind="stable"):
        if not free[seed]:
            continue
        free[seed] = False
        faces, waiting = [int(seed)], [int(seed)]
        while waiting:
            for other in neighbours[waiting.pop()]:
                if free[other] and normals[other] @ normals[seed] > WIDEST:
                    free[other] = False
                    faces.append(other)
                    waiting.append(other)
        faces.sort()
        corners = np.concatenate([part.vertices[list(part.faces[f])] for f in faces])
        yield Chart(number, np.array(faces), _laid(corners, normals[seed]))


def _normals(part: Part) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (f, 3) and areas (f,) of a part's polygons."""
    owner = np.repeat(np.arange(len(part.faces)), [len(f) for f in part.faces])
    here = part.vertices[np.concatenate([np.asarray(f, int) for f in part.faces])]
    following = part.vertices[np.concatenate([np.roll(f, -1) for f in part.faces])]
    twice = np.zeros((len(part.faces), 3))
    np.add.at(twice, owner, np.cross(here, following))
    length = np.linalg.norm(twice, axis=1)
    return twice / np.maximum(length, 1e-30)[:, None], length / 2


def _neighbours(part: Part) -> list[list[int]]:
    """Numbers of the polygons that share an edge with each polygon."""
    _, same = np.unique(np.rint(part.vertices / SAME), axis=0, return_inverse=True)
    same = same.ravel()
    owner = np.repeat(np.arange(len(part.faces)), [len(f) for f in part.faces])
    ends = np.stack(
        [
            same[np.concatenate([np.asarray(f, int) for f in part.faces])],
            same[np.concatenate([np.roll(f, -1) for f in part.faces])],
        ],
        1,
    )
    _, edge = np.unique(np.sort(ends, 1), axis=0, return_inverse=True)
    order = np.argsort(edge.ravel(), kind="stable")
    out: list[list[int]] = [[] for _ in part.faces]
    for a, b in zip(order[:-1], order[1:], strict=True):
        if edge.ravel()[a] == edge.ravel()[b] and owner[a] != owner[b]:
            out[owner[a]].append(int(owner[b]))
            out[owner[b]].append(int(owner[a]))
    return out


def _laid(corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Points (c, 3) along a normal into the plane, turned into their smallest box."""
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, normal)
    right /= max(float(np.linalg.norm(right)), 1e-30)
    flat = np.stack([corners @ right, corners @ np.cross(normal, right)], 1)
    scale = max(float(np.abs(flat).max()), 1e-12)
    angle = np.radians(cv2.minAreaRect((flat / scale).astype(np.float32))[2])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    flat = flat @ turn
    wide, high = np.ptp(flat, axis=0)
    if high > wide:
        flat = flat @ np.array([[0.0, 1.0], [-1.0, 0.0]])  # a quarter turn
    return flat - flat.min(0)
