"""The floor under a scanned object, at any tilt, and what else stands on it.

A floor is a flat sheet that everything lies above and that reaches well beyond the object. A table's top is such a
sheet, too, with the legs on its other side: so a floor must lie below, by an axis that may point up, to within TILT.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import scipy.ndimage

from recon.geometry.view_geometry import shortest_turn

TILT = 50.0  # degrees that a floor may lean from level in its file
LEVEL = 1.0  # degrees of tilt that need no turning
TRIALS, SOME = 600, 3000  # planes that are tried, on so many of the points
THICK = 0.012  # of the longest side: what lies nearer to the floor is floor
BELOW = 0.02  # of the points may lie under the floor, as noise
FREE = 0.6  # times the object's own ground plan: so much floor lies bare beside all that stands on it
CELLS = 32  # along the longest side, to tell apart what stands on it
TILES = (6, 24)  # fewest and most along the longest side, to see where nothing stands on it
BESIDE = 0.12  # of the object's width: what stands further beside it is something else


@dataclass(frozen=True)
class OnFloor:
    """points (m, 3) of the object alone, in the input's axes; level_from_input (3, 3) rotation that makes the floor
    level, with `up` (an axis name, such as "z") as its normal; and what was left out, in words."""

    points: np.ndarray
    level_from_input: np.ndarray
    up: str
    said: tuple[str, ...]


def without_floor(points: np.ndarray, ups: tuple[str, ...], share: float, seed: int) -> OnFloor | None:
    """The object over a floor, None when no floor is seen.

    ups    axes that may point up; share: of the points that a floor has at least
    """
    size = float(np.ptp(points, axis=0).max())
    found = max((_floor(points, up, size, share, seed) for up in ups), key=lambda f: f[0], default=None)
    if found is None or not found[0]:
        return None
    _, up, normal, level = found
    height = points @ normal - level
    above = height > THICK * size
    turn = shortest_turn(normal, _direction(up))
    flat = np.delete(points @ turn.T, _axis(up), axis=1) / size
    if above.sum() < share * len(points):
        return None
    main = _object(points[above], size)
    chosen = np.flatnonzero(above)[main]
    if _free(flat, above) < FREE * _area(flat[chosen]):
        return None
    tilt = float(np.degrees(np.arccos(np.clip(normal @ _direction(up), -1, 1))))
    leans = f" that leans by {tilt:.0f} degrees" if tilt > LEVEL else ""
    said = [f"a floor{leans} under the object ({(~above).mean():.0%} of the points) is left out"]
    beside = int(above.sum()) - len(chosen)
    if beside > share / 10 * len(points):
        said.append(f"{beside:,} points that stand beside the object on the floor are left out")
    return OnFloor(points[chosen], turn if tilt > LEVEL else np.eye(3), up, tuple(said))


def _floor(points: np.ndarray, up: str, size: float, share: float, seed: int) -> tuple[float, str, np.ndarray, float]:
    """(share of the points on it, up, unit normal towards the object, its level); share 0 when there is none."""
    rng = np.random.default_rng(seed)
    some = points[rng.permutation(len(points))[:SOME]]
    corners = some[rng.integers(len(some), size=(TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    upright = normals @ _direction(up)
    normals = normals * (np.sign(upright) / np.maximum(length, 1e-300))[:, None]
    best: tuple[float, str, np.ndarray, float] = (0.0, up, _direction(up), 0.0)
    for normal, corner in zip(normals, corners[:, 0], strict=True):
        if normal @ _direction(up) < np.cos(np.radians(TILT)):
            continue
        height = (some - corner) @ normal
        on = np.abs(height) < THICK * size
        if on.mean() > max(best[0], share) and (height < -THICK * size).mean() < BELOW:
            best = float(on.mean()), up, normal, float(corner @ normal)
    return _refined(points, best, size) if best[0] else best


def _refined(
    points: np.ndarray, found: tuple[float, str, np.ndarray, float], size: float
) -> tuple[float, str, np.ndarray, float]:
    """The plane through the middle of the points on it."""
    share, up, normal, level = found
    for _ in range(3):
        on = points[np.abs(points @ normal - level) < THICK * size]
        middle = on.mean(0)
        across = np.linalg.svd(on[:: max(1, len(on) // 5000)] - middle, full_matrices=False)[2][2]
        normal = across * np.sign(across @ normal)
        level = float(middle @ normal)
    return share, up, normal, level


def _object(points: np.ndarray, size: float) -> np.ndarray:
    """(n,) int: of points over the floor those of the largest thing, with what stands apart within its ground plan."""
    low = points.min(0)
    index = ((points - low) / size * CELLS).astype(int)
    filled = np.zeros(index.max(0) + 3, bool)
    filled[tuple((index + 1).T)] = True
    labels, count = scipy.ndimage.label(scipy.ndimage.binary_dilation(filled, np.ones((3, 3, 3))), np.ones((3, 3, 3)))
    member = labels[tuple((index + 1).T)]
    largest = int(np.bincount(member, minlength=count + 1).argmax())
    inside = points[member == largest]
    margin = BESIDE * float(np.ptp(inside, axis=0).max())
    lower, upper = inside.min(0) - margin, inside.max(0) + margin
    kept = [
        k
        for k in range(1, count + 1)
        if k == largest or ((points[member == k] >= lower) & (points[member == k] <= upper)).all(1).mean() > 0.9
    ]
    return np.flatnonzero(np.isin(member, kept))


def _free(flat: np.ndarray, above: np.ndarray) -> float:
    """Area of the floor, of points (n, 2) in shares of the longest side, with nothing over it or right beside it."""
    tiles = int(np.clip(np.sqrt((~above).sum() / 4), *TILES))  # as small as they are still filled
    index = ((flat - flat.min(0)) * tiles).astype(int) + 1
    grids = np.zeros((2, *(index.max(0) + 2)), bool)
    for grid, some in zip(grids, (index[~above], index[above]), strict=True):
        grid[tuple(some.T)] = True
    covered = scipy.ndimage.binary_dilation(grids[1], np.ones((3, 3)))
    return float((grids[0] & ~covered).sum()) / tiles**2


def _area(flat: np.ndarray) -> float:
    """Of the convex hull of points (n, 2)."""
    if len(flat) < 3:
        return 0.0
    return float(cv2.contourArea(cv2.convexHull(flat.astype(np.float32))))


def _axis(name: str) -> int:
    return "xyz".index(name[-1])


def _direction(name: str) -> np.ndarray:
    return np.eye(3)[_axis(name)] * (-1 if name[0] == "-" else 1)
