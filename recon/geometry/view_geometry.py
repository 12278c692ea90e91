"""Masks in boxes and windows, and the small geometry of looking at an object."""

from __future__ import annotations

import cv2
import numpy as np

USUAL_FOCAL = 1.4  # of the image's longer side: about 40 degrees
MARGIN = 1.35  # side of the window on the object, in sizes of its box

Box = tuple[float, float, float, float]  # left, top, width, height


def mask_box(mask: np.ndarray) -> Box | None:
    """Left, top, width, height of the object in a mask (H, W) bool; None when it is empty."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return None
    return float(columns[0]), float(rows[0]), float(np.ptp(columns) + 1), float(np.ptp(rows) + 1)


def cut_to(mask: np.ndarray, box: Box, side: int) -> np.ndarray:
    """(side, side) bool: the part of a mask in a box, which may reach beyond the mask, stretched to a square."""
    x, y, w, h = box
    scale_x, scale_y = side / w, side / h
    # Blurred to the target's pixel size first: a plain warp would skip thin legs.
    image = cv2.blur(mask.astype(np.float32), (max(1, round(1 / scale_x)), max(1, round(1 / scale_y))))
    matrix = np.array([[scale_x, 0, -x * scale_x], [0, scale_y, -y * scale_y]])
    matrix[:, 2] += 0.5 * (matrix[(0, 1), (0, 1)] - 1)
    return cv2.warpAffine(image, matrix, (side, side), flags=cv2.INTER_LINEAR) > 0.4


def rolled(mask: np.ndarray, degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """The mask turned back by a clockwise roll about its middle (uncut), and the (2, 3) matrix rolled_from_image."""
    height, width = mask.shape
    side = int(np.ceil(np.hypot(height, width)))
    matrix = np.array(cv2.getRotationMatrix2D((width / 2 - 0.5, height / 2 - 0.5), degrees, 1.0), float)
    matrix[:, 2] += ((side - width) / 2, (side - height) / 2)
    turned = cv2.warpAffine(mask.astype(np.uint8), matrix, (side, side), flags=cv2.INTER_NEAREST)
    return turned > 0, matrix


def touching(mask: np.ndarray, inside: np.ndarray) -> tuple[bool, bool, bool, bool]:
    """Whether the object goes on, over more than a point, to the left, top, right, bottom of what is `inside`: beyond
    the photo's edge, or behind what hides it."""
    found, beyond = mask_box(mask), np.pad(~inside, 1, constant_values=True)
    if found is None:
        return False, False, False, False
    edges = (beyond[1:-1, :-2], beyond[:-2, 1:-1], beyond[1:-1, 2:], beyond[2:, 1:-1])
    sides = (found[3], found[2], found[3], found[2])
    left, top, right, bottom = (bool((mask & e).sum() > 0.02 * s + 1) for e, s in zip(edges, sides, strict=True))
    return left, top, right, bottom


def window(
    mask: np.ndarray, K: np.ndarray, size: int, known: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The square on the object: shares of its pixels that are object (size, size) float32, which pixels lie in the
    photo and are known (size, size) bool, and K for it. The mask must not be empty; `known` (H, W) bool, or all is."""
    told = np.ones_like(mask) if known is None else known
    box = mask_box(mask | ~told)
    assert box is not None
    x, y, w, h = box
    side = int(np.ceil(MARGIN * max(w, h))) + 2
    left, top = round(x + w / 2 - side / 2), round(y + h / 2 - side / 2)
    pad = side
    both = np.stack([mask & told, told], -1).astype(np.float32)
    both = cv2.copyMakeBorder(both, pad, pad, pad, pad, cv2.BORDER_CONSTANT, value=(0, 0))
    cut = both[top + pad : top + pad + side, left + pad : left + pad + side]
    small = cv2.resize(cut, (size, size), interpolation=cv2.INTER_AREA)
    moved = K.copy()
    moved[:2, 2] -= (left, top)
    moved[:2] *= size / side
    return small[..., 0], small[..., 1] > 0.99, moved


def guessed_K(width: int, height: int) -> np.ndarray:
    """(3, 3) pinhole of an ordinary lens, principal point in the middle."""
    focal = USUAL_FOCAL * max(width, height)
    return np.array([(focal, 0, width / 2), (0, focal, height / 2), (0, 0, 1)], float)


def seen_from(rotation: np.ndarray, ray: np.ndarray) -> tuple[float, float]:
    """Azimuth (0..360) and elevation in degrees of a camera with rotation cam_from_canonical that looks along `ray`."""
    x, y, z = rotation.T @ ray / np.linalg.norm(ray)
    return float(np.degrees(np.arctan2(-x, y)) % 360), float(np.degrees(np.arcsin(np.clip(-z, -1, 1))))


def towards(azimuth: float | np.ndarray, elevation: float | np.ndarray) -> np.ndarray:
    """(..., 3) unit vector from the object to the camera, for angles in degrees."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.stack([np.cos(e) * np.sin(a), -np.cos(e) * np.cos(a), np.sin(e)], -1)


def shortest_turn(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(3, 3) rotation that takes the direction of `source` to that of `target`."""
    a, b = source / np.linalg.norm(source), target / np.linalg.norm(target)
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    return cv2.Rodrigues(axis / sine * np.arctan2(sine, a @ b))[0] if sine > 1e-9 else np.eye(3)
