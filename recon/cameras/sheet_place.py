"""Where printed sheets lie in the cameras' world, and with that how long its unit is.

A sheet is flat and its size is known: its seven unknowns (a similarity) are found so that its corners fall on where the
photos show them. Two photos give a start; most of the others must agree, which leaves out sheets that were moved,
copies of the same sheet, and cameras that stand elsewhere.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from recon.geometry.lenses import unbent
from recon.geometry.umeyama import similarity_between
from recon.scene import Cameras, Frames, Poses, PrintedSheet, Sightings
from recon.sheet.layout import boards, name_of

log = logging.getLogger("recon.cameras")

NEAR = 4e-3  # of a photo's longest side, that corners may miss by
APART = 5.0  # degrees between the directions of the two photos of a start
STARTS = 60  # pairs of photos that are tried
LEAST_CORNERS = 4


@dataclass(frozen=True)
class _Seen:
    """One sheet in one photo: view, the corners' places in its own frame (k, 3) metres, and pixels (k, 2), pinhole."""

    view: int
    places: np.ndarray
    pixels: np.ndarray


def run(frames: Frames, poses: Poses) -> Poses:
    """The poses with the sheets that lie there; a warning where they are seen but cannot be placed."""
    if frames.sheets is None:
        return poses
    sheets, warnings = [], []
    for number in np.unique(frames.sheets.board).tolist():
        seen = _sightings(frames, poses, frames.sheets, number)
        if (placed := place(poses.cameras, seen, number)) is not None:
            sheets.append(placed)
        elif warning := _not_placed(frames, frames.sheets, poses, number):
            warnings.append(warning)
    for sheet in sheets:
        log.info("the printed %s: in %d photos, to %.2f px", sheet.name, len(sheet.names), sheet.error)
    for warning in warnings:
        log.warning(warning)
    return replace(poses, sheets=tuple(sheets), warnings=(*poses.warnings, *warnings))


def _sightings(frames: Frames, poses: Poses, seen: Sightings, number: int) -> list[_Seen]:
    """What registered photos show of one sheet, copies apart; pixels of the undistorted photos."""
    out, column = [], {name: i for i, name in enumerate(poses.cameras.names)}
    places = boards()[number].in_metres(boards()[number].corners())
    mine = seen.board == number
    for view, copy in np.unique(np.column_stack([seen.view, seen.copy])[mine], axis=0):
        camera = column.get(frames.names[view])
        rows = mine & (seen.view == view) & (seen.copy == copy)
        if camera is None or rows.sum() < LEAST_CORNERS:
            continue
        pixels, lens = seen.pixels[rows], poses.lenses[camera] if poses.lenses else None
        if lens is not None:
            upright = lens.size[::-1] if lens.turns % 2 else lens.size
            rays = unbent(lens, pixels * (upright / poses.cameras.sizes[camera]))
            pixels = (rays @ poses.cameras.K[camera].T)[:, :2]
        out.append(_Seen(camera, places[seen.corner[rows]], pixels))
    return out


def place(cameras: Cameras, seen: list[_Seen], number: int) -> PrintedSheet | None:
    """The sheet where most photos have it; None when no two photos from apart agree."""
    best: list[_Seen] = []
    start = np.eye(4)
    for a, b in _pairs(cameras, seen):
        matrix = _from_two(cameras, a, b)
        agree = [] if matrix is None else _agreeing(cameras, seen, matrix)
        if matrix is not None and len(agree) > len(best):
            best, start = agree, matrix
    if len({s.view for s in best}) < 2:
        return None
    matrix = start
    for _ in range(3):
        matrix = _polished(cameras, best, matrix)
        agree = _agreeing(cameras, seen, matrix)
        if len(agree) < 2:
            return None
        best = agree
    error = float(np.median([_error(cameras, s, matrix) for s in best]))
    return PrintedSheet(name_of(number), matrix, tuple(cameras.names[s.view] for s in best), error)


