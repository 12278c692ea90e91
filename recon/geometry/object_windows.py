"""Square windows on the object, all of one small size: what hull, fit and refine compare with.

A window holds the projection of the canonical cube, so that background beside the object is seen too and can carve.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from recon.scene import Cameras, Scene, cam_from_canonical


@dataclass(frozen=True)
class Crops:
    """V windows of S x S pixels.

    cameras  the views' cameras for these windows (K moved and scaled, poses unchanged)
    masks    (V, S, S) float32, share of a window's pixel that is object
    valid    (V, S, S) bool, False where the window reaches beyond the photo, or the mask says nothing
    """

    cameras: Cameras
    masks: np.ndarray
    valid: np.ndarray


def object_crops(scene: Scene, size: int, max_views: int | None = None) -> Crops:
    """Windows of the used views; at most max_views of them, spread evenly over the list."""
    silhouettes = scene.silhouettes
    views = np.flatnonzero(silhouettes.used)
    if max_views is not None and len(views) > max_views:
        views = views[np.linspace(0, len(views) - 1, max_views).round().astype(int)]
    cameras = scene.cameras.subset(views)
    corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), -1).reshape(-1, 3)
    poses = cam_from_canonical(cameras, scene.canonical)
    K, masks, valid = cameras.K.copy(), [], []
    for i, view in enumerate(views):
        in_camera = corners @ poses[i, :3, :3].T + poses[i, :3, 3]
        # A camera inside the cube (very close photos) sees corners behind it: those do not bound the window.
        in_camera = in_camera[in_camera[:, 2] > 0.05]
        pixels = in_camera @ K[i].T
        left, top, side = _window(pixels[:, :2] / pixels[:, 2:], silhouettes.masks[view])
        masks.append(_cut(silhouettes.masks[view].astype(np.float32), left, top, side, size))
        valid.append(_cut(silhouettes.known(view).astype(np.float32), left, top, side, size) > 0.99)
        K[i, :2, 2] -= (left, top)
        K[i, :2] *= size / side
    sizes = np.full((len(views), 2), size)
    return Crops(Cameras(cameras.names, K, cameras.cam_from_world, sizes), np.stack(masks), np.stack(valid))


def _window(pixels: np.ndarray, mask: np.ndarray) -> tuple[int, int, int]:
    """Left, top and side of the square round projected corners (n, 2) and the mask, in whole pixels."""
    rows, columns = np.nonzero(mask)
    if len(rows):
        pixels = np.concatenate([pixels, [[columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]]])
    low, high = pixels.min(0), pixels.max(0)
    # Cubes that almost touch the camera project to huge windows: three image sizes are surely enough.
    side = int(min(np.ceil((high - low).max()) + 2, 3 * max(mask.shape)))
    left, top = np.floor((low + high) / 2 - side / 2).astype(int)
    return int(left), int(top), side


def _cut(image: np.ndarray, left: int, top: int, side: int, size: int) -> np.ndarray:
    """The window resized to size x size, 0 outside the image; (size, size) float32."""
    window = np.zeros((side, side), np.float32)
    height, width = image.shape
    rows = slice(max(top, 0), min(top + side, height))
    columns = slice(max(left, 0), min(left + side, width))
    if rows.start < rows.stop and columns.start < columns.stop:
        window[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = image[rows, columns]
    # Area averaging both ways: enlarging small windows keeps hard edges, shrinking counts covered shares.
    return cv2.resize(window, (size, size), interpolation=cv2.INTER_AREA)
