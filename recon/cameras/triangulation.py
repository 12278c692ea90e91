"""Sparse points of the room from photos whose cameras are known: features matched between neighbouring views."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from recon.geometry.room_planes import look_point
from recon.scene import Cameras

FEATURES = 2000  # a photo
NEIGHBOURS = 4  # views that each view is matched with
ANGLES = (4.0, 50.0)  # degrees between two views' directions to the object
RATIO = 0.8  # of the best to the second-best match's distance
TOLERANCE = 1.5  # px that a point may miss its features by, of a photo 1000 px wide


def triangulate(cameras: Cameras, paths: tuple[Path, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) in the cameras' world and tracks (n, V) bool, each seen by two views; deterministic.

    paths  V undistorted photos of the cameras
    """
    sift = cv2.SIFT_create(nfeatures=FEATURES)  # type: ignore[attr-defined]
    features = [_features(sift, path) for path in paths]
    points, tracks = [np.zeros((0, 3))], [np.zeros((0, len(cameras)), bool)]
    for a, b in _pairs(cameras):
        found = _two_views(cameras, a, b, features[a], features[b])
        seen = np.zeros((len(found), len(cameras)), bool)
        seen[:, [a, b]] = True
        points.append(found)
        tracks.append(seen)
    return np.concatenate(points), np.concatenate(tracks)


def _features(sift: Any, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) with centres at +0.5, and descriptors (n, 128) of unit length (RootSIFT)."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    keys, values = sift.detectAndCompute(image, None) if image is not None else ((), None)
    if values is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    root = np.sqrt(values / np.maximum(values.sum(1, keepdims=True), 1e-9))
    return np.array([k.pt for k in keys]) + 0.5, root.astype(np.float32)


def _pairs(cameras: Cameras) -> list[tuple[int, int]]:
    """Views and those next to them, seen from the place they look at."""
    rays = cameras.centres() - look_point(cameras)
    rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
    angle = np.degrees(np.arccos(np.clip(rays @ rays.T, -1, 1)))
    angle[(angle < ANGLES[0]) | (angle > ANGLES[1])] = np.inf
    pairs = set()
    for a, row in enumerate(angle):
        near = [int(b) for b in np.argsort(row, kind="stable")[:NEIGHBOURS] if np.isfinite(row[b])]
        pairs |= {(min(a, b), max(a, b)) for b in near}
    return sorted(pairs)


def _two_views(
    cameras: Cameras,
    a: int,
    b: int,
    first: tuple[np.ndarray, np.ndarray],
    second: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """(n, 3) points of mutual best matches that the two cameras agree on."""
    if min(len(first[0]), len(second[0])) < 2:
        return np.zeros((0, 3))
    alike = first[1] @ second[1].T
    best = alike.argmax(1)
    two = np.partition(alike, -2, axis=1)[:, -2:]
    distinct = (1 - two[:, 1]) < RATIO**2 * (1 - two[:, 0])
    i = np.flatnonzero(distinct & (alike.argmax(0)[best] == np.arange(len(best))))
    if not len(i):
        return np.zeros((0, 3))
    P = [cameras.K[v] @ cameras.cam_from_world[v, :3] for v in (a, b)]
    pixels = [first[0][i], second[0][best[i]]]
    points = cv2.triangulatePoints(P[0], P[1], pixels[0].T, pixels[1].T)
    good = np.abs(points[3]) > 1e-12
    points = (points[:3] / np.where(good, points[3], 1)).T
    for v, p, seen in zip((a, b), P, pixels, strict=True):
        local = points @ p[:, :3].T + p[:, 3]
        limit = TOLERANCE * max(1.0, float(cameras.sizes[v].max()) / 1000)
        with np.errstate(divide="ignore", invalid="ignore"):
            good &= (local[:, 2] > 0) & (np.linalg.norm(local[:, :2] / local[:, 2:] - seen, axis=1) < limit)
    return points[good]
