"""The light in which the photos were taken, from the colours of a known shape; without it, a base colour is shaded.

Light comes from directions of the sky that nothing blocks, back from the floor, and from the object's own surfaces.
How much from each is found together with one brightness a material: its parts have many sides, and turn the same
colour to all of them. What cannot be told (a table's top has one side) stays at even light. How bright all of it is
cannot be told either: on the whole the colours stay as bright as the photos show them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from recon.appearance.atlas import Atlas
from recon.appearance.texels import Texels
from recon.appearance.views import Rays

BRIGHT = np.array([0.2126, 0.7152, 0.0722])  # of linear RGB
DIRECTIONS = 48  # of light, over the whole sphere
FLOOR, OWN = 0.45, 0.35  # even light: what floor and object send back of what they get
HELD = 0.03  # how strongly even light is held on to, beside relative errors
SOME = 5_000  # places that decide
SWEEPS, SHARED = 8, 2  # in the first of them every material has one brightness
OTHER = 0.8  # log brightness: a part farther from its material is of another one
DARKEST, BRIGHTEST = 0.15, 1.4  # of the light on level ground in the open
LIFT = 2e-3  # canonical units above the surface, where rays begin
FEWEST = 6  # places that a part must be seen in to be told from its material


@dataclass(frozen=True)
class Light:
    """shade (m,) float: the light at every place, 1 in the mean of what is seen; material (P,) int of every part."""

    shade: np.ndarray
    material: np.ndarray


def light(
    cells: Texels, atlas: Atlas, rays: Rays, colour: np.ndarray, weight: np.ndarray, material: np.ndarray
) -> Light:
    """Find the light, and tell parts from their material that are much brighter or darker in it.

    colour    (m, 3) float linear, NaN where not seen
    weight    (m,) float, how much the photos say about each
    material  (P,) int, what parts look alike in hue
    """
    reach = _reach(cells, atlas, rays)
    told = np.flatnonzero(np.isfinite(colour[:, 0]) & (weight > 0))
    some = told[:: max(1, len(told) // SOME)]
    found = _even()
    if len(some):
        bright = np.maximum(colour[some] @ BRIGHT, 1e-3)
        found, material = _solved(reach[some], bright, weight[some], atlas.part[cells.triangle[some]], material)
    shade = np.clip(reach @ found, DARKEST, BRIGHTEST)
    level = np.exp(np.average(np.log(shade[told]), weights=weight[told])) if len(told) else 1.0
    return Light(shade / level, material)


def believed(shade: np.ndarray, bright: np.ndarray, base: np.ndarray) -> np.ndarray:
    """(m,) the part of the light at m places that brings their brightness (m,) towards that of their parts (m,).

    Where the shape is not quite the object's, shadows fall elsewhere: what light would lead away from a part's colour
    is not taken out.
    """
    all_of_it, wanted = np.log(shade), np.log(np.maximum(bright, 1e-3) / np.maximum(base, 1e-3))
    some = np.clip(wanted, np.minimum(all_of_it, 0), np.maximum(all_of_it, 0))
    return np.exp(np.where(np.isfinite(wanted), some, 0))


def _solved(
    reach: np.ndarray, bright: np.ndarray, weight: np.ndarray, part: np.ndarray, material: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How much light comes from each source, in turn with a brightness of every material; and the materials."""
    found = even = _even()
    sure = np.sqrt(np.minimum(weight / np.median(weight), 1))
    hold = HELD * np.sqrt(len(bright) / len(even)) * np.eye(len(even)) / even.mean()
    for sweep in range(SWEEPS):
        given = np.maximum(reach @ found, 1e-3)
        log = np.log(bright / given)
        if sweep == SHARED:
            material = _split(log, part, material)
        _, group = np.unique(material[part], return_inverse=True)
        albedo = np.exp([np.median(log[group == g]) for g in range(group.max() + 1)])[group]
        robust = sure / np.sqrt(1 + ((albedo * given / bright - 1) / 0.3) ** 2)
        rows = np.concatenate([(robust * albedo / bright)[:, None] * reach, hold])
        found, _ = nnls(rows, np.concatenate([robust, hold @ even]), maxiter=50 * len(even))
        found = found / max(_open(found), 1e-6)
    return found, material


def _split(log: np.ndarray, part: np.ndarray, material: np.ndarray) -> np.ndarray:
    """Materials (P,), with one of its own for every part whose brightness (log) is far from its material's."""
    out = material.copy()
    for p in np.unique(part):
        mine, others = log[part == p], log[(material[part] == material[p]) & (part != p)]
        if len(mine) >= FEWEST and len(others) and abs(np.median(mine) - np.median(others)) > OTHER:
            out[p] = out.max() + 1
    return out


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
    """An overcast sky, three times as bright above as at the horizon, and what comes back: 1 on open level ground."""
    sky = (1 + 2 * _directions()[: DIRECTIONS // 2, 2]) / 2
    even = np.concatenate([sky, [FLOOR, OWN]])
    return even / _open(even)


def _open(strengths: np.ndarray) -> float:
    """The light on level ground in the open."""
    return float(strengths[: DIRECTIONS // 2] @ _directions()[: DIRECTIONS // 2, 2])
