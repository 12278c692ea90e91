"""Large pictures that never repeat, patched together from the photographs that come inside scikit-image's wheel.

Structure from motion needs a floor full of distinct points; a tiled or procedural pattern repeats and misleads it.
"""

from __future__ import annotations

import cv2
import numpy as np

# In the wheel, no download; all public domain or CC0.
SOURCES = ("astronaut", "brick", "camera", "chelsea", "coffee", "grass", "gravel", "rocket")


def source_photos() -> list[np.ndarray]:
    """The photographs as (h, w, 3) uint8 RGB."""
    import skimage.data

    photos = [np.asarray(getattr(skimage.data, name)()) for name in SOURCES]
    return [p if p.ndim == 3 else np.repeat(p[..., None], 3, axis=2) for p in photos]


def mosaic(
    width: int, height: int, patch: int, rng: np.random.Generator, mute: float = 0.0, tone: float = 0.75
) -> np.ndarray:
    """A picture (height, width, 3) uint8 RGB of random crops, about `patch` pixels a side, turned, scaled and tinted.

    mute   0..1, how far the picture is pulled to a plain wall colour (less contrast)
    tone   overall brightness factor
    """
    photos = source_photos()
    out = np.zeros((height, width, 3), np.float32)
    for x, y, w, h in _split(0, 0, width, height, patch, rng):
        crop = _crop(photos[rng.integers(len(photos))], w, h, rng).astype(np.float32)
        gain = tone * rng.uniform(0.75, 1.25) * rng.uniform(0.85, 1.15, 3)
        out[y : y + h, x : x + w] = crop * gain + rng.uniform(0, 25)
    plain = np.array([176.0, 168.0, 156.0], np.float32)
    return np.clip((1 - mute) * out + mute * plain, 0, 255).astype(np.uint8)


def _split(x: int, y: int, w: int, h: int, patch: int, rng: np.random.Generator) -> list[tuple[int, int, int, int]]:
    """Cut a rectangle again and again at random places until every part is about `patch` pixels a side."""
    limit = patch * rng.uniform(0.8, 1.6)
    if max(w, h) <= limit or min(w, h) < 8:
        return [(x, y, w, h)]
    part = rng.uniform(0.35, 0.65)
    if w >= h:
        a = int(w * part)
        return _split(x, y, a, h, patch, rng) + _split(x + a, y, w - a, h, patch, rng)
    a = int(h * part)
    return _split(x, y, w, a, patch, rng) + _split(x, y + a, w, h - a, patch, rng)


def _crop(photo: np.ndarray, w: int, h: int, rng: np.random.Generator) -> np.ndarray:
    """A (h, w, 3) piece of a photo under a random turn, zoom, flip and shift; mirrored beyond its edge."""
    scale = rng.uniform(0.8, 1.7)  # mosaic pixels per photo pixel
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) / scale
    if rng.random() < 0.5:
        turn[:, 0] *= -1
    middle = rng.uniform(0.3, 0.7, 2) * (photo.shape[1], photo.shape[0])
    photo_from_patch = np.column_stack([turn, middle - turn @ (w / 2, h / 2)])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(photo, photo_from_patch, (w, h), flags=flags, borderMode=cv2.BORDER_REFLECT_101)
