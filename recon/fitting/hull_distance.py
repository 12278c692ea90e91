"""How far a shape lies from silhouettes, in space instead of pixels: what sticks out of the hull, what it leaves empty.

An overlap of outlines says little about an object that the model cannot express: a thick leg that covers a thin one is
all but lost pixels, wherever it stands. Distances say how wrong it is. Of the shape's surface, what lies outside the
visual hull counts by its distance to the hull; of the hull's surface, what the shape's outlines leave uncovered counts
by its distance to them, in the view where it is largest. What the views cannot tell (under a bed) costs nothing either
way. The sum is close to the chamfer distance of the two visual hulls, at the price of drawing the outlines.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import map_coordinates
from skimage.measure import marching_cubes

from recon.fitting.chamfer_residuals import Body
from recon.geometry.object_windows import Crops
from recon.scene import Canonical, ReconstructionError, cam_from_canonical

MARGIN = 0.06  # of the canonical box, on each side: an object may be a little larger than its first box


class HullDistance:
    """The visual hull of windows in the canonical frame of `canonical`, and distances to and from it.

    field      (n, n, n) float32, distance to the hull's surface in canonical units, positive inside; outside it is the
               largest of the views' distances, hence a little less than the true one
    triangles  (m, 3, 3) float, the hull's surface
    points     (k, 3) float, places spread over it
    """

    def __init__(
        self,
        carved: Crops,
        drawn: Crops,
        canonical: Canonical,
        ground: float,
        forgiving: bool = False,
        cells: int = 96,
        points: int = 1500,
    ) -> None:
        """Carve with large windows, so that thin legs last; a shape's outlines will be drawn into the windows `drawn`.

        ground     height of the floor in the canonical frame: cameras above it do not see what would be below
        forgiving  one view may miss a place: a hole in a single mask must not go through the hull
        Raises ReconstructionError when nothing is left.
        """
        self.cells, self.side = cells, 1 + 2 * MARGIN
        self.field = self._carved(carved, cam_from_canonical(carved.cameras, canonical), forgiving)
        heights = ((np.arange(cells) + 0.5) / cells - 0.5) * self.side
        self.field = np.minimum(self.field, (heights - ground).astype(np.float32))
        padded = np.pad(self.field, 1, constant_values=-1.0)
        if self.field.max() <= 0:
            raise ReconstructionError("the silhouettes have no common inside; check them or give your own with --masks")
        vertices, faces, _, _ = marching_cubes(padded, 0.0)
        self.triangles = ((vertices - 0.5) / cells * self.side - self.side / 2)[faces].astype(float)
        body = Body(self.triangles)
        self.points = body.at(body.places(points))[0]
        self._find_pixels(drawn, cam_from_canonical(drawn.cameras, canonical))

    def _carved(self, crops: Crops, poses: np.ndarray, forgiving: bool) -> np.ndarray:
        """The field: the least of the views' signed distances at every cell's centre, or the least but one."""
        n = self.cells
        axis = ((np.arange(n) + 0.5) / n - 0.5) * self.side
        centres = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3).astype(np.float32)
        field = np.full(len(centres), np.inf, np.float32)
        second = field.copy()
        possible = (crops.masks >= 0.5) | ~crops.valid
        for K, pose, mask in zip(crops.cameras.K, poses, possible, strict=True):
            signed = _distance(mask) - _distance(~mask)
            projected = centres @ (K @ pose[:3, :3]).T.astype(np.float32) + (K @ pose[:3, 3]).astype(np.float32)
            depth = np.maximum(projected[:, 2], 1e-3)
            u, v = ((projected[:, i] / depth - 0.5).reshape(-1, n) for i in (0, 1))
            seen = cv2.remap(signed, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).ravel()
            seen = seen * depth / np.float32(K[0, 0])
            np.minimum(second, np.maximum(field, seen), out=second)
            np.minimum(field, seen, out=field)
        return (second if forgiving else field).reshape(n, n, n)

    def _find_pixels(self, crops: Crops, poses: np.ndarray) -> None:
        """Where each point is seen: flat pixel (V, k), and canonical units a pixel there, 0 where nothing is known."""
        views, size = crops.valid.shape[:2]
        self._pixel = np.zeros((views, len(self.points)), int)
        self._unit = np.zeros((views, len(self.points)))
        for i in range(views):
            projected = (self.points @ poses[i, :3, :3].T + poses[i, :3, 3]) @ crops.cameras.K[i].T
            column, row = np.floor(projected[:, :2] / np.maximum(projected[:, 2:], 1e-3)).astype(int).T
            inside = (column >= 0) & (column < size) & (row >= 0) & (row < size) & (projected[:, 2] > 1e-3)
            self._pixel[i] = np.where(inside, row * size + column, 0)
            known = inside & crops.valid[i].ravel()[self._pixel[i]]
            self._unit[i] = np.where(known, projected[:, 2] / crops.cameras.K[i, 0, 0], 0)

    def sticking_out(self, points: np.ndarray) -> np.ndarray:
        """(k,) canonical units by which places (k, 3) of a shape lie outside the hull; 0 inside."""
        where = (points / self.side + 0.5) * self.cells - 0.5
        inside = np.clip(where, 0, self.cells - 1)
        beyond = np.linalg.norm(where - inside, axis=1) * self.side / self.cells
        return np.maximum(-map_coordinates(self.field, inside.T, order=1), 0) + beyond

    def left_empty(self, drawn: np.ndarray) -> np.ndarray:
        """(k,) canonical units by which `points` lie outside a shape's outlines (V, S, S) bool, in the worst view."""
        worst = np.zeros(len(self.points))
        for image, pixel, unit in zip(drawn, self._pixel, self._unit, strict=True):
            np.maximum(worst, _distance(~image).ravel()[pixel] * unit, out=worst)
        return worst


def _distance(mask: np.ndarray) -> np.ndarray:
    """(S, S) float32: of True pixels, distance to the nearest edge between True and False."""
    if mask.all():
        return np.full(mask.shape, float(sum(mask.shape)), np.float32)  # no edge in the window
    found = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    return np.maximum(found - np.float32(0.5), 0)
