"""Surface grids as an encoder meets them outside the laboratory: hulls, splatted clouds, and scans with damage.

An encoder that has seen only what a procedure makes trusts every voxel. These functions take such a grid
(64, 64, 64) bool and give one that a real object of that shape might have given; each is deterministic by its rng.

  splat    a sparse, noisy cloud of points, perhaps of one side only, made a surface as reconstruction does it
  damaged  holes, missing parts, voxels dropped, specks, a box that is a voxel off
  met      a visual hull in the ways in which reconstruction asks about one
Hulls need the shape itself: datasets.hulls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.ndimage

from datasets.voxels import RESOLUTION, spacing_of, splat_grid


@dataclass(frozen=True)
class SplatOptions:
    """What a cloud is like; lengths in canonical units, where the object's longest side is 1."""

    points: tuple[int, int] = (300, 5000)  # drawn evenly by factors
    one_sided: float = 0.3  # share of the clouds that one camera saw
    noise: float = 0.01  # largest spread of the points


@dataclass(frozen=True)
class DamageOptions:
    """What may happen to a grid, each with its chance; lengths in voxels, shares of the filled voxels."""

    dropped: tuple[float, float] = (0.45, 0.4)  # chance, largest share
    holes: tuple[float, int, float] = (0.4, 4, 9.0)  # chance, most, largest radius
    cut: tuple[float, float] = (0.2, 0.2)  # chance, largest share beyond a plane
    chunk: tuple[float, float] = (0.3, 0.3)  # chance, largest share of what hangs together
    specks: tuple[float, float] = (0.35, 0.04)  # chance, largest number, as a share of the filled voxels
    moved: tuple[float, int] = (0.4, 1)  # chance, largest step along an axis
    scaled: tuple[float, float] = (0.35, 0.04)  # chance, largest change of each side
    thick: float = 0.15  # chance that the surface is two voxels thick


def splat(grid: np.ndarray, rng: np.random.Generator, options: SplatOptions = SplatOptions()) -> np.ndarray:
    """The grid of a cloud drawn from the surface, in the cloud's own box."""
    where = np.argwhere(grid)
    if rng.random() < options.one_sided:
        where = where[_seen(where, rng)]
    low, high = np.log(options.points)
    count = int(np.exp(rng.uniform(low, high)))
    points = (where[rng.integers(len(where), size=count)] + rng.random((count, 3))) / RESOLUTION - 0.5
    points += rng.normal(0, rng.uniform(0, options.noise) + 1e-9, points.shape)
    low, high = points.min(0), points.max(0)
    points = (points - (low + high) / 2) / (high - low).max()
    return splat_grid(points, spacing_of(points))


def damaged(grid: np.ndarray, rng: np.random.Generator, options: DamageOptions = DamageOptions()) -> np.ndarray:
    """The grid after one or more mishaps; never empty when the grid was not."""
    out = grid
    if rng.random() < options.scaled[0]:
        out = stretched(out, 1 + rng.uniform(-options.scaled[1], options.scaled[1], 3))
    if rng.random() < options.thick:
        out = scipy.ndimage.binary_dilation(out)
    if rng.random() < options.moved[0]:
        out = moved(out, rng.integers(-options.moved[1], options.moved[1] + 1, 3))
    where = np.argwhere(out)
    for chance, lost in (
        (options.holes[0], _holes),
        (options.cut[0], _cut),
        (options.chunk[0], _chunk),
        (options.dropped[0], _dropped),
    ):
        if rng.random() < chance:
            rest = where[~lost(where, rng, options)]
            where = rest if len(rest) else where
    if rng.random() < options.specks[0]:
        where = np.concatenate([where, _specks(where, rng, options)])
    out = np.zeros_like(grid)
    out[tuple(where.T)] = True
    return out


