"""A surface as a target: points with or without their mesh, or a grid of voxels; distances both ways."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from datasets.voxels import surface_grid
from procmodels.shape import Shape
from recon.fitting.state import Jacobian, Posed
from recon.geometry.triangles import Places, Triangles, area_slopes

HINT = 0.05  # of squared distances within the gaps of a sparse cloud: nothing is flat


class Surfaces:
    """The surfaces of the last shapes, in their own frames: many states differ in their places alone."""

    def __init__(self, kept: int = 128) -> None:
        self.kept = kept
        self._known: dict[int, tuple[Shape, Triangles, np.ndarray]] = {}

    def of(self, shape: Shape) -> tuple[Triangles, np.ndarray]:
        """The surface, and its triangles as (m, 3) numbers of vertices."""
        if id(shape) not in self._known:
            if len(self._known) >= self.kept:
                self._known.clear()
            triangles = shape.triangles()
            self._known[id(shape)] = shape, Triangles(shape.vertices()[triangles]), triangles
        return self._known[id(shape)][1:]


class OnSurface:
    """A posed shape's surface, in the shape's frame, and the places on it that are compared."""

    def __init__(self, surfaces: Surfaces, posed: Posed, at: Posed, count: int) -> None:
        self.posed = posed
        self.turn = posed.target_from_shape[:3, :3]
        self.scale = float(np.linalg.norm(self.turn[:, 0]))
        self.surface, self.triangles = surfaces.of(posed.shape)
        other, triangles = surfaces.of(at.shape)
        # Other triangles, when a part of no height came or went.
        self.places = (other if len(triangles) == len(self.triangles) else self.surface).places(count)
        own, self.growth = self.surface.at(self.places)
        self.points = posed.in_target(own)

    def reached(self, points: np.ndarray) -> tuple[np.ndarray, Places, np.ndarray, np.ndarray]:
        """From points (n, 3) of the target's frame to the nearest on the shape: distances (n,) and unit vectors (n, 3)
        in the target's frame, the places, and the vectors as `speeds` wants them."""
        in_shape = (points - self.posed.target_from_shape[:3, 3]) @ self.turn / self.scale**2
        nearest, places, normal = self.surface.nearest(in_shape)
        way, length = directions(nearest - in_shape, normal)
        return length * self.scale, places, way @ self.turn.T / self.scale, way * self.scale

    def speeds(self, places: Places, way: np.ndarray, velocities: np.ndarray) -> np.ndarray:
        """(m, k) of places along vectors (m, 3) of the shape's frame, for vertices that move by (n, 3, k)."""
        corners = velocities[self.triangles[places.triangle]]  # (m, 3, 3, k)
        return np.einsum("mi,mj,mijk->mk", places.weights, way, corners, optimize=True)

    def shares(self) -> np.ndarray:
        """(m,) roots of the places' shares of the whole, by the area that each stands for."""
        return np.sqrt(self.growth / self.growth.sum())

    def share_slopes(self, velocities: np.ndarray) -> np.ndarray:
        """(m, k) derivatives of `shares`."""
        used, where = np.unique(self.places.triangle, return_inverse=True)
        grown = area_slopes(self.surface.corners[used], velocities[self.triangles[used]])[where]
        grown = grown / np.maximum(self.places.area, 1e-12)[:, None]
        relative = grown / np.maximum(self.growth, 1e-12)[:, None] - grown.sum(0) / self.growth.sum()
        return self.shares()[:, None] * relative / 2


class Surface:
    """Surface points (n, 3) in the target's frame, in canonical units.

    counts   points each way that are compared, a level each; the last decides
    mesh     the target's own triangles when they are known: exact where points leave a floor
    dead     distance from a shape's place to the target that means nothing (gaps of sparse clouds)
    reach    what is farther counts no more than this (parts that the model cannot express)
    """

    weight = 1.0
    usual = 5e-7
    noise = 1e-4

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
        self._surfaces = Surfaces()

    def residuals(self, posed: Posed, level: int, at: Posed) -> np.ndarray:
        """Distances from the target's points to the shape and from its places back; the squares sum to the loss."""
        shape, some = OnSurface(self._surfaces, posed, at, self.counts[level]), self._some[level]
        there = shape.reached(some)[0]
        back = np.linalg.norm(shape.points - self._nearest(shape.points)[0], axis=1)
        met = np.minimum(there, self.reach) / np.sqrt(len(some))
        return np.concatenate([met, np.minimum(self._beyond_gaps(back), self.reach) * shape.shares()])

    def linearised(self, posed: Posed, level: int, velocities: np.ndarray) -> tuple[np.ndarray, Jacobian]:
        """The residuals and their derivatives. A nearest place is nearest: sliding along the surface does not help."""
        shape, some = OnSurface(self._surfaces, posed, posed, self.counts[level]), self._some[level]
        there, places, _, way = shape.reached(some)
        to_shape = shape.speeds(places, way * ((there < self.reach) / np.sqrt(len(some)))[:, None], velocities)
        target, normal = self._nearest(shape.points)
        way, back = directions(shape.points - target, normal)
        far = self._beyond_gaps(back)
        steep = (np.maximum(back - self.dead, 0) + (HINT if self.dead else 0) * back) / np.maximum(far, 1e-12)
        steep = np.where(back > 0, steep, 1.0) * (far < self.reach) * shape.shares()
        to_target = shape.speeds(shape.places, way @ shape.turn * steep[:, None], velocities)
        to_target += np.minimum(far, self.reach)[:, None] * shape.share_slopes(velocities)
        here = np.concatenate(
            [np.minimum(there, self.reach) / np.sqrt(len(some)), np.minimum(far, self.reach) * shape.shares()]
        )
        return here, Jacobian.of(np.concatenate([to_shape, to_target]))

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


