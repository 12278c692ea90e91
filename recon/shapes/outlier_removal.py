"""Points without what does not belong to the object: bad numbers, outliers, a floor, other objects."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.ndimage
from scipy.spatial import cKDTree

from datasets.mesh_reader import LARGEST
from recon.scene import InputError
from recon.shapes import floor_removal


@dataclass(frozen=True)
class CleaningOptions:
    """What is left out."""

    least_points: int = 20  # fewer say nothing about a shape
    outlier: float = 4.0  # a point this many times as far from its neighbours as usual is left out
    floor_overhang: float = 1.15  # a flat sheet this many times as wide as what stands on it is a floor
    floor_share: float = 0.08  # of the points; a sheet of fewer is no floor


@dataclass(frozen=True)
class Cleaned:
    """points (m, 3) of the object; what was left out, in words; and, where a floor that leans told it, the rotation
    level_from_input (3, 3) that sets the object upright and the only axis `up` that then points up."""

    points: np.ndarray
    said: list[str]
    level_from_input: np.ndarray = field(default_factory=lambda: np.eye(3))
    up: str | None = None


def cleaned(
    points: np.ndarray,
    path: Path,
    ups: tuple[str, ...],
    noisy: bool,
    most: int,
    seed: int,
    options: CleaningOptions = CleaningOptions(),
) -> Cleaned:
    """At most `most` points of the object, of (n, 3).

    ups    axes that may point up: a floor is looked for at the other end
    noisy  whether there may be outliers
    Raises InputError, naming the file, when too little is left to be a shape.
    """
    said: list[str] = []
    points = _usable(points, path, options.least_points, said)
    if len(points) > most:
        points = points[np.random.default_rng(seed).permutation(len(points))[:most]]
    # Many equal points would make all others outliers.
    points = points[np.sort(np.unique(points, axis=0, return_index=True)[1])]
    if noisy and len(points) > 1:
        points = _without_outliers(points, options.outlier, said)
    _check_extent(points, path)
    if (found := floor_removal.without_floor(points, ups, options.floor_share, seed)) is not None:
        return Cleaned(found.points, [*said, *found.said], found.level_from_input, found.up)
    points = _without_floor(points, ups, options, said)
    return Cleaned(_largest(points, said), said)


def _usable(points: np.ndarray, path: Path, least: int, said: list[str]) -> np.ndarray:
    """Without what is no number, and without the origin where a scanner wrote it again and again: it saw nothing."""
    finite = (np.abs(points) < LARGEST).all(1)  # NaN is not smaller
    bad, usable = int((~finite).sum()), points[finite]
    if len(usable) < least and bad > len(points) / 2:
        raise InputError(f"{path}: {bad:,} of {len(points):,} points are not numbers; export it again")
    if bad:
        said.append(f"{bad:,} points that are not numbers are left out")
    nothing = (usable == 0).all(1)
    if nothing.sum() > 1 and not nothing.all():
        said.append(f"{nothing.sum():,} points at 0, 0, 0, which stand for nothing seen, are left out")
        usable = usable[~nothing]
    if len(usable) < least:
        raise InputError(f"{path} has {len(usable)} usable points; a shape needs {least}, better 500 or more")
    return usable


def _check_extent(points: np.ndarray, path: Path) -> None:
    """Raises InputError for points in one place or on one line."""
    extent = float(np.ptp(points, axis=0).max())
    if not extent > max(1e-30, 1e-12 * float(np.abs(points).max())):
        raise InputError(f"{path}: all points lie in one place; give the whole surface of the object")
    spread = np.linalg.svd(points[:: max(1, len(points) // 5000)] - points.mean(0), compute_uv=False)
    if len(spread) < 2 or spread[1] <= 1e-6 * spread[0]:
        raise InputError(f"{path}: all points lie on one line; give the whole surface of the object")


def _without_outliers(points: np.ndarray, limit: float, said: list[str]) -> np.ndarray:
    """Without points that are much farther from their neighbours than is usual; a second look once they are gone."""
    for _ in range(2):
        k = min(8, len(points) - 1)
        reach = cKDTree(points).query(points, k + 1)[0][:, 1:].mean(1)
        keep = reach <= limit * np.median(reach) + 1e-12
        if keep.mean() < 0.7:
            break  # uneven rather than noisy
        if (gone := int((~keep).sum())) > len(points) / 200:
            said.append(f"{gone:,} outliers of {len(points):,} points are left out")
        points = points[keep]
    return points


def _without_floor(points: np.ndarray, ups: tuple[str, ...], options: CleaningOptions, said: list[str]) -> np.ndarray:
    """Without a flat sheet at the lower end that sticks out beyond everything else.

    Not at the upper end: a table's top is such a sheet, too.
    """
    for name in ups:
        axis, sign = "xyz".index(name[-1]), -1 if name[0] == "-" else 1
        height = sign * points[:, axis]
        sheet = height - height.min() < 0.015 * np.ptp(points, axis=0).max()
        others = [i for i in range(3) if i != axis]
        if not options.floor_share < sheet.mean() < 0.9:
            continue
        wide, rest = (np.ptp(p[:, others], axis=0) for p in (points[sheet], points[~sheet]))
        if (wide > options.floor_overhang * rest).all() and (np.percentile(height[~sheet], 90) - height.min()) > 0:
            said.append(f"a floor under the object ({sheet.mean():.0%} of the points) is left out")
            return points[~sheet]
    return points


def _largest(points: np.ndarray, said: list[str]) -> np.ndarray:
    """The largest of several objects that stand clearly apart."""
    cells = 24
    low, size = points.min(0), np.ptp(points, axis=0).max()
    index = np.minimum(((points - low) / size * cells).astype(int), cells - 1)
    filled = np.zeros((cells,) * 3, bool)
    filled[tuple(index.T)] = True
    labels, count = scipy.ndimage.label(scipy.ndimage.binary_dilation(filled, np.ones((3, 3, 3))), np.ones((3, 3, 3)))
    if count < 2 or len(points) < 200:
        return points
    member = labels[tuple(index.T)]
    sizes = np.bincount(member, minlength=count + 1)
    if np.sort(sizes)[-2] < 0.15 * len(points):
        return points
    said.append(f"{count} separate objects are there; only the largest is reconstructed, give one object a file")
    return points[member == sizes.argmax()]