def met(hull: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A hull's skin as it is, as photos give it, or as its mesh gives it: in its own box, every voxel that is cut."""
    if rng.random() < 0.6:
        return hull
    out = boxed(hull)
    return scipy.ndimage.binary_dilation(out) if rng.random() < 0.5 else out


def boxed(grid: np.ndarray) -> np.ndarray:
    """The grid moved and scaled so that its own box is centred and its longest side fills the cube."""
    where = np.argwhere(grid)
    low, high = where.min(0), where.max(0) + 1
    middle, side = (low + high) / 2, float((high - low).max())
    return _resampled(grid, [(_MIDDLES - RESOLUTION / 2) * side / RESOLUTION + m for m in middle])


def stretched(grid: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """The grid scaled round its middle by a factor (3,) an axis."""
    return _resampled(grid, [(_MIDDLES - RESOLUTION / 2) / f + RESOLUTION / 2 for f in factors])


def moved(grid: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """The grid moved by whole voxels (3,) int; what leaves the cube is gone."""
    return _resampled(grid, [_MIDDLES - s for s in steps])


_MIDDLES = np.arange(RESOLUTION) + 0.5


def _resampled(grid: np.ndarray, places: list[np.ndarray]) -> np.ndarray:
    """(64, 64, 64) bool: along each axis what the grid holds at these places, in voxels; nothing beyond its borders."""
    out = grid
    for axis, place in enumerate(places):
        index = np.floor(place).astype(int)
        out = out.take(np.clip(index, 0, RESOLUTION - 1), axis)
        beyond = [slice(None)] * 3
        beyond[axis] = (index < 0) | (index >= RESOLUTION)
        out[tuple(beyond)] = False
    return out


def _seen(where: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n,) bool: the voxels that a camera far away sees, from a random direction that is not quite from above."""
    azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(0, 45))
    level, up = np.cos(elevation), np.sin(elevation)
    towards = np.array([level * np.cos(azimuth), level * np.sin(azimuth), up])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0])
    pixel = np.floor((where - RESOLUTION / 2) @ np.stack([right, np.cross(towards, right)], 1) / 1.2).astype(int)
    pixel -= pixel.min(0)
    flat, depth = pixel @ [pixel[:, 1].max() + 1, 1], -(where @ towards)
    nearest = np.full(flat.max() + 1, np.inf)
    np.minimum.at(nearest, flat, depth)
    return depth <= nearest[flat] + 1.8  # voxels: a pixel holds a surface seen at a slant


def _holes(where: np.ndarray, rng: np.random.Generator, options: DamageOptions) -> np.ndarray:
    lost = np.zeros(len(where), bool)
    for _ in range(int(rng.integers(1, options.holes[1] + 1))):
        middle = where[rng.integers(len(where))]
        lost |= ((where - middle) ** 2).sum(1) < rng.uniform(2.0, options.holes[2]) ** 2
    return lost


def _cut(where: np.ndarray, rng: np.random.Generator, options: DamageOptions) -> np.ndarray:
    along = where @ rng.normal(size=3)
    return along > np.quantile(along, 1 - rng.uniform(0, options.cut[1]))


def _chunk(where: np.ndarray, rng: np.random.Generator, options: DamageOptions) -> np.ndarray:
    """What hangs together within a random box round a voxel, nearest first."""
    middle = where[rng.integers(len(where))]
    near = np.flatnonzero((np.abs(where - middle) <= rng.uniform(4, 24, 3)).all(1))
    grid = np.zeros((RESOLUTION,) * 3, bool)
    grid[tuple(where[near].T)] = True
    low, high = where[near].min(0), where[near].max(0) + 1
    part = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    labels = scipy.ndimage.label(grid[part], np.ones((3, 3, 3)))[0]
    near = near[labels[tuple((where[near] - low).T)] == labels[tuple(middle - low)]]
    order = np.argsort(((where[near] - middle) ** 2).sum(1), kind="stable")
    lost = np.zeros(len(where), bool)
    lost[near[order][: int(options.chunk[1] * len(where))]] = True
    return lost


def _dropped(where: np.ndarray, rng: np.random.Generator, options: DamageOptions) -> np.ndarray:
    return rng.random(len(where)) < rng.uniform(0, options.dropped[1])


def _specks(where: np.ndarray, rng: np.random.Generator, options: DamageOptions) -> np.ndarray:
    """(k, 3) voxels near filled ones."""
    count = int(rng.uniform(0, options.specks[1]) * len(where))
    near = where[rng.integers(len(where), size=count)] + np.rint(rng.normal(0, 1.5, (count, 3))).astype(int)
    return np.clip(near, 0, RESOLUTION - 1)
