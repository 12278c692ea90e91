"""Cameras on two rings round an object, or on a part of them, each placed so that the object fills the picture.

Cameras: OpenCV axes, pixel centres at +0.5. World: metres, Z up, floor at z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MARGIN = 0.04  # of the picture's width and height, kept free of the object on every side


@dataclass(frozen=True)
class Orbit:
    elevations: tuple[float, float] = (15.0, 40.0)  # degrees above the horizon, the two rings
    jitter: float = 3.0  # degrees, how far azimuth and elevation stray
    roll: float = 1.5  # degrees, how far the camera tilts sideways
    aim: float = 0.03  # of the object's longest side, how far the camera looks past its middle
    fill: tuple[float, float] = (0.62, 0.74)  # of the picture's height that the object takes
    arc: float = 360.0  # degrees of azimuth that each ring covers; 360 = all round, from azimuth 0
    towards: float = 0.0  # degrees, azimuth of the middle of a smaller arc


def intrinsics(width: int, height: int, focal: float) -> np.ndarray:
    """(3, 3) float, pixels; the principal point is the middle of the picture."""
    return np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])


def project(points: np.ndarray, K: np.ndarray, cam_from_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) and depths (n,) of world points (n, 3)."""
    local = points @ cam_from_world[:3, :3].T + cam_from_world[:3, 3]
    pixels = local @ K.T
    return pixels[:, :2] / pixels[:, 2:], local[:, 2]


def look_at(eye: np.ndarray, target: np.ndarray, roll: float = 0.0) -> np.ndarray:
    """cam_from_world (4, 4) of a camera at `eye` that looks at `target`, Z up, then rolled (radians)."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    level = np.array([right, down, forward])
    turn = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1.0]])
    out = np.eye(4)
    out[:3, :3] = turn @ level
    out[:3, 3] = -out[:3, :3] @ eye
    return out


def plan(
    points: np.ndarray, views: int, K: np.ndarray, size: tuple[int, int], orbit: Orbit, rng: np.random.Generator
) -> np.ndarray:
    """cam_from_world (views, 4, 4): a low ring, then a high one half a step on.

    points  (n, 3) float, the object's vertices in the world frame
    size    (width, height) in pixels
    """
    low = (views + 1) // 2
    start = 0.0 if orbit.arc >= 360 else orbit.towards - orbit.arc / 2
    out = []
    for i in range(views):
        ring, count, j = (0, low, i) if i < low else (1, views - low, i - low)
        step = (j + 0.5 * ring) / count if orbit.arc >= 360 else (j + 0.25 + 0.5 * ring) / count
        azimuth = start + orbit.arc * step + rng.uniform(-orbit.jitter, orbit.jitter)
        elevation = orbit.elevations[ring] + rng.uniform(-orbit.jitter, orbit.jitter)
        out.append(_place(points, np.radians([azimuth, elevation]), K, size, orbit, rng))
    return np.array(out)


def _place(
    points: np.ndarray,
    angles: np.ndarray,
    K: np.ndarray,
    size: tuple[int, int],
    orbit: Orbit,
    rng: np.random.Generator,
) -> np.ndarray:
    low, high = points.min(0), points.max(0)
    longest = float((high - low).max())
    target = (low + high) / 2 + rng.uniform(-orbit.aim, orbit.aim, 3) * longest
    azimuth, elevation = angles
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    roll = np.radians(rng.uniform(-orbit.roll, orbit.roll))
    fill = rng.uniform(*orbit.fill)
    # Nearer than this a point could be behind the camera; the excess falls steadily with distance, so halve.
    near = float(np.linalg.norm(points - target, axis=1).max()) * 1.05
    far = near * 100
    for _ in range(50):
        middle = np.sqrt(near * far)
        pose = look_at(target + middle * towards, target, roll)
        near, far = (middle, far) if _excess(points, K, pose, size, fill) > 1 else (near, middle)
    return look_at(target + far * towards, target, roll)


def _excess(points: np.ndarray, K: np.ndarray, pose: np.ndarray, size: tuple[int, int], fill: float) -> float:
    """How far the object is too large in the picture: 1 = as large as it may be."""
    pixels, _ = project(points, K, pose)
    half = np.array(size) / 2
    extent = np.ptp(pixels, axis=0) / size
    reach = np.abs(pixels - half).max(axis=0) / (half * (1 - 2 * MARGIN))
    return float(max(extent[1] / fill, reach.max()))
