"""Focal length and principal point that the user knows; structure from motion then holds them."""

from __future__ import annotations

import math

import numpy as np

from recon.scene import Frames, InputError

FULL_FRAME_MM = 36.0
EQUAL = 1e-3  # fx and fy nearer to each other than this share are one focal length


def parse_intrinsics(text: str) -> tuple[float, float, float, float]:
    """ "fx,fy,cx,cy" in pixels of the original photos, upright; raises InputError."""
    values = _numbers(text)
    if len(values) != 4 or min(values, default=0) <= 0:
        raise InputError(f"--intrinsics wants fx,fy,cx,cy in pixels of the original photos, got {text!r}")
    return values[0], values[1], values[2], values[3]


def parse_focal_mm(text: str) -> tuple[float, float]:
    """ "F" or "F,SENSOR_WIDTH" in mm; the sensor's width is that of its longer side. Raises InputError."""
    values = _numbers(text)
    if len(values) not in (1, 2) or min(values, default=0) <= 0:
        raise InputError(f"--focal-mm wants the focal length in mm, or F,SENSOR_WIDTH_MM, got {text!r}")
    sensor = values[1] if len(values) == 2 else FULL_FRAME_MM
    if not 0.15 < values[0] / sensor < 12:
        raise InputError(
            f"--focal-mm: {values[0]:g} mm on a sensor {sensor:g} mm wide is no photo lens; give the sensor's width, "
            "or the focal length as on full frame (35 mm equivalent)"
        )
    return values[0], sensor


def _numbers(text: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        return []
    return values if all(map(math.isfinite, values)) else []


def held(
    frames: Frames, intrinsics: tuple[float, float, float, float] | None, focal_mm: tuple[float, float] | None
) -> np.ndarray | None:
    """(V, 4) float, fx, fy, cx, cy in pixels of the working copies; None when the user gave neither.

    `intrinsics` belong to the originals; a photo taken with the camera turned has x and y exchanged.
    Raises InputError when the principal point is nowhere near the photos' middle.
    """
    sizes = frames.sizes.astype(float)
    if intrinsics is not None:
        fx, fy, cx, cy = intrinsics
        original = sizes if frames.original is None else frames.original.astype(float)
        turned = (original[:, 0] < original[:, 1]) != (cx < cy)
        turned &= original[:, 0] != original[:, 1]
        out = np.where(turned[:, None], [fy, fx, cy, cx], [fx, fy, cx, cy])
        share = out[:, 2:] / original
        if (np.abs(share - 0.5) > 0.25).any():
            width, height = original[int(np.abs(share - 0.5).max(1).argmax())]
            raise InputError(
                f"--intrinsics: the principal point {cx:g}, {cy:g} is not near the middle of a photo of {width:.0f} x "
                f"{height:.0f} px; give fx,fy,cx,cy in pixels of the original photos"
            )
        return out * np.tile(sizes / original, 2)
    if focal_mm is not None:
        focal = focal_mm[0] / focal_mm[1] * sizes.max(1)
        return np.column_stack([focal, focal, sizes / 2])
    return None


def camera_model(row: np.ndarray) -> tuple[str, list[float]]:
    """COLMAP's model and parameters for fx, fy, cx, cy: with one focal length a lens that bends may be found, too."""
    fx, fy, cx, cy = (float(v) for v in row)
    if abs(fx / fy - 1) < EQUAL:
        return "SIMPLE_RADIAL", [math.sqrt(fx * fy), cx, cy, 0.0]
    return "PINHOLE", [fx, fy, cx, cy]
