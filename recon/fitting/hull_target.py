"""The visual hull of silhouettes as a target: what of a shape sticks out of it, and what it leaves empty.

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

from recon.fitting.state import Jacobian, Posed
from recon.fitting.surface_target import OnSurface, Surfaces
from recon.geometry.object_windows import Crops
from recon.geometry.outlines import end_gradients, outlines
from recon.geometry.raster import silhouettes
from recon.geometry.triangles import Triangles
from recon.scene import Canonical, ReconstructionError, cam_from_canonical

MARGIN = 0.06  # of the canonical box, on each side: an object may be a little larger than its first box


class Hull:
    """The visual hull of windows, in the frame of `canonical`, and distances to and from it in canonical units.

    field      (n, n, n) float32, distance to the hull's surface, positive inside; outside it is the largest of the
               views' distances, hence a little less than the true one
    triangles  (m, 3, 3) float, the hull's surface
    points     (k, 3) float, places spread over it
    """

    levels = 1
    weight = 1.0
    usual = 5e-7
    noise = 1e-4

    def __init__(
        self,
        carved: Crops,
        drawn: Crops,
        canonical: Canonical,
        ground: float,
        forgiving: bool = False,
        cells: int = 96,
        points: int = 1500,
        places: int = 1200,
    ) -> None:
        """Carve with large windows, so that thin legs last; a shape's outlines will be drawn into the windows `drawn`.

        ground     height of the floor in the canonical frame: cameras above it do not see what would be below
        forgiving  one view may miss a place: a hole in a single mask must not go through the hull
        places     on a shape's surface
        Raises ReconstructionError when nothing is left.
        """
        self.canonical, self.sizes, self.places = canonical, drawn.cameras.sizes, places
        self.box_from_world = np.linalg.inv(canonical.world_from_canonical)
        self._surfaces = Surfaces()
        self.cells, self.side = cells, 1 + 2 * MARGIN
        self.field = self._carved(carved, cam_from_canonical(carved.cameras, canonical), forgiving)
        heights = ((np.arange(cells) + 0.5) / cells - 0.5) * self.side
        self.field = np.minimum(self.field, (heights - ground).astype(np.float32))
        if self.field.max() <= 0:
            raise ReconstructionError("the silhouettes have no common inside; check them or give your own with --masks")
        self.slopes = np.gradient(self.field, self.side / cells)
        vertices, faces, _, _ = marching_cubes(np.pad(self.field, 1, constant_values=-1.0), 0.0)
        self.triangles = ((vertices - 0.5) / cells * self.side - self.side / 2)[faces].astype(float)
        surface = Triangles(self.triangles)
        self.points = surface.at(surface.places(points))[0]
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
        """Where each point is seen: (V, k, 2) in the window, its flat pixel (V, k), and canonical units a pixel there,
        0 where nothing is known."""
        views, size = crops.valid.shape[:2]
        seen = self.points @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
        projected = seen @ crops.cameras.K.transpose(0, 2, 1)
        self._seen = projected[..., :2] / np.maximum(projected[..., 2:], 1e-3)
        column, row = np.floor(self._seen).astype(int).transpose(2, 0, 1)
        inside = (column >= 0) & (column < size) & (row >= 0) & (row < size) & (projected[..., 2] > 1e-3)
        self._pixel = np.where(inside, row * size + column, 0)
        known = inside & np.take_along_axis(crops.valid.reshape(views, -1), self._pixel, 1)
        self._unit = np.where(known, projected[..., 2] / crops.cameras.K[:, 0, 0, None], 0)

    def sticking_out(self, points: np.ndarray) -> np.ndarray:
        """(k,) canonical units by which places (k, 3) lie outside the hull; 0 inside."""
        where, inside = self._cell(points)
        beyond = np.linalg.norm(where - inside, axis=1) * self.side / self.cells
        return np.maximum(-map_coordinates(self.field, inside.T, order=1), 0) + beyond

    def _cell(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places in cells of the field, and the nearest ones within it."""
        where = (points / self.side + 0.5) * self.cells - 0.5
        return where, np.clip(where, 0, self.cells - 1)

    def left_empty(self, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(k,) canonical units by which `points` lie outside outlines (V, S, S) bool in the worst view, and which."""
        pairs = zip(drawn, self._pixel, strict=True)
        distances = np.stack([_distance(~image).ravel()[pixel] for image, pixel in pairs]) * self._unit
        return distances.max(0), distances.argmax(0)

    def residuals(self, posed: Posed, level: int, at: Posed) -> np.ndarray:
        """(places + points,) distances out of the hull and in it; the squares sum to the loss."""
        shape = OnSurface(self._surfaces, posed, at, self.places)
        out = self.sticking_out(self._in_box(shape.points)) * shape.shares()
        drawn = np.stack(silhouettes(posed.shape, posed.K, posed.cam_from_shape, self.sizes))
        return np.concatenate([out, self.left_empty(drawn)[0] / np.sqrt(len(self.points))])

    def loss(self, posed: Posed) -> float:
        """Mean squared distances to the hull and from it, comparable with D_chamfer."""
        return float(np.square(self.residuals(posed, 0, posed)).sum())

    def _in_box(self, points: np.ndarray) -> np.ndarray:
        """World to the hull's frame."""
        return points @ self.box_from_world[:3, :3].T + self.box_from_world[:3, 3]

    def linearised(self, posed: Posed, level: int, velocities: np.ndarray) -> tuple[np.ndarray, Jacobian]:
        """The residuals and their derivatives."""
        shape = OnSurface(self._surfaces, posed, posed, self.places)
        places = self._in_box(shape.points)
        where, inside = self._cell(places)
        down = -np.stack([map_coordinates(s, inside.T, order=1) for s in self.slopes], 1)
        length = np.linalg.norm(where - inside, axis=1, keepdims=True)
        away = np.where(where == inside, down, 0) + (where - inside) / np.maximum(length, 1e-9)
        far = self.sticking_out(places)[:, None]
        way = away @ self.box_from_world[:3, :3] @ shape.turn * (far > 0) * shape.shares()[:, None]
        out = shape.speeds(shape.places, way, velocities)
        out += far * shape.share_slopes(velocities)
        drawn = np.stack(silhouettes(posed.shape, posed.K, posed.cam_from_shape, self.sizes))
        distance, worst = self.left_empty(drawn)
        root = np.sqrt(len(self.points))
        here = np.concatenate([far[:, 0] * shape.shares(), distance / root])
        empty = self._empty_slopes(posed, velocities, distance, worst) / root
        return here, Jacobian.of(np.concatenate([out, empty]))

    def _empty_slopes(
        self, posed: Posed, velocities: np.ndarray, distance: np.ndarray, worst: np.ndarray
    ) -> np.ndarray:
        """(points, k): a point's distance shrinks as the nearest place on the outlines comes nearer."""
        found = outlines(posed.shape, posed.K, posed.cam_from_shape)
        some = np.flatnonzero((distance > 0) & np.isin(worst, found.view))
        edge, share, away = np.zeros(len(some), int), np.zeros(len(some)), np.zeros((len(some), 2))
        for view in np.unique(worst[some]):
            here, edges = np.flatnonzero(worst[some] == view), np.flatnonzero(found.view == view)
            nearest, share[here], away[here] = _nearest_on(found.pixels[edges], self._seen[view, some[here]])
            edge[here] = edges[nearest]
        near = found._replace(view=found.view[edge], points=found.points[edge], pixels=found.pixels[edge])
        end, point, gradient = end_gradients(near, posed.K, away * -self._unit[worst[some], some][:, None])
        view, vertex = np.divmod(point, len(velocities))
        gradient = np.einsum("ci,cij->cj", gradient, posed.cam_from_shape[view, :3, :3])
        gradient *= np.where(end % 2, share[end // 2], 1 - share[end // 2])[:, None]
        out = np.zeros((len(self.points), velocities.shape[-1]))
        np.add.at(out, some[end // 2], np.einsum("cj,cjk->ck", gradient, velocities[vertex]))
        return out


def _nearest_on(edges: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of edges (e, 2, 2) the nearest to each of (p, 2) points, the share of the way along it, and the unit vector (2,)
    from there to the point."""
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    length = np.maximum(np.square(along).sum(1), 1e-12)
    share = np.clip(np.einsum("pei,ei->pe", points[:, None] - start, along) / length, 0, 1)
    apart = points[:, None] - (start + share[..., None] * along)
    nearest, rows = np.square(apart).sum(2).argmin(1), np.arange(len(points))
    away = apart[rows, nearest]
    return nearest, share[rows, nearest], away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)


def _distance(mask: np.ndarray) -> np.ndarray:
    """(S, S) float32: of True pixels, distance to the nearest edge between True and False."""
    if mask.all():
        return np.full(mask.shape, float(sum(mask.shape)), np.float32)  # no edge in the window
    found = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    return np.maximum(found - np.float32(0.5), 0)
