"""How far a built shape is from target points: residuals both ways, smooth in the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from procmodels.shape import Shape


@dataclass(frozen=True)
class Places:
    """Fixed places on a shape's surface, so that small changes of the shape move them smoothly.

    triangle (k,) int, weights (k, 3) barycentric, area (k,) of each place's triangle when it was chosen
    """

    triangle: np.ndarray
    weights: np.ndarray
    area: np.ndarray
    count: int  # triangles of the shape they belong to


@dataclass(frozen=True)
class Body:
    """A built shape as arrays: corners (m, 3, 3) of its triangles, canonical units."""

    corners: np.ndarray

    @staticmethod
    def of(shape: Shape) -> Body:
        """The triangles of a shape."""
        return Body(shape.vertices()[shape.triangles()])

    @cached_property
    def areas(self) -> np.ndarray:
        """(m,) areas."""
        a, b, c = self.corners.transpose(1, 0, 2)
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2

    @cached_property
    def scene(self) -> Any:
        """For closest points; open3d's, in 32 bits."""
        import open3d as o3d

        tensor: Any = o3d.core.Tensor
        scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        flat = np.ascontiguousarray(self.corners.reshape(-1, 3), np.float32)
        scene.add_triangles(tensor(flat), tensor(np.arange(len(flat), dtype=np.uint32).reshape(-1, 3)))
        return scene

    def closest(self, points: np.ndarray) -> np.ndarray:
        """(n, 3), the nearest place on the surface to each of the (n, 3) points."""
        import open3d as o3d

        tensor: Any = o3d.core.Tensor
        query = tensor(np.ascontiguousarray(points, np.float32))
        return self.scene.compute_closest_points(query, nthreads=1)["points"].numpy().astype(float)

    def places(self, count: int, seed: int = 0) -> Places:
        """`count` places spread evenly by area."""
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


class Score:
    """Residuals between target points (n, 3), canonical units, and a body.

    weight   of model-to-target distances beside target-to-model ones
    dead     canonical units, distance from a model's point to the target that means nothing (gaps of sparse clouds)
    surface  the target's own triangles when they are known: exact where points leave a floor
    reach    canonical units: what is farther counts no more than this (parts that the model cannot express)
    """

    def __init__(
        self,
        points: np.ndarray,
        count: int,
        dead: float = 0.0,
        reach: float = np.inf,
        seed: int = 0,
        surface: Body | None = None,
    ) -> None:
        rng = np.random.default_rng(seed)
        self.points = points
        self.some = points[rng.permutation(len(points))[:count]]
        self.surface = surface
        self.count, self.dead, self.reach, self.seed = count, dead, reach, seed

    @cached_property
    def tree(self) -> cKDTree:
        """Of all target points."""
        return cKDTree(self.points)

    def nearest(self, queries: np.ndarray) -> np.ndarray:
        """(k, 3), the target's nearest place to each query."""
        return self.points[self.tree.query(queries)[1]] if self.surface is None else self.surface.closest(queries)

    def places(self, body: Body) -> Places:
        """Places for the distances from the body to the target."""
        return body.places(self.count, self.seed)

    def residuals(self, body: Body, places: Places, move: np.ndarray | None = None) -> np.ndarray:
        """(6 count,) or less: vectors between nearest points, scaled so that their squares sum to the score.

        move (4, 4) is a similarity target_from_body; None is the identity.
        """
        if places.count != len(body.corners):
            places = self.places(body)  # another topology
        own, growth = body.at(places)
        points, scale = self.some, 1.0
        if move is not None:
            scale = float(np.linalg.norm(move[:3, 0]))
            own = own @ move[:3, :3].T + move[:3, 3]
            points = (points - move[:3, 3]) @ move[:3, :3] / scale**2
        there = scale * (points - body.closest(points))
        back = own - self.nearest(own)
        length = np.linalg.norm(back, axis=1, keepdims=True)
        # Beyond the gaps in full; within them a hint is left, so that nothing is flat.
        share = np.sqrt(np.maximum(1 - self.dead / np.maximum(length, 1e-9), 0) ** 2 + (0.05 if self.dead else 0))
        area = np.sqrt(growth / growth.sum())[:, None]
        return np.concatenate(
            [(self._cut(there) / np.sqrt(len(there))).ravel(), (self._cut(back * share) * area).ravel()]
        )

    def _cut(self, vectors: np.ndarray) -> np.ndarray:
        if not np.isfinite(self.reach):
            return vectors
        length = np.linalg.norm(vectors, axis=1, keepdims=True)
        return vectors * np.minimum(1, self.reach / np.maximum(length, 1e-12))

    def __call__(self, body: Body, move: np.ndarray | None = None) -> float:
        """The score: a chamfer distance."""
        return float(np.square(self.residuals(body, self.places(body), move)).sum())
