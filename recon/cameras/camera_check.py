"""Whether given cameras fit what they are said to have seen, and if not, which of the usual other conventions does.

Masks: the rays through their middles must meet in front of the cameras. Points with tracks: each must lie in front of
the cameras that saw it, inside their pictures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from recon.geometry.align import looked_at
from recon.geometry.mask_checks import surely_inverted
from recon.scene import Cameras, InputError

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
_AXES = {"OpenCV": "OpenCV's axes (y down, z forward)", "OpenGL": "OpenGL's axes (y up, z backward)"}
_INVERSE = "inverse poses (camera_from_world and world_from_camera exchanged)"


def conventions(axes: str) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """What a file may hold instead of what its format says, and what its cam_from_world (V, 4, 4) then is.

    axes  the format's own, "OpenCV" or "OpenGL"
    """
    other = _AXES["OpenGL" if axes == "OpenCV" else "OpenCV"]
    return {
        other: lambda m: _FLIP @ m,
        _INVERSE: np.linalg.inv,
        f"{_INVERSE} and {other}": lambda m: _FLIP @ np.linalg.inv(m),
    }


FITS, FAILS = 0.8, 0.5  # of what was seen that a convention must explain to be taken, and below which it is refused
NEAR = 0.6  # of a mask's radius that the common middle may lie off the mask's own: objects are not symmetric
LEAST = 3  # views with a mask, fewer prove nothing
LEAST_SIGHTS = 30  # of points, fewer prove nothing
MORE = 4.0  # times the matches that another convention must explain to be taken


def fitting(
    cameras: Cameras,
    masks: dict[int, np.ndarray],
    points: np.ndarray,
    tracks: np.ndarray,
    source: Path,
    axes: str = "OpenCV",
) -> tuple[Cameras, list[str]]:
    """The cameras, in another convention where only that fits, and a warning that says so.

    masks   (H, W) bool by view, white = object
    points  (n, 3) in the cameras' world, tracks (n, V) bool; n may be 0
    source  the file or folder of the cameras, and axes its format's, "OpenCV" or "OpenGL"; for messages
    Raises InputError when no convention fits.
    """
    used = {v: ~m if surely_inverted(m) else m for v, m in masks.items() if m.any()}
    if len(used) >= LEAST:
        return _first_that_fits(cameras, lambda c: _meet(c, used), "the masks", source, axes)
    if tracks.sum() >= LEAST_SIGHTS:
        return _first_that_fits(cameras, lambda c: _in_view(c, points, tracks), "their own points", source, axes)
    return cameras, []


def _first_that_fits(
    cameras: Cameras, score: Callable[[Cameras], float], what: str, source: Path, axes: str
) -> tuple[Cameras, list[str]]:
    stated = score(cameras)
    if stated >= FAILS:
        return cameras, []
    others = _others(cameras, axes)
    scores = {name: score(other) for name, other in others.items()}
    best = max(scores, key=lambda name: scores[name])
    if scores[best] < FITS:
        raise InputError(
            f"the cameras in {source} do not fit {what}: {stated:.0%} of the views agree on where things are, and at "
            f"most {scores[best]:.0%} with inverse poses or other axes; do they belong to these photos? Photos "
            "alone do without cameras (--input photos)"
        )
    return others[best], [
        f"{source} fits {what} only with {best}: {scores[best]:.0%} of the views agree then, {stated:.0%} as its "
        "format has it; so it was taken that way"
    ]


def _others(cameras: Cameras, axes: str) -> dict[str, Cameras]:
    changes = conventions(axes)
    return {n: replace(cameras, cam_from_world=change(cameras.cam_from_world)) for n, change in changes.items()}


def by_matches(
    cameras: Cameras, count: Callable[[Cameras], int], stated: int, source: Path, axes: str
) -> tuple[Cameras, list[str]]:
    """As `fitting`, where neither masks nor points are there: by how many matches of the photos a convention explains.

    count   how many points matching finds with these cameras; stated: with those of the file
    Cameras that nothing explains stay as they are: the photos may show nothing that can be matched.
    """
    if len(cameras) < LEAST:
        return cameras, []
    others = _others(cameras, axes)
    counts = {name: count(other) for name, other in others.items()}
    best = max(counts, key=lambda name: counts[name])
    if counts[best] < max(LEAST_SIGHTS, MORE * stated):
        return cameras, []
    return others[best], [
        f"{source} fits its photos only with {best}: {counts[best]} points match then, {stated} as its format has it; "
        "so it was taken that way"
    ]


def _meet(cameras: Cameras, masks: dict[int, np.ndarray]) -> float:
    """Share of the masks whose middles lie near the picture of the place that all middles' rays come nearest to."""
    views = list(masks)
    shown = cameras.subset(views)
    middle = looked_at(shown, [masks[v] for v in views])
    good = 0
    for K, pose, v in zip(shown.K, shown.cam_from_world, views, strict=True):
        rows, columns = np.nonzero(masks[v])
        local = pose[:3, :3] @ middle + pose[:3, 3]
        if local[2] <= 0:
            continue
        pixel = (K @ local)[:2] / local[2]
        off = np.hypot(*(pixel - (columns.mean() + 0.5, rows.mean() + 0.5)))
        good += bool(off < NEAR * 0.5 * np.hypot(np.ptp(rows) + 1, np.ptp(columns) + 1))
    return good / len(views)


def _in_view(cameras: Cameras, points: np.ndarray, tracks: np.ndarray) -> float:
    """Share of the sights of points that lie in front of their camera and inside its picture."""
    good = 0
    for v, (K, pose, size) in enumerate(zip(cameras.K, cameras.cam_from_world, cameras.sizes, strict=True)):
        local = points[tracks[:, v]] @ pose[:3, :3].T + pose[:3, 3]
        front = local[local[:, 2] > 0] @ K.T
        pixels = front[:, :2] / front[:, 2:]
        good += int(((pixels > -0.1 * size) & (pixels < 1.1 * size)).all(1).sum())
    return good / int(tracks.sum())