def directions(vectors: np.ndarray, otherwise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
    usual = 0.0
    noise = 0.01

    def __init__(self, grid: np.ndarray, count: int = 1_000, centred: float = 0.15) -> None:
        self.grid, self.count, self.centred = grid, count, centred
        self.half = 0.5 / len(grid)
        filled = np.argwhere(grid)
        some = np.random.default_rng(0).permutation(len(filled))[:count]
        self.points = self._centres(filled[some])
        self._surfaces = Surfaces()
        self._filled = np.stack(distance_transform_edt(~grid, return_distances=False, return_indices=True), -1)

    def _centres(self, index: np.ndarray) -> np.ndarray:
        return (index + 0.5) / len(self.grid) - 0.5

    def _back(self, shape: OnSurface) -> np.ndarray:
        """(count, 3) from the nearest filled voxels' centres to places on the shape."""
        voxel = np.clip(((shape.points + 0.5) * len(self.grid)).astype(int), 0, len(self.grid) - 1)
        return shape.points - self._centres(self._filled[tuple(voxel.T)])

    def residuals(self, posed: Posed, level: int, at: Posed) -> np.ndarray:
        """Vectors between voxels and surface, both ways; the squares sum to a chamfer distance."""
        shape = OnSurface(self._surfaces, posed, at, self.count)
        distance, _, way, _ = shape.reached(self.points)
        return self._beyond(self._vectors(distance[:, None] * way, self._back(shape)), level)

    def _vectors(self, there: np.ndarray, back: np.ndarray) -> np.ndarray:
        """Both ways' vectors one after the other, over the roots of their numbers; derivatives likewise."""
        n, m = len(self.points), self.count
        parts = there.reshape(3 * n, *there.shape[2:]) / np.sqrt(n), back.reshape(3 * m, *back.shape[2:]) / np.sqrt(m)
        return np.concatenate(parts)

    def _halves(self) -> np.ndarray:
        """Half a voxel, scaled as the vectors are."""
        return self.half / np.sqrt(np.repeat([len(self.points), self.count], [3 * len(self.points), 3 * self.count]))

    def linearised(self, posed: Posed, level: int, velocities: np.ndarray) -> tuple[np.ndarray, Jacobian]:
        """The residuals and their derivatives; a place on the shape keeps its voxel."""
        shape = OnSurface(self._surfaces, posed, posed, self.count)
        distance, places, way, along = shape.reached(self.points)
        there = way[..., None] * shape.speeds(places, along, velocities)[:, None]
        axes = [shape.speeds(shape.places, np.tile(row, (self.count, 1)), velocities) for row in shape.turn]
        out = self._vectors(there, np.stack(axes, 1))
        vectors = self._vectors(distance[:, None] * way, self._back(shape))
        if level > 0:
            out = np.concatenate([out * (np.abs(vectors) > self._halves())[:, None], self.centred * out])
        return self._beyond(vectors, level), Jacobian.of(out)

    def _beyond(self, vectors: np.ndarray, level: int) -> np.ndarray:
        """What counts of vectors at a level."""
        if level == 0:
            return vectors
        beyond = np.sign(vectors) * np.maximum(np.abs(vectors) - self._halves(), 0)
        return np.concatenate([beyond, self.centred * vectors])

    def loss(self, posed: Posed) -> float:
        """Share of differing voxels among those that are filled in the target."""
        drawn = surface_grid(posed.in_target(posed.shape.vertices()), posed.shape.triangles())
        return float(np.count_nonzero(drawn ^ self.grid) / max(1, np.count_nonzero(self.grid)))