def _pairs(cameras: Cameras, seen: list[_Seen]) -> list[tuple[_Seen, _Seen]]:
    """Pairs of sightings from well apart, some of all where there are many."""
    forward = cameras.cam_from_world[:, 2, :3]
    rays = {}
    for i, s in enumerate(seen):
        middle = np.linalg.solve(cameras.K[s.view], [*s.pixels.mean(0), 1.0])
        ray = middle @ cameras.cam_from_world[s.view, :3, :3]
        rays[i] = ray / np.linalg.norm(ray) if np.isfinite(ray).all() else forward[s.view]
    apart = [
        (seen[i], seen[j])
        for i, j in combinations(range(len(seen)), 2)
        if seen[i].view != seen[j].view and rays[i] @ rays[j] < np.cos(np.radians(APART))
    ]
    step = max(1, len(apart) // STARTS)
    return apart[::step]


def _from_two(cameras: Cameras, a: _Seen, b: _Seen) -> np.ndarray | None:
    """world_from_sheet (4, 4) of corners that two photos show, triangulated; None when they share too few."""
    common = [(i, j) for i, p in enumerate(a.places) for j, q in enumerate(b.places) if (p == q).all()]
    if len(common) < LEAST_CORNERS:
        return None
    i, j = (list(side) for side in zip(*common, strict=True))
    points = []
    for first, second in zip(a.pixels[i], b.pixels[j], strict=True):
        rows = []
        for s, (u, v) in ((a, first), (b, second)):
            P = cameras.K[s.view] @ cameras.cam_from_world[s.view, :3]
            rows += [u * P[2] - P[0], v * P[2] - P[1]]
        point = np.linalg.svd(np.array(rows))[2][3]
        if abs(point[3]) < 1e-12:
            return None
        points.append(point[:3] / point[3])
    places = a.places[i]
    if np.linalg.matrix_rank(places - places.mean(0)) < 2:
        return None
    matrix = similarity_between(places, np.array(points))
    return matrix if np.linalg.det(matrix[:3, :3]) > 0 and np.isfinite(matrix).all() else None


def _agreeing(cameras: Cameras, seen: list[_Seen], matrix: np.ndarray) -> list[_Seen]:
    """Of every photo the sighting that lies where the sheet is, if one does, seen from the side that is printed on."""
    nearest: dict[int, tuple[float, _Seen]] = {}
    for s in seen:
        error = _error(cameras, s, matrix)
        limit = max(2.0, NEAR * float(cameras.sizes[s.view].max()))
        if error < min(limit, nearest.get(s.view, (np.inf, s))[0]):
            nearest[s.view] = error, s
    return [s for _, s in nearest.values()]


def _residuals(cameras: Cameras, s: _Seen, matrix: np.ndarray) -> np.ndarray:
    """(k, 2) px from where a photo shows the corners to where the sheet at `matrix` puts them."""
    world = s.places @ matrix[:3, :3].T + matrix[:3, 3]
    pose = cameras.cam_from_world[s.view]
    local = world @ pose[:3, :3].T + pose[:3, 3]
    depth = np.where(np.abs(local[:, 2:]) > 1e-12, local[:, 2:], 1e-12)
    seen = (local / depth) @ cameras.K[s.view].T
    return seen[:, :2] - s.pixels


def _error(cameras: Cameras, s: _Seen, matrix: np.ndarray) -> float:
    """Root mean square, px; infinite for a sheet behind the camera or seen from below."""
    pose = cameras.cam_from_world[s.view]
    middle = pose[:3, :3] @ matrix[:3, 3] + pose[:3, 3]
    if middle[2] <= 0 or middle @ (pose[:3, :3] @ matrix[:3, 2]) >= 0:
        return np.inf
    return float(np.sqrt((_residuals(cameras, s, matrix) ** 2).sum(1).mean()))


def _polished(cameras: Cameras, seen: list[_Seen], start: np.ndarray) -> np.ndarray:
    """The similarity with the least residuals, those of bad sightings counting less."""
    size = float(np.cbrt(np.linalg.det(start[:3, :3])))
    turn = Rotation.from_matrix(start[:3, :3] / size)

    def matrix(x: np.ndarray) -> np.ndarray:
        out = np.eye(4)
        out[:3, :3] = size * np.exp(x[6]) * (Rotation.from_rotvec(x[:3]) * turn).as_matrix()
        out[:3, 3] = start[:3, 3] + size * x[3:6]
        return out

    found = least_squares(
        lambda x: np.concatenate([_residuals(cameras, s, matrix(x)).ravel() for s in seen]),
        np.zeros(7),
        loss="soft_l1",
        f_scale=1.0,
        x_scale=[0.01] * 7,
        max_nfev=30,
    )
    return matrix(found.x)


def _not_placed(frames: Frames, seen: Sightings, poses: Poses, number: int) -> str:
    """Why a sheet that is seen gives no size; "" when it is seen in too few photos to be worth a word."""
    names = [frames.names[v] for v in np.unique(seen.view[seen.board == number])]
    placed = [n for n in names if n in poses.cameras.names]
    if len(placed) < 2:
        where = f"one photo only ({names[0]})" if len(names) == 1 else f"{len(names)} photos, of which fewer than two"
        told = "" if len(names) == 1 else " have a camera"
        return f"a printed sheet is seen in {where}{told}: it gives no size; two photos from different sides are needed"
    return (
        f"a printed sheet is seen in {len(placed)} photos, but no two of them agree on where it lies: was it moved, or "
        "is it seen from one side only? It gives no size"
    )
