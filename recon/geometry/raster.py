"""Silhouettes of a built shape in given cameras, fast enough for an optimisation loop: by pixel centres or by area.

A pixel belongs to the silhouette when its centre lies inside the projection of any face. Outline edges
(recon.geometry.outlines) are crossed with the rows of the image, +w or -w is noted at the crossing, and a running sum
along the rows gives how often a pixel is covered. All views share one pass of numpy.
OpenCV's polygons are not used: they include every pixel that the border touches, which thickens a leg by one pixel.

Shares of areas have exact derivatives: a pixel's covered share changes, to first order, by the normal speed of the
outline times its length inside the pixel, and the outlines are cut into pieces at every pixel anyway.

For a fast, coarse variant pass smaller cameras: `cameras.scaled(0.25)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse

from procmodels.shape import Shape
from recon.geometry.outlines import Outlines, end_gradients, outlines

LEVEL = 1e-9  # pixels: an edge that rises or runs less is level or upright


def silhouettes(shape: Shape, K: np.ndarray, cam_from_canonical: np.ndarray, sizes: np.ndarray) -> list[np.ndarray]:
    """The shape's silhouette in V pinhole cameras.

    K                   (V, 3, 3) float, pixels, pixel centres at +0.5
    cam_from_canonical  (V, 4, 4) float, rigid, camera frame in canonical units (see scene.cam_from_canonical)
    sizes               (V, 2) int, (width, height)
    Returns V arrays (H, W) bool. Parts behind a camera are left out, parts that reach behind it are cut at NEAR.
    """
    _check(K, cam_from_canonical, sizes)
    return _fill(outlines(shape, K, cam_from_canonical, closed=False), sizes)


def coverage(
    shape: Shape, K: np.ndarray, cam_from_canonical: np.ndarray, sizes: np.ndarray, dtype: type = np.float32
) -> list[np.ndarray]:
    """As `silhouettes`, but V arrays (H, W) float: the share of each pixel's area that the shape covers.

    It changes with the shape without jumps, which derivatives need. Parts must be closed, their faces counter-clockwise
    from outside (each part then covers a pixel twice, with its front and its back). Where outlines of two parts cross
    within a pixel their shares are added, at most to 1.
    """
    _check(K, cam_from_canonical, sizes)
    images = _Images.of(sizes)
    shares = images.shares(_pieces(outlines(shape, K, cam_from_canonical), sizes))
    return images.split(np.minimum(shares, 1).astype(dtype))


def coverage_slopes(
    shape: Shape, K: np.ndarray, cam_from_canonical: np.ndarray, sizes: np.ndarray
) -> tuple[list[np.ndarray], Slopes]:
    """`coverage`, and its derivatives by the places of the shape's vertices."""
    _check(K, cam_from_canonical, sizes)
    found = outlines(shape, K, cam_from_canonical)
    images, pieces = _Images.of(sizes), _pieces(found, sizes)
    shares = images.shares(pieces)
    slopes = _slopes(found, pieces, images, shares, K, cam_from_canonical)
    return images.split(np.minimum(shares, 1).astype(np.float32)), slopes


