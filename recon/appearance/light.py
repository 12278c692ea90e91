"""The light in which the photos were taken, from the colours of a known shape; without it, a base colour is shaded.

Light comes from directions of the sky that nothing blocks, back from the floor, and from the object's own surfaces.
How much from each is found together with one brightness a part: parts have many sides, and turn the same colour to
all of them. What cannot be told (a table's top has one side) stays at even light.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from recon.appearance.atlas import Atlas
from recon.appearance.texels import Texels
from recon.appearance.views import Rays

DIRECTIONS = 48  # of light, over the whole sphere
FLOOR, OWN = 0.45, 0.35  # even light: what floor and object send back of what they get
HELD = 0.15  # how strongly even light is held on to, beside relative errors
SOME = 5_000  # places that decide
SWEEPS = 6
DARKEST, BRIGHTEST = 0.25, 1.25  # of the light on level ground in the open
LIFT = 2e-3  # canonical units above the surface, where rays begin


def light(cells: Texels, atlas: Atlas, rays: Rays, colour: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(m,) float: the light at every place, as a share of what level ground in the open gets.

    colour  (m, 3) float linear, NaN where not seen
    weight  (m,) float, how much the photos say about each
    """
    reach = _reach(cells, atlas, rays)
    even = _even()
    told = np.flatnonzero(np.isfinite(colour[:, 0]) & (weight > 0))
    some = told[:: max(1, len(told) // SOME)]
    if not len(some):
        return _bounded(reach @ even, even)
    part = atlas.part[cells.triangle[some]]
    found = _solved(reach[some], colour[some] @ (0.2126, 0.7152, 0.0722), weight[some], part, even)
    return _bounded(reach @ found, found)


def _solved(
    reach: np.ndarray, bright: np.ndarray, weight: np.ndarray, part: np.ndarray, even: np.ndarray
) -> np.ndarray:
    """How much light comes from each source, in turn with a brightness for every part."""
    _, part = np.unique(part, return_inverse=True)
    found = even
    sure = np.sqrt(np.minimum(weight / np.median(weight), 1))
    hold = HELD * np.sqrt(len(bright) / len(even)) * np.eye(len(even)) / even.mean()
    for _ in range(SWEEPS):
        given = np.maximum(reach @ found, 1e-3)
        albedo = np.array([np.median((bright / given)[part == p]) for p in range(part.max() + 1)])[part]
        off = albedo * given / bright - 1
        rows = (sure / np.sqrt(1 + (off / 0.2) ** 2) * albedo / bright)[:, None] * reach
        wanted = sure / np.sqrt(1 + (off / 0.2) ** 2)
        found, _ = nnls(np.concatenate([rows, hold]), np.concatenate([wanted, hold @ even]), maxiter=1000)
        found = found / max(_open(found), 1e-6)
    return found


def _directions() -> np.ndarray:
    """(DIRECTIONS, 3), evenly over the sphere."""
    i = np.arange(DIRECTIONS) + 0.5
    z, turn = 1 - 2 * i / DIRECTIONS, np.pi * (3 - np.sqrt(5)) * i
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], 1)


def _reach(cells: Texels, atlas: Atlas, rays: Rays) -> np.ndarray:
    """(m, DIRECTIONS / 2 + 2): how squarely every place meets each direction of the free sky, the floor, the object."""
    normals = atlas.normals[cells.triangle].astype(np.float32)
    origins = cells.places + np.float32(LIFT) * normals
    half = DIRECTIONS // 2
    out = np.zeros((len(origins), half + 2), np.float32)
    for k, direction in enumerate(_directions().astype(np.float32)):
        cosine = normals @ direction
        facing = np.flatnonzero(cosine > 0)
        free = rays.free(origins[facing], direction)
        out[facing[free], min(k, half)] += cosine[facing[free]]
        out[facing[~free], half + 1] += cosine[facing[~free]]
    return out


def _even() -> np.ndarray:
    """An even sky and what comes back, 1 on level ground in the open."""
    half = DIRECTIONS // 2
    even = np.concatenate([np.ones(half), [FLOOR, OWN]])
    return even / _open(even)


def _open(strengths: np.ndarray) -> float:
    """The light on level ground in the open."""
    return float(strengths[: DIRECTIONS // 2] @ _directions()[: DIRECTIONS // 2, 2])


def _bounded(given: np.ndarray, strengths: np.ndarray) -> np.ndarray:
    return np.clip(given / max(_open(strengths), 1e-6), DARKEST, BRIGHTEST)
