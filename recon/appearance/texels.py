"""The pixels of a texture that show surface, each with its place in space; and what a photo says about them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from recon.appearance.atlas import Atlas
from recon.appearance.views import LINEAR, View

CELL = 8  # px: side of the squares of the texture that are looked at as one
FLATTEST = 0.15  # cosine: surfaces seen at a flatter angle are not painted
BEHIND = 0.02  # canonical units: what lies deeper than what is seen is hidden
_WIDE = 4096  # OpenCV takes lists of places only as pictures


@dataclass(frozen=True)
class Texels:
    """n pixels of the texture.

    flat      (n,) int, row * size + column, ascending
    triangle  (n,) int
    places    (n, 3) float32, canonical units
    size      px of the texture's side
    """

    flat: np.ndarray
    triangle: np.ndarray
    places: np.ndarray
    size: int

    @staticmethod
    def of(atlas: Atlas) -> Texels:
        """Every pixel that shows surface."""
        shown = atlas.triangle_of_pixels().ravel()
        flat = np.flatnonzero(shown >= 0)
        triangle = shown[flat]
        row, column = np.divmod(flat, atlas.size)
        to = atlas.surface_from_pixels.astype(np.float32)
        x, y = (column + 0.5).astype(np.float32), (row + 0.5).astype(np.float32)
        places = np.empty((len(flat), 3), np.float32)
        for k in range(3):  # by rows of the matrices: gathering them whole would take a gigabyte
            places[:, k] = to[triangle, k, 0] * x + to[triangle, k, 1] * y + to[triangle, k, 2]
        return Texels(flat, triangle, places, atlas.size)

    def cells(self) -> Texels:
        """One texel, about the middle one, of every square of CELL px that shows surface."""
        row, column = np.divmod(self.flat, self.size)
        side = -(-self.size // CELL)
        cell = row // CELL * side + column // CELL
        off = np.maximum(np.abs(row % CELL - CELL // 2), np.abs(column % CELL - CELL // 2))
        order = np.lexsort((off, cell))
        _, first = np.unique(cell[order], return_index=True)
        keep = np.sort(order[first])
        return Texels(self.flat[keep], self.triangle[keep], self.places[keep], self.size)


class Seen(NamedTuple):
    """What one photo says: the numbers (k,) of the texels that it shows, colour (k, 3) linear, trust (k,) and how
    squarely (k,) and finely (k,) it sees them: cosine, and px per canonical unit.
    """

    which: np.ndarray
    colour: np.ndarray
    trust: np.ndarray
    cosine: np.ndarray
    fineness: np.ndarray


def seen(texels: Texels, atlas: Atlas, view: View, blur: float = 0.0) -> Seen:
    """The texels that a photo shows; `blur` is the side in px over which colours are averaged, within the object."""
    middle = atlas.corners.mean(1)
    towards = view.eye - middle
    faces = (towards * atlas.normals).sum(1) > 0
    which = np.flatnonzero(faces[texels.triangle])
    places = texels.places[which]
    to = view.cam_from_canonical.astype(np.float32)
    local = places @ to[:3, :3].T + to[:3, 3]
    depth = np.maximum(local[:, 2], 1e-6)
    x = (view.K[0, 0] * local[:, 0] + view.K[0, 1] * local[:, 1]).astype(np.float32) / depth + np.float32(view.K[0, 2])
    y = np.float32(view.K[1, 1]) * local[:, 1] / depth + np.float32(view.K[1, 2])
    height, width = view.part.shape
    inside = np.flatnonzero((x >= 0) & (x < width) & (y >= 0) & (y < height) & (local[:, 2] > 1e-3))
    pixel = y[inside].astype(np.int64) * width + x[inside].astype(np.int64)
    triangle = texels.triangle[which[inside]]
    met = view.part.ravel()[pixel] == atlas.part[triangle]
    met &= np.abs(view.depth.ravel()[pixel] - local[inside, 2]) < BEHIND
    inside, triangle = inside[met], triangle[met]

    away = view.eye.astype(np.float32) - places[inside]
    distance = np.linalg.norm(away, axis=1)
    cosine = (away * atlas.normals.astype(np.float32)[triangle]).sum(1) / distance
    ok = np.flatnonzero(cosine > FLATTEST)
    inside, cosine = inside[ok], cosine[ok]
    found = _taken(_picture(view, blur), x[inside], y[inside])
    fineness = np.float32(view.K[0, 0]) / local[inside, 2] * cosine
    trust = np.clip(found[:, 3], 0, 1)
    return Seen(which[inside], found[:, :3], trust, cosine, fineness)


def _picture(view: View, blur: float) -> np.ndarray:
    """(h, w, 4) float32: linear colour, and trust."""
    colour = LINEAR[view.photo]
    if blur > 1:
        valid = view.trust[..., None]
        side = (round(blur), round(blur))
        weight = cv2.boxFilter(view.trust, -1, side)[..., None]
        blurred = cv2.boxFilter(colour * valid, -1, side) / np.maximum(weight, 1e-9)
        colour = np.where(weight > 1e-9, blurred, colour)
    return np.concatenate([colour, view.trust[..., None]], 2)


def _taken(picture: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(n, c) of a picture (h, w, c) at places in px, between pixels linearly."""
    n = len(x)
    rows = -(-n // _WIDE)
    grid = np.zeros((2, rows * _WIDE), np.float32)
    grid[0, :n], grid[1, :n] = x - 0.5, y - 0.5  # OpenCV's centres are at whole numbers
    out = cv2.remap(
        picture,
        grid[0].reshape(rows, _WIDE),
        grid[1].reshape(rows, _WIDE),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return out.reshape(rows * _WIDE, -1)[:n]