def iou(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of two bool arrays of one shape; 1 when both are empty."""
    if a.shape != b.shape:
        raise ValueError(f"masks of one shape are needed, got {a.shape} and {b.shape}")
    union = np.count_nonzero(a | b)
    return float(np.count_nonzero(a & b) / union) if union else 1.0


@dataclass(frozen=True)
class Slopes:
    """Derivatives of shares of pixels by the places of n vertices in V views.

    pixels     (p,) int, ascending: the pixels whose shares change, numbered through all images, row by row
    by_ends    (p, 2 m) sparse: by the speeds of the outline edges' ends across their edges
    entries    (edge end, view, vertex), (c,) int each
    gradients  (c, 3) float, an end's speed by the vertex's velocity in the shape's frame
    vertices, views  n and V
    """

    pixels: np.ndarray
    by_ends: sparse.csr_array
    entries: tuple[np.ndarray, np.ndarray, np.ndarray]
    gradients: np.ndarray
    vertices: int
    views: int

    def along(self, velocities: np.ndarray) -> np.ndarray:
        """(p, k) derivatives when vertices move by (n, 3, k), or view by view (V, n, 3, k), in the shape's frame."""
        end, view, vertex = self.entries
        rows = self.vertices * (self.views if velocities.ndim == 4 else 1)
        column = vertex + (view * self.vertices if velocities.ndim == 4 else 0)
        index = (end.repeat(3), (3 * column[:, None] + np.arange(3)).ravel())
        by_vertices = sparse.csr_array((self.gradients.ravel(), index), shape=(self.by_ends.shape[1], 3 * rows))
        return self.by_ends @ (by_vertices @ velocities.reshape(3 * rows, -1))


def _check(K: np.ndarray, cam_from_canonical: np.ndarray, sizes: np.ndarray) -> None:
    if not len(K) == len(cam_from_canonical) == len(sizes):
        raise ValueError(f"{len(K)} K, {len(cam_from_canonical)} poses and {len(sizes)} sizes: one of each a view")


def _runs(first: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All of first[i], first[i] + 1, ... (count[i] numbers) one after another: i and the number."""
    at = np.repeat(np.arange(len(first)), count)
    return at, np.arange(len(at)) - np.repeat(np.cumsum(count) - count - first, count)


def _fill(found: Outlines, sizes: np.ndarray) -> list[np.ndarray]:
    """Silhouettes by pixel centres."""
    widths, heights = sizes[:, 0].astype(int), sizes[:, 1].astype(int)
    down = found.pixels[:, 0, 1] < found.pixels[:, 1, 1]
    weight = np.where(down, found.weight, -found.weight)
    upper = np.where(down[:, None], found.pixels[:, 0], found.pixels[:, 1])
    lower = np.where(down[:, None], found.pixels[:, 1], found.pixels[:, 0])

    # An edge owns the row centres in [upper, lower).
    rows = np.clip(np.ceil(np.stack([upper[:, 1], lower[:, 1]]) - 0.5), 0, heights[found.view]).astype(int)
    at, row = _runs(rows[0], rows[1] - rows[0])
    with np.errstate(divide="ignore", invalid="ignore"):  # level edges cross no row and are not looked up
        slope = (lower[:, 0] - upper[:, 0]) / (lower[:, 1] - upper[:, 1])
    x = upper[at, 0] + slope[at] * (row + 0.5 - upper[at, 1])
    width = widths[found.view[at]]

    # One running sum serves all rows of a view, because every row sums to zero; the spare last column absorbs what
    # lies to the right of the image.
    offsets = np.concatenate([[0], np.cumsum((widths + 1) * heights)])
    line = offsets[found.view[at]] + row * (width + 1)
    column = np.clip(np.ceil(x - 0.5), 0, width).astype(int)
    cover = np.bincount(line + column, weight[at], offsets[-1]).astype(np.int16)
    out = []
    for low, high, h, w in zip(offsets[:-1], offsets[1:], heights, widths, strict=True):
        out.append(np.cumsum(cover[low:high], dtype=np.int16).reshape(h, w + 1)[:, :w] != 0)
    return out


class _Pieces(NamedTuple):
    """Outline edges cut at every row and column of their images, as font rasterisers do.

    edge, row, column  (q,) int; column -1 and the image's width hold all that lies beyond its sides
    share, middle      (q,) float, the piece's part of its edge, and where along the edge its middle lies, 0..1
    height, beyond     (q,) float, weighted height, and how far to the right in its column the middle lies, 0..1
    """

    edge: np.ndarray
    row: np.ndarray
    column: np.ndarray
    share: np.ndarray
    middle: np.ndarray
    height: np.ndarray
    beyond: np.ndarray
    view: np.ndarray


def _pieces(found: Outlines, sizes: np.ndarray) -> _Pieces:
    view, (x, y) = found.view, found.pixels.transpose(2, 1, 0)  # x and y (2, m): start, end
    rise, height = y[1] - y[0], sizes[view, 1]
    low, high = np.clip(y.min(0), 0, height), np.clip(y.max(0), 0, height)
    # A level edge covers nothing, but what it moves across counts.
    first = np.minimum(np.floor(low), height - 1).astype(int)
    count = np.where((high > low) | ((y[0] >= 0) & (y[0] < height)), np.ceil(high).astype(int) - first, 0)
    at, row = _runs(first, np.maximum(count, 0))
    steep = np.abs(rise[at]) > LEVEL
    slope = np.where(steep, rise[at], 1)
    ends = (np.clip([row, row + 1], low[at], high[at]) - y[0, at]) / slope
    ends = np.where(steep, np.sort(ends, 0), np.array([[0.0], [1.0]]))  # along the edge, 0..1
    sides = x[0, at] + (x[1, at] - x[0, at]) * ends
    left, right, width = sides.min(0), sides.max(0), sizes[view[at], 0]

    columns = np.floor(np.clip([left, right], -1, width)).astype(int)
    piece, column = _runs(columns[0], columns[1] - columns[0] + 1)
    begin = np.where(column == columns[0, piece], left[piece], column)
    end = np.where(column == columns[1, piece], right[piece], column + 1)
    span = (right - left)[piece]
    flat = span <= LEVEL
    part = np.where(flat, 1, (end - begin) / np.where(flat, 1, span))
    middle = (begin + end) / 2
    way = np.where(flat, 0.5, (middle - sides[0, piece]) / np.where(flat, 1, sides[1, piece] - sides[0, piece]))
    length = ends[1] - ends[0]
    edge, share = at[piece], part * length[piece]
    return _Pieces(
        edge,
        row[piece],
        column,
        share,
        ends[0, piece] + way * length[piece],
        # A face that is counter-clockwise to the eye runs down its left side and has turned to -1; a part covers twice.
        share * rise[edge] * found.weight[edge] / -2,
        np.clip(middle - column, 0, 1),
        view[edge],
    )


@dataclass(frozen=True)
class _Images:
    """V images one after the other, each row with a column before it and two after it."""

    widths: np.ndarray
    heights: np.ndarray
    offsets: np.ndarray  # (V + 1,) with the spare columns

    @staticmethod
    def of(sizes: np.ndarray) -> _Images:
        widths, heights = sizes[:, 0].astype(int), sizes[:, 1].astype(int)
        return _Images(widths, heights, np.concatenate([[0], np.cumsum((widths + 3) * heights)]))

    def shares(self, pieces: _Pieces) -> np.ndarray:
        """How much of each pixel is covered, added over parts; with the spare columns.

        A piece of an edge covers, by its height, all that lies to its right: of its own pixel the part beyond its
        middle, of the pixels after that everything.
        """
        place = self.places(pieces)
        cover = np.bincount(place, pieces.height * (1 - pieces.beyond), self.offsets[-1])
        cover[1:] += np.bincount(place, pieces.height * pieces.beyond, self.offsets[-1])[:-1]
        # One running sum serves all rows, because every row sums to zero; rounding must not leave less than nothing.
        return np.maximum(np.cumsum(cover), 0)

    def places(self, pieces: _Pieces) -> np.ndarray:
        """(q,) int, where a piece's pixel lies, with the spare columns."""
        return self.offsets[pieces.view] + pieces.row * (self.widths[pieces.view] + 3) + pieces.column + 1

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """V images (H, W) of values with the spare columns."""
        parts = zip(self.offsets[:-1], self.offsets[1:], self.heights, self.widths, strict=True)
        return [values[low:high].reshape(h, w + 3)[:, 1 : w + 1] for low, high, h, w in parts]


def _slopes(
    found: Outlines,
    pieces: _Pieces,
    images: _Images,
    shares: np.ndarray,
    K: np.ndarray,
    cam_from_canonical: np.ndarray,
) -> Slopes:
    """The pieces as a sparse matrix, without those whose pixels are full already."""
    width = images.widths[pieces.view]
    seen = (pieces.column >= 0) & (pieces.column < width) & (pieces.share > 0)
    seen &= shares[images.places(pieces)] < 1
    view, edge, column, row = pieces.view[seen], pieces.edge[seen], pieces.column[seen], pieces.row[seen]
    share, middle = pieces.share[seen], pieces.middle[seen]
    first = np.concatenate([[0], np.cumsum(images.widths * images.heights)])
    pixels, where = np.unique(first[view] + row * width[seen] + column, return_inverse=True)
    strength = found.weight[edge] * share / 2
    values = np.stack([strength * (1 - middle), strength * middle], 1).ravel()
    index = (where.ravel().repeat(2), np.stack([2 * edge, 2 * edge + 1], 1).ravel())
    by_ends = sparse.csr_array((values, index), shape=(len(pixels), 2 * len(found.view)))
    end, point, gradient = end_gradients(found, K)
    views, vertices = found.in_camera.shape[:2]
    at, vertex = np.divmod(point, vertices)
    gradient = np.einsum("ci,cij->cj", gradient, cam_from_canonical[at, :3, :3])
    return Slopes(pixels, by_ends, (end, at, vertex), gradient, vertices, views)
