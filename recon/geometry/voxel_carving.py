"""A block of cells over the floor that the photos carve, and what of it each photo should show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import scipy.ndimage

from recon.scene import Cameras

MOST = 0.6  # of the pictures: what fewer show, nobody can judge


@dataclass(frozen=True)
class Cells:
    """A regular grid of cubic cells; cell (i, j, k) is centred at origin + axes.T @ (((i, j, k) + 0.5) * side).

    origin  (3,) float, corner of the block, world frame
    axes    (3, 3) float, rows are the block's unit axes in the world frame
    side    float, of a cell, SfM units
    shape   cells along each axis
    """

    origin: np.ndarray
    axes: np.ndarray
    side: float
    shape: tuple[int, int, int]

    def steps(self, P: np.ndarray) -> list[np.ndarray]:
        """Homogeneous pixels P (3, 4) @ centre, split into (n, 3) terms an axis: the pixel of a cell is their sum."""
        parts = [
            ((np.arange(n)[:, None] + 0.5) * self.side * self.axes[a]) @ P[:, :3].T for a, n in enumerate(self.shape)
        ]
        parts[0] = parts[0] + P[:, :3] @ self.origin + P[:, 3]
        return [p.astype(np.float32) for p in parts]

    def part(self, low: np.ndarray, high: np.ndarray, longest: int) -> Cells:
        """The block from cell `low` to before cell `high`, cut anew with `longest` cells along its longest axis."""
        size = (high - low) * self.side
        side = float(size.max() / longest)
        shape = np.maximum(1, np.ceil(size / side - 1e-6)).astype(int)
        return Cells(
            self.origin + self.axes.T @ (low * self.side),
            self.axes,
            side,
            (int(shape[0]), int(shape[1]), int(shape[2])),
        )


def region(axes: np.ndarray, base: np.ndarray, distance: float, cameras: Cameras, longest: int) -> Cells:
    """The block that the cameras look at: upright on its base, as wide as the median picture is at the object.

    axes      (3, 3) float, rows are the block's axes in the world frame, the third points up
    base      (3,) float, middle of the block's lowest face, world frame
    distance  float, from the cameras to the object, SfM units
    """
    half = float(np.median((cameras.sizes.max(1) / 2) / cameras.K[:, 0, 0])) * distance
    size = np.array([2 * half, 2 * half, 1.8 * half])
    shape = np.ceil(size / (2 * half / longest) - 1e-6).astype(int)
    origin = base - axes.T @ np.array([half, half, 0.0])
    return Cells(origin, axes, 2 * half / longest, (int(shape[0]), int(shape[1]), int(shape[2])))


def around(cells: Cells, solid: np.ndarray, longest: int, floor: bool = False) -> Cells:
    """A finer block round the solid cells with a tenth as margin; with `floor` it reaches down to the block's base."""
    where = np.argwhere(solid)
    low, high = where.min(0), where.max(0) + 1
    margin = np.maximum(2, (0.1 * (high - low)).astype(int))
    low = np.maximum(low - margin, 0) * ((1, 1, 0) if floor else (1, 1, 1))
    return cells.part(low, high + margin, longest)


def _pixels(cells: Cells, cameras: Cameras, view: int, rows: slice) -> np.ndarray:
    """(*shape,) int32: flat pixel index of the cells [rows, :, :]; width x height for those not in the picture."""
    a, b, c = cells.steps(cameras.K[view] @ cameras.cam_from_world[view, :3])
    a, b, c = a[rows, None, None], b[None, :, None], c[None, None]
    inverse = 1 / np.maximum((a[..., 2] + b[..., 2]) + c[..., 2], 1e-6)
    width, height = (int(s) for s in cameras.sizes[view])
    # Cells behind the camera get a huge inverse and fall out; the clip keeps the cast to int defined.
    x = np.clip(((a[..., 0] + b[..., 0]) + c[..., 0]) * inverse, -1, width).astype(np.int32)
    y = np.clip(((a[..., 1] + b[..., 1]) + c[..., 1]) * inverse, -1, height).astype(np.int32)
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height) & (inverse < 1e6)
    return np.where(inside, y * width + x, width * height)


