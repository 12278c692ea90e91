"""What an exact search compares a built shape with when its place is known: four masks, or a surface grid.

Each target answers twice: `residuals`, smooth enough for derivatives, coarse to fine; and `loss`, counted in pixels or
voxels, which is 0 for the true parameters and decides what is accepted.
"""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from datasets.voxels import surface_grid
from procmodels.shape import Shape
from recon.fitting.chamfer_residuals import Body
from recon.geometry.raster import coverage, silhouettes


class ExactTarget(Protocol):
    """levels = how many kinds of residuals there are, 0 the coarsest; good = loss that leaves few doubts of choices;
    lost = loss of an answer that is not even near."""

    levels: int
    good: float
    lost: float

    def residuals(self, shape: Shape, level: int, reference: Shape) -> np.ndarray:
        """(n,); `reference` is the shape that derivatives are taken at, of the same parts."""

    def loss(self, shape: Shape) -> float:
        """Share that differs: 0 is a shape that cannot be told from the true one."""


class MaskTarget:
    """Masks (V, H, W) bool of the shape in cameras K (V, 3, 3), cam_from_canonical (V, 4, 4); sides of 4 n pixels."""

    good = 1.5e-4  # ten pixels of four masks of 128 x 128
    lost = 5e-3
    shrink = (4, 2, 1)  # a level's pixels are the means of so many, along each side

    def __init__(self, masks: np.ndarray, K: np.ndarray, cam_from_canonical: np.ndarray) -> None:
        self.masks, self.K, self.poses = masks, K, cam_from_canonical
        self.levels = len(self.shrink)
        views, height, width = masks.shape
        self.sizes = np.tile((width, height), (views, 1))
        self._small = []
        for n in self.shrink:
            scaled = K.copy()
            scaled[:, :2] /= n
            means = masks.reshape(views, height // n, n, width // n, n).mean((2, 4), dtype=np.float32)
            self._small.append((means, scaled, self.sizes // n))

    def residuals(self, shape: Shape, level: int, reference: Shape) -> np.ndarray:
        """Differences of covered shares, whose squares sum to the mean over pixels."""
        means, K, sizes = self._small[level]
        difference = np.stack(coverage(shape, K, self.poses, sizes)) - means
        if level == 0:
            # A leg that missed its place by its own width must still feel it.
            difference = np.stack([cv2.blur(d, (3, 3)) for d in difference])
        return difference.ravel() / np.sqrt(difference.size)

    def loss(self, shape: Shape) -> float:
        """Share of the pixels that differ."""
        return float(np.mean(np.stack(silhouettes(shape, self.K, self.poses, self.sizes)) != self.masks))


class GridTarget:
    """A surface grid (R, R, R) bool in the canonical frame.

    Filled voxels look for the surface and places on the surface look for filled voxels. At first distances between
    centres and surface count, then those beyond the voxels' borders: within a voxel the surface may lie anywhere.
    """

    levels = 2
    good = 1e-3  # some five voxels
    lost = 0.1

    def __init__(self, grid: np.ndarray, count: int = 1_000, centred: float = 0.15) -> None:
        self.grid, self.count, self.centred = grid, count, centred
        self.resolution = len(grid)
        self.half = 0.5 / self.resolution
        filled = np.argwhere(grid)
        some = np.random.default_rng(0).permutation(len(filled))[:count]
        self.points = self._centres(filled[some])
        self.nearest = np.stack(distance_transform_edt(~grid, return_distances=False, return_indices=True), -1)

    def _centres(self, index: np.ndarray) -> np.ndarray:
        return (index + 0.5) / self.resolution - 0.5

    def residuals(self, shape: Shape, level: int, reference: Shape) -> np.ndarray:
        """Vectors between voxels and surface, both ways; the squares sum to a chamfer distance."""
        body = Body.of(shape)
        places = Body.of(reference).places(self.count)
        if places.count != len(body.corners):  # a part of no height came or went
            places = body.places(self.count)
        own, _ = body.at(places)
        voxel = np.clip(((own + 0.5) * self.resolution).astype(int), 0, self.resolution - 1)
        there = (body.closest(self.points) - self.points) / np.sqrt(len(self.points))
        back = (own - self._centres(self.nearest[tuple(voxel.T)])) / np.sqrt(self.count)
        vectors = np.concatenate([there.ravel(), back.ravel()])
        if level == 0:
            return vectors
        half = self.half / np.sqrt(np.repeat([len(self.points), self.count], [there.size, back.size]))
        return np.concatenate([np.sign(vectors) * np.maximum(np.abs(vectors) - half, 0), self.centred * vectors])

    def loss(self, shape: Shape) -> float:
        """Share of differing voxels among those that are filled in the target."""
        return float(
            np.count_nonzero(surface_grid(shape.vertices(), shape.triangles()) ^ self.grid)
            / max(1, np.count_nonzero(self.grid))
        )
