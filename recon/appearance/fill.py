"""Colours where no photo looked: the mirror image where the object is the same on both sides, else the part's own."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from procmodels.look import srgb
from recon.appearance.atlas import Atlas
from recon.appearance.blend import Blend
from recon.appearance.cell_images import CellImages
from recon.appearance.texels import Texels

TURNED = 0.03  # canonical units: so far apart count two places whose normals differ by one
NEAR = 0.025  # canonical units: a mirrored place farther from all that is seen has no mirror image
CLOSE = 0.05  # canonical units: farther from what is seen, the part's base colour takes over
NEIGHBOURS = 6
SEEN = 0.5  # of Blend.known: photos know the place
ALIKE = 0.12  # log colours: two sides that differ by less are the same


def filled(
    blend: Blend, texels: Texels, cells: Texels, atlas: Atlas, images: CellImages, base: np.ndarray
) -> np.ndarray:
    """(n, 3) float32 linear colours of all texels."""
    known = images.means(np.ones((len(texels.flat), 1)), blend.known)[:, 0] > 0
    known &= images.means(blend.known[:, None], np.ones(len(texels.flat)))[:, 0] > SEEN
    if not known.any():
        return base.astype(np.float32)[atlas.part[texels.triangle]]
    colour = images.means(blend.colour, blend.known)
    own = images.spread(_own(cells, atlas, known, colour, base))
    poor = np.flatnonzero(blend.known < 1)
    other = own[poor]
    mirror = _mirror(cells, atlas, known)
    if _same(colour, known, mirror, base[atlas.part[cells.triangle]]):
        found, ok = _mirrored(blend, texels, poor, cells, atlas, images, mirror)
        other[ok] = found[ok]
    out = blend.colour.copy()
    share = blend.known[poor, None]
    out[poor] = share * out[poor] + (1 - share) * other
    return out


def _own(cells: Texels, atlas: Atlas, known: np.ndarray, colour: np.ndarray, base: np.ndarray) -> np.ndarray:
    """(m, 3): every cell's colour, or what its part looks like nearby, and farther off in general."""
    out = np.where(known[:, None], colour, base[atlas.part[cells.triangle]])
    part = atlas.part[cells.triangle]
    for p in np.unique(part[~known]):
        here, wanted = np.flatnonzero((part == p) & known), np.flatnonzero((part == p) & ~known)
        if not len(here):
            continue
        count = min(NEIGHBOURS, len(here))
        distance, which = cKDTree(cells.places[here]).query(cells.places[wanted], k=list(range(1, count + 1)))
        weight = 1 / (distance**2 + 1e-6)
        rest = count / CLOSE**2
        total = (weight[..., None] * colour[here[which]]).sum(1) + rest * base[p]
        out[wanted] = total / (weight.sum(1) + rest)[:, None]
    return out


def _mirror(cells: Texels, atlas: Atlas, known: np.ndarray) -> np.ndarray:
    """(m,) the known cell at every cell's mirror image in the plane x = 0, -1 for none."""
    normals = atlas.normals[cells.triangle]
    place = np.concatenate([cells.places, TURNED * normals], 1)
    flipped = place * (-1, 1, 1, -1, 1, 1)
    those = np.flatnonzero(known)
    distance, which = cKDTree(place[those]).query(flipped)
    return np.where(distance < NEAR, those[which], -1)


def _same(colour: np.ndarray, known: np.ndarray, mirror: np.ndarray, base: np.ndarray) -> bool:
    """Whether mirror images tell a colour at least as well as the parts' base colours do."""
    both = np.flatnonzero(known & (mirror >= 0))
    if not len(both):
        return True
    logs = np.log(np.maximum(colour, 1e-3))
    by_mirror = np.median(np.abs(logs[both] - logs[mirror[both]]).max(1))
    by_base = np.median(np.abs(logs[both] - np.log(np.maximum(base[both], 1e-3))).max(1))
    return bool(by_mirror <= max(by_base, ALIKE))


def _mirrored(
    blend: Blend,
    texels: Texels,
    which: np.ndarray,
    cells: Texels,
    atlas: Atlas,
    images: CellImages,
    mirror: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Colours (k, 3) of some texels from their mirror images, and where (k,) there are any."""
    source = mirror[images.cell_of_texel[which]]
    triangle = cells.triangle[np.maximum(source, 0)]
    to = atlas.pixels_from_surface.astype(np.float32)
    place = texels.places[which] * np.array([-1, 1, 1], np.float32)
    column, row = (
        np.einsum("kj,kj->k", to[triangle, k, :3], place) + to[triangle, k, 3] - np.float32(0.5) for k in (0, 1)
    )
    column, row = np.rint(column).astype(int), np.rint(row).astype(int)
    ok = (source >= 0) & (row >= 0) & (row < atlas.size) & (column >= 0) & (column < atlas.size)
    pixel = np.where(ok, row * atlas.size + column, 0)
    at = np.minimum(np.searchsorted(texels.flat, pixel), len(texels.flat) - 1)
    ok &= (texels.flat[at] == pixel) & (blend.known[at] > SEEN)
    return blend.colour[at], ok


def picture(texels: Texels, colour: np.ndarray) -> np.ndarray:
    """(size, size, 3) uint8 sRGB of linear colours (n, 3) at texels; pixels without surface take the nearest."""
    table = np.rint(255 * srgb(np.linspace(0, 1, 4096))).astype(np.uint8)
    values = table[np.rint(4095 * np.clip(colour, 0, 1)).astype(np.int32)]
    empty = np.ones(texels.size**2, np.uint8)
    empty[texels.flat] = 0
    _, label = cv2.distanceTransformWithLabels(
        empty.reshape(texels.size, texels.size), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    label = label.ravel()
    of_label = np.zeros((label.max() + 1, 3), np.uint8)
    of_label[label[texels.flat]] = values
    return of_label[label].reshape(texels.size, texels.size, 3)