def add_up(cells: Cells, cameras: Cameras, values: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """For every cell the sum over all views of the view's values (h, w) at the cell's pixel, (*shape) float32, and how
    many views have it in their pictures, (*shape) int16."""
    out, seen = np.zeros(cells.shape, np.float32), np.zeros(cells.shape, np.int16)
    for view, value in enumerate(values):
        flat = np.append(value.ravel(), 0).astype(np.float32)
        for start in range(0, cells.shape[0], 16):
            rows = slice(start, start + 16)
            pixels = _pixels(cells, cameras, view, rows)
            out[rows] += flat.take(pixels)
            seen[rows] += pixels < value.size
    return out, seen


def held(cells: Cells, cameras: Cameras, values: list[np.ndarray], least: float, share: float = MOST) -> np.ndarray:
    """(*shape) bool: the cells whose values sum to `least` or more, and which `share` of the pictures have in them."""
    total, seen = add_up(cells, cameras, values)
    return (total >= least) & (seen >= share * len(cameras))


def main_part(solid: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """The connected part of `solid` (bool cells) that is largest, weighed by nearness to the cell `middle` (3,)."""
    labels, count = scipy.ndimage.label(solid, np.ones((3, 3, 3)))
    if count == 0:
        return solid
    where = np.argwhere(solid)
    near = 1 / (1 + (((where - middle) / (0.25 * max(solid.shape))) ** 2).sum(1))
    weight = np.bincount(labels[solid], weights=near)
    return labels == int(weight.argmax())


def shell(solid: np.ndarray) -> np.ndarray:
    """The solid cells (bool, 3-d) that have an empty one, or the block's border, beside one of their six faces."""
    inner = np.zeros_like(solid)
    inner[1:-1, 1:-1, 1:-1] = (
        (solid[:-2, 1:-1, 1:-1] & solid[2:, 1:-1, 1:-1])
        & (solid[1:-1, :-2, 1:-1] & solid[1:-1, 2:, 1:-1])
        & (solid[1:-1, 1:-1, :-2] & solid[1:-1, 1:-1, 2:])
    )
    return solid & ~inner


def picture(cells: Cells, solid: np.ndarray, cameras: Cameras, view: int) -> np.ndarray:
    """(H, W) bool: the silhouette of the solid cells in one view; a cell covers a disc of its own size."""
    return _picture(cells, np.nonzero(shell(solid)), cameras, view)


def pictures(cells: Cells, solid: np.ndarray, cameras: Cameras) -> Callable[[int], np.ndarray]:
    """`picture` by view, for those who want many."""
    where = np.nonzero(shell(solid))
    return lambda view: _picture(cells, where, cameras, view)


def _picture(cells: Cells, where: tuple[np.ndarray, ...], cameras: Cameras, view: int) -> np.ndarray:
    width, height = (int(s) for s in cameras.sizes[view])
    out = np.zeros((height, width), np.uint8)
    a, b, c = cells.steps(cameras.K[view] @ cameras.cam_from_world[view, :3])
    i, j, k = where
    local = a[i] + b[j] + c[k]
    local = local[local[:, 2] > 1e-6]
    xy = (local[:, :2] / local[:, 2:]).astype(np.int32)
    xy = xy[((xy >= 0) & (xy < (width, height))).all(1)]
    out[xy[:, 1], xy[:, 0]] = 1
    # Neighbouring cells lie this many pixels apart, along a diagonal sqrt(3) times as many.
    gap = cells.side * float(cameras.K[view, 0, 0]) / max(float(np.median(local[:, 2])), 1e-6) if len(local) else 1.0
    reach = max(1, int(np.ceil(0.87 * gap)))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    closed = cv2.morphologyEx(np.pad(out, reach), cv2.MORPH_CLOSE, kernel)
    return closed[reach:-reach, reach:-reach] > 0
