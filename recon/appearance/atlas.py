"""The flat pieces of a shape packed into one square picture, and where on the surface each of its pixels lies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from procmodels.shape import Shape
from recon.appearance.charts import Chart, charts

GAP = 4  # px kept free round every piece, so that smaller versions of the picture do not mix neighbours
_HALVINGS = 18  # of the interval in which the scale is looked for
_SHIFT = 6  # bits of a pixel's fraction in OpenCV's polygons


@dataclass(frozen=True)
class Atlas:
    """A shape's triangles in a square picture of `size` px.

    corners  (m, 3, 3) float, of the triangles, canonical units
    part     (m,) int
    pixels   (m, 3, 2) float, the corners' places in the picture in px: x to the right, y down
    uv       P arrays (c, 2) float as in procmodels.look.Look
    scale    px per canonical unit
    """

    size: int
    corners: np.ndarray
    part: np.ndarray
    pixels: np.ndarray
    uv: tuple[np.ndarray, ...]
    scale: float

    @cached_property
    def normals(self) -> np.ndarray:
        """(m, 3) unit normals."""
        a, b, c = self.corners.transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)

    @cached_property
    def surface_from_pixels(self) -> np.ndarray:
        """(m, 3, 3) float: a triangle's place (3,) is this @ (x, y, 1)."""
        flat = np.concatenate([self.pixels, np.ones((len(self.pixels), 3, 1))], 2)
        area = np.abs(np.linalg.det(flat))
        flat[area < 1e-9] = np.eye(3)  # a triangle without area covers no pixel
        return np.swapaxes(np.linalg.solve(flat, self.corners), 1, 2)

    @cached_property
    def pixels_from_surface(self) -> np.ndarray:
        """(m, 2, 4) float: the place (2,) in the picture of a place p (3,) on or above a triangle is this @ (p, 1)."""
        across = np.linalg.pinv(self.surface_from_pixels[:, :, :2])
        moved = -np.einsum("mij,mj->mi", across, self.surface_from_pixels[:, :, 2])
        return np.concatenate([across, moved[..., None]], 2)

    def triangle_of_pixels(self) -> np.ndarray:
        """(size, size) int32, the triangle that each pixel shows, -1 for none."""
        out = np.full((self.size, self.size), -1, np.int32)
        places = np.rint((self.pixels - 0.5) * 2**_SHIFT).astype(np.int32)  # OpenCV's centres are at whole numbers
        for i, corners in enumerate(places):
            cv2.fillConvexPoly(out, corners, (i,), lineType=cv2.LINE_8, shift=_SHIFT)
        return out


def unwrapped(shape: Shape, size: int) -> Atlas:
    """The surface of a shape in a picture of `size` px a side, as large as it fits."""
    pieces = charts(shape)
    scale, places = _packed(np.array([c.size for c in pieces]), size)
    uv = [np.zeros((sum(map(len, p.faces)), 2)) for p in shape.parts]
    starts = [np.concatenate([[0], np.cumsum([len(f) for f in p.faces])]) for p in shape.parts]
    for chart, place in zip(pieces, places, strict=True):
        uv[chart.part][_corners(chart, starts[chart.part])] = _in_picture(chart, place, scale)
    corners, pixels, owner = [], [], []
    for i, part in enumerate(shape.parts):
        fans = np.concatenate([_fan(s, len(f)) for s, f in zip(starts[i][:-1], part.faces, strict=True)])
        vertex = np.concatenate([np.asarray(f, int) for f in part.faces])
        corners.append(part.vertices[vertex[fans]])
        pixels.append(uv[i][fans])
        owner.append(np.full(len(fans), i))
    told = tuple((u * (1, -1) + (0, size)) / size for u in uv)
    return Atlas(size, np.concatenate(corners), np.concatenate(owner), np.concatenate(pixels), told, scale)


def _corners(chart: Chart, starts: np.ndarray) -> np.ndarray:
    """Numbers of the part's corners that belong to a chart's polygons."""
    return np.concatenate([np.arange(starts[f], starts[f + 1]) for f in chart.faces])


def _in_picture(chart: Chart, place: np.ndarray, scale: float) -> np.ndarray:
    flat = chart.flat * (1, -1) + (0, chart.size[1])  # y counts down
    return place + GAP + flat * scale


def _fan(start: int, count: int) -> np.ndarray:
    """(count - 2, 3) corners of a polygon's triangles."""
    i = np.arange(1, count - 1)
    return start + np.stack([np.zeros_like(i), i, i + 1], 1)


def _packed(sizes: np.ndarray, side: int) -> tuple[float, np.ndarray]:
    """The largest scale (px per unit) at which boxes (n, 2) fit into a square, and their upper left corners (n, 2)."""
    low, high = 0.0, (side - 2 * GAP) / float(sizes.max())
    best = _placed(sizes, low, side)
    if best is None:
        raise ValueError(f"a picture of {side} px has no room for {len(sizes)} pieces")
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        found = _placed(sizes, middle, side)
        if found is None:
            high = middle
        else:
            low, best = middle, found
    return low, best


def _placed(sizes: np.ndarray, scale: float, side: int) -> np.ndarray | None:
    """Upper left corners (n, 2) in rows, the highest boxes first, each in the first row with room; None: no room."""
    boxes = np.ceil(sizes * scale).astype(int) + 2 * GAP
    out = np.zeros((len(boxes), 2))
    room, tops, below = np.zeros(len(boxes), int), np.zeros(len(boxes), int), 0
    rows = 0
    for i in np.lexsort((-boxes[:, 0], -boxes[:, 1])):
        wide, high = boxes[i]
        fits = np.flatnonzero(room[:rows] >= wide)
        if len(fits):
            row = fits[0]
        else:
            row, rows = rows, rows + 1
            tops[row], room[row], below = below, side, below + high
            if below > side or wide > side:
                return None
        out[i] = side - room[row], tops[row]
        room[row] -= wide
    return out
