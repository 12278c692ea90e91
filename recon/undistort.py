"""Images without radial lens distortion, seen by a pinhole camera with the same K and size."""

from __future__ import annotations

import cv2
import numpy as np

from recon.scene import Poses


def undistorted(image: np.ndarray, K: np.ndarray, distortion: float, *, mask: bool = False) -> np.ndarray:
    """Undistort an image (H, W) or (H, W, 3) uint8, or a mask (H, W) bool or uint8, of the photo as it was taken.

    K (3, 3) in pixels with pixel centres at +0.5; `distortion` is k of COLMAP's SIMPLE_RADIAL, which is OpenCV's k1.
    Pixels that the photo does not cover repeat its border; in masks they are empty.
    """
    if distortion == 0.0:
        return image.copy()
    centred = np.asarray(K, dtype=np.float64).copy()
    centred[:2, 2] -= 0.5  # OpenCV puts pixel centres at whole numbers
    height, width = image.shape[:2]
    lens = np.array([distortion, 0.0, 0.0, 0.0])
    x, y = cv2.initUndistortRectifyMap(centred, lens, np.eye(3), centred, (width, height), cv2.CV_32FC1)
    if mask:
        source = image.astype(np.uint8)
        return cv2.remap(source, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT).astype(image.dtype)
    return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def undistorted_mask(mask: np.ndarray, poses: Poses, name: str) -> np.ndarray:
    """A mask drawn on the working copy of photo `name` (same size), as it lies on the undistorted photo."""
    i = poses.cameras.names.index(name)
    width, height = poses.cameras.sizes[i]
    if mask.shape != (height, width):
        raise ValueError(f"mask of {name} must be ({height}, {width}), got {mask.shape}")
    k = 0.0 if poses.distortion is None else float(poses.distortion[i])
    return undistorted(mask, poses.cameras.K[i], k, mask=True)
