"""How much an input looks like another kind of thing than the class that was fitted to it, whatever its parameters.

A class of forty parameters follows many outlines that no one would take for its own. So the input's outlines, alone,
are shown to a network that knows kinds of things (nnproc.outline_net). Of other classes it says nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.spatial import cKDTree
from scipy.special import logsumexp

from datasets.camera_rings import look_at
from datasets.outline_frame import KINDS
from nnproc import outline_net
from nnproc.infer import WeightsError

MOST = 6.0  # log-odds: one outline says no more
PIXELS, POINTS = 128, 20_000  # of pictures of a surface, and points that are drawn in them
VIEWS = [(15 + 30 * i, (5, 30)[i % 2]) for i in range(12)]  # degrees round it and above it
DISTANCE = 2.5  # canonical units, of the cameras


def of_masks(kind: str, masks: Sequence[np.ndarray]) -> float:
    """Mean log-odds that masks (H, W) bool show another kind of thing; 0 for a kind that the network does not know."""
    shown = [m for m in masks if m.any()]
    if kind not in KINDS or not shown:
        return 0.0
    try:
        said = outline_net.log_chances(outline_net.load(), shown)
    except WeightsError:
        return 0.0
    mine = KINDS.index(kind)
    odds = logsumexp(np.delete(said, mine, 1), 1) - said[:, mine]
    return float(np.clip(odds, -MOST, MOST).mean())


def of_surface(kind: str, points: np.ndarray) -> float:
    """The same of surface points (n, 3) in the canonical frame, seen from all round."""
    if kind not in KINDS:
        return 0.0
    return of_masks(kind, pictures(points))


def pictures(points: np.ndarray) -> list[np.ndarray]:
    """(128, 128) bool each: silhouettes of a surface that is known by points (n, 3)."""
    some = points[np.random.default_rng(0).permutation(len(points))[:POINTS]]
    middle = (some.min(0) + some.max(0)) / 2
    gap = float(np.median(cKDTree(some).query(some[:2000], 2)[0][:, 1])) * 1.5
    return [_picture(some, middle, azimuth, elevation, gap) for azimuth, elevation in VIEWS]


def _picture(points: np.ndarray, middle: np.ndarray, azimuth: float, elevation: float, gap: float) -> np.ndarray:
    """Points as discs as wide as their gaps, shrunk again at the outline."""
    a, e = np.radians([azimuth, elevation])
    eye = middle + DISTANCE * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    pose = look_at(eye, middle)[:3]
    local = points @ pose[:, :3].T + pose[:, 3]
    seen = local[:, :2] / local[:, 2:]
    low, high = seen.min(0), seen.max(0)
    focal = 0.85 * PIXELS / max(float((high - low).max()), 1e-9)
    x, y = (focal * (seen - (low + high) / 2) + PIXELS / 2).astype(int).T
    out = np.zeros((PIXELS, PIXELS), np.uint8)
    out[y, x] = 1
    reach = int(np.ceil(max(1.0, focal * gap / DISTANCE)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return cv2.morphologyEx(out, cv2.MORPH_CLOSE, disc) > 0
