"""Each photo's camera about the sheets that it shows: what matches of two photos must agree with.

A sheet is known in every length, so one photo of it tells where the camera stands, if its focal length is known: to
half a degree, which is too coarse for a result, but tells matches between things that look alike (a chair from its two
sides, wallpaper) from right ones.
"""

from __future__ import annotations

import cv2
import numpy as np

from recon.cameras.pair_selection import camera_groups
from recon.scene import Frames
from recon.sheet.layout import boards

LEAST = 6  # corners
LEAST_PHOTOS = 4  # that tell a focal length
NEARBY = np.linspace(0.88, 1.12, 25)  # of the focal length that EXIF tells, tried
CLEAR = 1.15  # times the least error, that the ends of what was tried must have
FOCALS = np.geomspace(0.5, 2.5, 33)  # of the photo's longest side, tried where nothing tells the focal length
DECISIVE = 1.5  # times the error that the other of the two ways to see a plane must have
POOR = 4e-3  # of the longest side: a worse fit is none


def run(frames: Frames) -> dict[str, dict[int, list[float]]]:
    """cam_from_sheet (4, 4), row by row, by file name of the working copy and number of the board.

    Photos in which the two ways to see a plane fit alike are left out.
    """
    seen = frames.sheets
    out: dict[str, dict[int, list[float]]] = {}
    if seen is None:
        return {}
    focals = focal_lengths(frames)
    for view, board in np.unique(np.column_stack([seen.view, seen.board]), axis=0).tolist():
        mine = (seen.view == view) & (seen.board == board)
        if (seen.copy[mine] > 0).any() or mine.sum() < LEAST:
            continue
        places = boards()[board].in_metres(boards()[board].corners()[seen.corner[mine]])
        pose = None if np.isnan(focals[view]) else _pose(places, seen.pixels[mine], _K(frames, view, focals[view]))[0]
        if pose is not None:
            out.setdefault(frames.paths[view].name, {})[board] = pose.ravel().tolist()
    return out


def focal_lengths(frames: Frames) -> np.ndarray:
    """(V,) px: the one with which sheets in all photos of a camera fit best, where that is clear; else as EXIF says.

    A flat thing of known shape seen from several sides tells the focal length to some thousandths, and EXIF rounds it.
    NaN where neither tells it.
    """
    out = frames.focal_px.copy()
    for group in camera_groups(frames):
        views = np.flatnonzero([p.name in group["images"] for p in frames.paths])
        start = np.nan if group["params"] is None else float(group["params"][0])
        tried = FOCALS * float(frames.sizes[views].max()) if np.isnan(start) else start * NEARBY
        best = _best(frames, views, tried)
        if best is not None and np.isnan(start):
            best = _best(frames, views, best * NEARBY) or best
        out[views] = start if best is None else best
    return out


def _best(frames: Frames, views: np.ndarray, tried: np.ndarray) -> float | None:
    """The focal length among `tried` (and between them) with the least error; None where that is not clear."""
    errors = np.array([_misfit(frames, views, f) for f in tried])
    k = int(np.argmin(errors))
    clear = np.isfinite(errors[k]) and 0 < k < len(tried) - 1 and min(errors[0], errors[-1]) > CLEAR * errors[k]
    if not clear:
        return None
    at = np.log(tried[k - 1 : k + 2])
    a, b, _ = np.polyfit(at - at[1], errors[k - 1 : k + 2], 2)
    return float(np.exp(at[1] + np.clip(-b / (2 * a), at[0] - at[1], at[2] - at[1]))) if a > 0 else float(tried[k])


def _misfit(frames: Frames, views: np.ndarray, focal: float) -> float:
    """Mean error of all sheets in these photos at a focal length; infinite where too few photos show one."""
    seen, errors = frames.sheets, []
    if seen is None:
        return np.inf
    for view in views:
        for board in np.unique(seen.board[seen.view == view]):
            mine = (seen.view == view) & (seen.board == board) & (seen.copy == 0)
            if mine.sum() >= LEAST:
                places = boards()[board].in_metres(boards()[board].corners()[seen.corner[mine]])
                errors.append(_pose(places, seen.pixels[mine], _K(frames, view, focal))[1])
    return float(np.mean(errors)) if len(errors) >= LEAST_PHOTOS else np.inf


def _K(frames: Frames, view: int, focal: float) -> np.ndarray:
    width, height = frames.sizes[view]
    return np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])


def _pose(places: np.ndarray, pixels: np.ndarray, K: np.ndarray) -> tuple[np.ndarray | None, float]:
    """cam_from_sheet (4, 4), None when it is not clear, and the error in px."""
    if np.linalg.matrix_rank(places - places.mean(0), tol=1e-6) < 2:
        return None, np.inf
    straight = np.zeros(0)  # no distortion
    ok, turns, shifts, errors = cv2.solvePnPGeneric(places, pixels, K, straight, flags=cv2.SOLVEPNP_IPPE)
    if not ok:
        return None, np.inf
    errors = np.ravel(errors)
    turn, shift = cv2.solvePnPRefineLM(places, pixels, K, straight, turns[0], shifts[0])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(turn)[0], np.ravel(shift)
    local = places @ pose[:3, :3].T + pose[:3, 3]
    seen = local @ K.T
    error = float(np.sqrt((((seen[:, :2] / seen[:, 2:]) - pixels) ** 2).sum(1).mean()))
    clear = len(errors) < 2 or errors[1] > DECISIVE * errors[0]
    fits = error < POOR * 2 * max(K[0, 2], K[1, 2]) and (local[:, 2] > 0).all()
    return (pose if clear and fits else None), error
