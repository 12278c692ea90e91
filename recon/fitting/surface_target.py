"""A surface as a target: points with or without their mesh, or a grid of voxels; distances both ways."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from datasets.voxels import surface_grid
from recon.fitting.problem import Posed
from recon.geometry.triangles import Places, Triangles, area_slopes

HINT = 0.05  # of squared distances within the gaps of a sparse cloud: nothing is flat


class OnSurface:
    """A posed shape's surface in the target's frame, and the places on it that are compared."""

    def __init__(self, posed: Posed, at: Posed, count: int) -> None:
        self.triangles = posed.shape.triangles()
        self.surface = Triangles(posed.in_target(posed.shape.vertices())[self.triangles])
        other = self.surface if at is posed else Triangles(at.in_target(at.shape.vertices())[at.shape.triangles()])
        # Other triangles, when a part of no height came or went.
        self.places = (other if len(other.corners) == len(self.triangles) else self.surface).places(count)
        self.points, self.growth = self.surface.at(self.places)
        self.turn = posed.target_from_shape[:3, :3]

    def speeds(self, places: Places, velocities: np.ndarray) -> np.ndarray:
        """(m, 3, k) of places in the target's frame, for vertices that move by (n, 3, k) in the shape's."""
        corners = velocities[self.triangles[places.triangle]]  # (m, 3, 3, k)
        return np.einsum("mi,mijk,lj->mlk", places.weights, corners, self.turn, optimize=True)

    def shares(self) -> np.ndarray:
        """(m,) roots of the places' shares of the whole, by the area that each stands for."""
        return np.sqrt(self.growth / self.growth.sum())

    def share_slopes(self, velocities: np.ndarray) -> np.ndarray:
        """(m, k) derivatives of `shares`."""
        moved = np.einsum("mijk,lj->milk", velocities[self.triangles[self.places.triangle]], self.turn, optimize=True)
        grown = area_slopes(self.surface.corners[self.places.triangle], moved)
        grown /= np.maximum(self.places.area, 1e-12)[:, None]
        share = self.shares()[:, None]
        relative = grown / np.maximum(self.growth, 1e-12)[:, None] - grown.sum(0) / self.growth.sum()
        return share * relative / 2


class Surface:
    """Surface points (n, 3) in the target's frame, in canonical units.

    counts   points each way that are compared, a level each; the last decides
    mesh     the target's own triangles when they are known: exact where points leave a floor
    dead     distance from a shape's place to the target that means nothing (gaps of sparse clouds)
    reach    what is farther counts no more than this (parts that the model cannot express)
    """

    weight = 1.0

    def __init__(
        self,
        points: np.ndarray,
        counts: Sequence[int],
        mesh: Triangles | None = None,
        dead: float = 0.0,
        reach: float = np.inf,
    ) -> None:
        order = np.random.default_rng(0).permutation(len(points))
        self.points, self.counts, self.mesh, self.dead, self.reach = points, tuple(counts), mesh, dead, reach
        self.levels = len(self.counts)
        self._some = [points[order[:n]] for n in self.counts]
        self._tree = cKDTree(points)

    def residuals(self, posed: Posed, level: int, at: Posed) -> np.ndarray:
        """Distances from the target's points to the shape and from its places back; the squares sum to the loss."""
        shape, some = OnSurface(posed, at, self.counts[level]), self._some[level]
        there = np.linalg.norm(some - shape.surface.nearest(some)[0], axis=1)
        back = np.linalg.norm(shape.points - self._nearest(shape.points)[0], axis=1)
        met = np.minimum(there, self.reach) / np.sqrt(len(some))
        return np.concatenate([met, np.minimum(self._beyond_gaps(back), self.reach) * shape.shares()])

    def jacobian(self, posed: Posed, level: int, velocities: np.ndarray) -> np.ndarray:
        """Derivatives of the residuals. A nearest place is nearest because sliding along the surface does not help."""
        shape, some = OnSurface(posed, posed, self.counts[level]), self._some[level]
        nearest, places, normal = shape.surface.nearest(some)
        way, there = _directions(nearest - some, normal)
        to_shape = np.einsum("mj,mjk->mk", way, shape.speeds(places, velocities))
        to_shape *= ((there < self.reach) / np.sqrt(len(some)))[:, None]
        target, normal = self._nearest(shape.points)
        way, back = _directions(shape.points - target, normal)
        to_target = np.einsum("mj,mjk->mk", way, shape.speeds(shape.places, velocities))
        far = self._beyond_gaps(back)
        steep = (np.maximum(back - self.dead, 0) + (HINT if self.dead else 0) * back) / np.maximum(far, 1e-12)
        steep = np.where(back > 0, steep, 1.0) * (far < self.reach) * shape.shares()
        to_target = to_target * steep[:, None]
        to_target += np.minimum(far, self.reach)[:, None] * shape.share_slopes(velocities)
        return np.concatenate([to_shape, to_target])

    def loss(self, posed: Posed) -> float:
        """A chamfer distance, the sum of both ways' mean squares, by the last level's points."""
        return float(np.square(self.residuals(posed, self.levels - 1, posed)).sum())

    def _nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The target's nearest point to each of (k, 3), and the normal there, or (0, 0, 0) where it has none."""
        if self.mesh is None:
            return self.points[self._tree.query(points)[1]], np.zeros_like(points)
        found, _, normal = self.mesh.nearest(points)
        return found, normal

    def _beyond_gaps(self, distance: np.ndarray) -> np.ndarray:
        """Beyond the gaps in full; within them a hint is left."""
        if not self.dead:
            return distance
        return np.sqrt(np.maximum(distance - self.dead, 0) ** 2 + HINT * distance**2)


