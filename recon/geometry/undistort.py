"""Images without their lens's distortion, seen by a pinhole camera with the same K and size."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from recon.geometry.lenses import bent
from recon.scene import Lens, Poses

_NOWHERE = -1e4  # px, far outside every picture


def undistorted(image: np.ndarray, K: np.ndarray, lens: Lens | None, *, mask: bool = False) -> np.ndarray:
    """Undistort an image (H, W) or (H, W, 3) uint8, or a mask (H, W) bool or uint8, of the photo as it was taken.

    K (3, 3) in pixels of the image with pixel centres at +0.5; the lens may be told for another size of it.
    Pixels that the photo does not cover repeat its border; in masks they are empty.
    """
    if lens is None:
        return image.copy()
    height, width = image.shape[:2]
    # Photos of one camera share a lens, and where its pixels come from takes ten times as long as to fetch them.
    told = lens.model, tuple(lens.params.tolist()), tuple(int(n) for n in lens.size), lens.turns
    x, y = _sources(width, height, tuple(K.ravel().tolist()), *told)
    if mask:
        source = image.astype(np.uint8)
        return cv2.remap(source, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT).astype(image.dtype)
    return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


@lru_cache(maxsize=2)
def _sources(
    width: int,
    height: int,
    intrinsics: tuple[float, ...],
    model: str,
    params: tuple[float, ...],
    size: tuple[int, ...],
    turns: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows (height, width) float32 of the photo as taken, counted from 0 at centres, of every pixel."""
    K, lens = np.reshape(intrinsics, (3, 3)), Lens(model, np.array(params), np.array(size), turns)
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.column_stack([(u.ravel() - K[0, 2]) / K[0, 0], (v.ravel() - K[1, 2]) / K[1, 1], np.ones(u.size)])
    upright = lens.size[::-1] if lens.turns % 2 else lens.size
    pixels = bent(lens, rays) * (np.array([width, height]) / upright) - 0.5  # OpenCV's centres are at whole numbers
    x, y = np.nan_to_num(pixels, nan=_NOWHERE).clip(_NOWHERE, -_NOWHERE).T.reshape(2, height, width).astype(np.float32)
    return x, y


def undistorted_mask(mask: np.ndarray, poses: Poses, name: str) -> np.ndarray:
    """A mask drawn on the working copy of photo `name` (same size), as it lies on the undistorted photo."""
    i = poses.cameras.names.index(name)
    width, height = poses.cameras.sizes[i]
    if mask.shape != (height, width):
        raise ValueError(f"mask of {name} must be ({height}, {width}), got {mask.shape}")
    return undistorted(mask, poses.cameras.K[i], poses.lenses[i] if poses.lenses else None, mask=True)
