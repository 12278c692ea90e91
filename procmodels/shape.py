"""A built shape: named parts, in plain arrays. Knows nothing of Blender."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import trimesh

Polygon = tuple[int, ...]


@dataclass(frozen=True)
class Part:
    """One named piece of a shape.

    vertices  (n, 3) float
    faces     convex polygons, counter-clockwise seen from outside, as tuples of vertex numbers
    convex    True when the part is the convex hull of its vertices (silhouettes are then cheap to draw)
    """

    name: str
    vertices: np.ndarray
    faces: tuple[Polygon, ...]
    convex: bool = False

    def triangles(self) -> np.ndarray:
        """(m, 3) int, every polygon cut into a fan."""
        return _triangles(self.faces).copy()

    def moved(self, matrix: np.ndarray) -> Part:
        """The part under a (4, 4) affine transform."""
        return Part(self.name, self.vertices @ matrix[:3, :3].T + matrix[:3, 3], self.faces, self.convex)


@dataclass(frozen=True)
class Shape:
    """Parts in the canonical frame (faces -Y, Z up, bounding box centred, longest side 1)."""

    parts: tuple[Part, ...]

    def vertices(self) -> np.ndarray:
        """(n, 3) float, of all parts in order."""
        return np.concatenate([p.vertices for p in self.parts])

    def triangles(self) -> np.ndarray:
        """(m, 3) int into vertices()."""
        offsets = np.cumsum([0] + [len(p.vertices) for p in self.parts])
        return np.concatenate([p.triangles() + o for p, o in zip(self.parts, offsets, strict=False)])

    def bounds(self) -> np.ndarray:
        """(2, 3) float, lower and upper corner."""
        vertices = self.vertices()
        return np.stack([vertices.min(0), vertices.max(0)])

    def to_trimesh(self) -> trimesh.Trimesh:
        """One triangle mesh; parts stay separate components (vertices are not merged)."""
        import trimesh

        return trimesh.Trimesh(self.vertices(), self.triangles(), process=False)


def normalised(parts: list[Part]) -> Shape:
    """The parts moved and scaled to the canonical frame: bounding box centred on the origin, longest side 1."""
    vertices = np.concatenate([p.vertices for p in parts])
    low, high = vertices.min(0), vertices.max(0)
    scale = 1 / (high - low).max()
    moved = vertices * scale - (low + high) / 2 * scale
    ends = np.cumsum([len(p.vertices) for p in parts])
    return Shape(
        tuple(Part(p.name, moved[e - len(p.vertices) : e], p.faces, p.convex) for p, e in zip(parts, ends, strict=True))
    )


@lru_cache(maxsize=4096)
def _triangles(faces: tuple[Polygon, ...]) -> np.ndarray:
    """Once for all parts of one kind: their faces depend on counts alone."""
    return np.array([(f[0], f[i], f[i + 1]) for f in faces for i in range(1, len(f) - 1)], int)