def _directions(vectors: np.ndarray, otherwise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (m, 3) and lengths (m,); the other direction where there is hardly any length."""
    length = np.linalg.norm(vectors, axis=1)
    return np.where((length > 1e-6)[:, None], vectors / np.maximum(length, 1e-6)[:, None], otherwise), length


class VoxelGrid:
    """A surface grid (R, R, R) bool in the canonical frame.

    Filled voxels look for the surface and places on the surface look for filled voxels. At first distances between
    centres and surface count, then those beyond the voxels' borders: within a voxel the surface may lie anywhere, and
    only `centred` of its distance to the middle counts.
    """

    levels = 2
    weight = 1.0

    def __init__(self, grid: np.ndarray, count: int = 1_000, centred: float = 0.15) -> None:
        self.grid, self.count, self.centred = grid, count, centred
        self.half = 0.5 / len(grid)
        filled = np.argwhere(grid)
        some = np.random.default_rng(0).permutation(len(filled))[:count]
        self.points = self._centres(filled[some])
        self._filled = np.stack(distance_transform_edt(~grid, return_distances=False, return_indices=True), -1)

    def _centres(self, index: np.ndarray) -> np.ndarray:
        return (index + 0.5) / len(self.grid) - 0.5

    def _back(self, shape: OnSurface) -> np.ndarray:
        """(count, 3) from the nearest filled voxels' centres to places on the shape."""
        voxel = np.clip(((shape.points + 0.5) * len(self.grid)).astype(int), 0, len(self.grid) - 1)
        return shape.points - self._centres(self._filled[tuple(voxel.T)])

    def residuals(self, posed: Posed, level: int, at: Posed) -> np.ndarray:
        """Vectors between voxels and surface, both ways; the squares sum to a chamfer distance."""
        shape = OnSurface(posed, at, self.count)
        there = shape.surface.nearest(self.points)[0] - self.points
        back = self._back(shape)
        vectors = np.concatenate([there.ravel() / np.sqrt(len(there)), back.ravel() / np.sqrt(len(back))])
        if level == 0:
            return vectors
        half = self.half / np.sqrt(np.repeat([len(there), len(back)], [there.size, back.size]))
        return np.concatenate([np.sign(vectors) * np.maximum(np.abs(vectors) - half, 0), self.centred * vectors])

    def jacobian(self, posed: Posed, level: int, velocities: np.ndarray) -> np.ndarray:
        """Derivatives of the residuals."""
        shape = OnSurface(posed, posed, self.count)
        nearest, places, normal = shape.surface.nearest(self.points)
        way, _ = _directions(nearest - self.points, normal)
        speed = np.einsum("mj,mjk->mk", way, shape.speeds(places, velocities))
        k = velocities.shape[-1]
        there = (way[..., None] * speed[:, None]).reshape(-1, k) / np.sqrt(len(way))
        back = shape.speeds(shape.places, velocities).reshape(-1, k) / np.sqrt(self.count)
        out = np.concatenate([there, back])
        if level == 0:
            return out
        vectors = np.concatenate([(nearest - self.points).ravel(), self._back(shape).ravel()])
        return np.concatenate([out * (np.abs(vectors) > self.half)[:, None], self.centred * out])

    def loss(self, posed: Posed) -> float:
        """Share of differing voxels among those that are filled in the target."""
        drawn = surface_grid(posed.in_target(posed.shape.vertices()), posed.shape.triangles())
        return float(np.count_nonzero(drawn ^ self.grid) / max(1, np.count_nonzero(self.grid)))
