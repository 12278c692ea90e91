"""Triangles as a surface: the nearest place to a point, and places that move with the triangles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from procmodels.shape import Shape


@dataclass(frozen=True)
class Places:
    """Places on a surface of so many triangles.

    triangle (k,) int, weights (k, 3) barycentric, area (k,) of each place's triangle when it was chosen
    """

    triangle: np.ndarray
    weights: np.ndarray
    area: np.ndarray
    triangles: int


@dataclass(frozen=True)
class Triangles:
    """corners (m, 3, 3) float."""

    corners: np.ndarray

    @staticmethod
    def of(shape: Shape) -> Triangles:
        """A shape's, in its own frame."""
        return Triangles(shape.vertices()[shape.triangles()])

    @cached_property
    def areas(self) -> np.ndarray:
        """(m,) areas."""
        return areas(self.corners)

    @cached_property
    def scene(self) -> Any:
        """For closest points; open3d's, in 32 bits."""
        import open3d as o3d

        tensor: Any = o3d.core.Tensor
        scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        flat = np.ascontiguousarray(self.corners.reshape(-1, 3), np.float32)
        scene.add_triangles(tensor(flat), tensor(np.arange(len(flat), dtype=np.uint32).reshape(-1, 3)))
        return scene

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, Places, np.ndarray]:
        """The nearest point (n, 3) to each of (n, 3) points, its place, and its triangle's normal (n, 3)."""
        import open3d as o3d

        tensor: Any = o3d.core.Tensor
        found = self.scene.compute_closest_points(tensor(np.ascontiguousarray(points, np.float32)), nthreads=1)
        triangle = found["primitive_ids"].numpy().astype(int)
        u, v = found["primitive_uvs"].numpy().astype(float).T
        places = Places(triangle, np.stack([1 - u - v, u, v], 1), self.areas[triangle], len(self.corners))
        return found["points"].numpy().astype(float), places, found["primitive_normals"].numpy().astype(float)

    def places(self, count: int, seed: int = 0) -> Places:
        """`count` places spread evenly by area."""
        if (count, seed) not in self._places:
            self._places[count, seed] = self._spread(count, seed)
        return self._places[count, seed]

    @cached_property
    def _places(self) -> dict[tuple[int, int], Places]:
        return {}

    def _spread(self, count: int, seed: int) -> Places:
        rng = np.random.default_rng(seed)
        ends = np.cumsum(self.areas)
        where = (np.arange(count) + rng.random(count)) / count * ends[-1]
        chosen = np.minimum(np.searchsorted(ends, where), len(ends) - 1)
        u, v = rng.random((2, count))
        root = np.sqrt(u)
        weights = np.stack([1 - root, root * (1 - v), root * v], 1)
        return Places(chosen, weights, self.areas[chosen], len(self.corners))

    def at(self, places: Places) -> tuple[np.ndarray, np.ndarray]:
        """Points (k, 3) at these places, and the share (k,) by which the surface round each has grown."""
        points = np.einsum("ki,kij->kj", places.weights, self.corners[places.triangle])
        return points, self.areas[places.triangle] / np.maximum(places.area, 1e-12)


def areas(corners: np.ndarray) -> np.ndarray:
    """(m,) of triangles (m, 3, 3)."""
    a, b, c = corners.transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def area_slopes(corners: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """(m, k) derivatives of the areas of triangles (m, 3, 3) whose corners move by velocities (m, 3, 3, k)."""
    a, b, c = corners.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    # Each corner moves the area by half the opposite side's length, towards or away from that side.
    sides = np.stack([np.cross(c - b, normal), np.cross(a - c, normal), np.cross(b - a, normal)], 1)
    return -np.einsum("mij,mijk->mk", sides, velocities) / 2
