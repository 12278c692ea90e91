"""The object before a plain backdrop, as in product photos: what differs from the backdrop and is no shadow on it.

The backdrop is a smooth surface of colour through the photo's border. A shadow darkens it evenly in all colours and has
soft edges; so whatever can be reached from the border without crossing an edge, through colours that are the backdrop's
or a shadow's, is background.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from recon.geometry.mask_checks import EDGED, outline_support


@dataclass(frozen=True)
class BackdropOptions:
    """What counts as a plain backdrop and as its shadow; colours are 0..255, brightness is relative to the backdrop."""

    side: int = 800  # px, longest side of the picture that is worked on
    border: float = 0.02  # of the sides, the strip that shows the backdrop
    even: float = 6.0  # by which the strip may differ from a smooth surface
    most: float = 0.8  # of the strip that must be as even
    tint: float = 0.03  # change of one colour against the others that no shadow makes
    deepest: float = 0.3  # brightness of the deepest shadow
    brightest: float = 1.06
    step: float = 4.0  # change of colour a pixel that is an edge
    same: float = 0.02  # by which each colour of what is seen through the object may differ from the backdrop, at most
    edge: int = 4  # px on which an outline is blurred
    coloured: float = 0.3  # of an object, less of it may be grey for shadows within it to be told
    least: int = 20  # px of a part, or of a hole
    sizes: tuple[float, float] = (0.005, 0.8)  # of the photo that an object covers


def find(image: np.ndarray, options: BackdropOptions = BackdropOptions()) -> np.ndarray | None:
    """(H, W) bool where the object is in a photo (H, W, 3) uint8 BGR; None when the backdrop is not plain, or what was
    found before it has no clear outline."""
    height, width = image.shape[:2]
    scale = min(1.0, options.side / max(height, width))
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
    if min(small.shape[:2]) < 32 or (backdrop := _backdrop(small, options)) is None:
        return None
    mask = _object(small, backdrop, options)
    low, high = options.sizes
    if not low < mask.mean() < high or outline_support(small, mask) < EDGED:
        return None
    return cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR) > 0.5


def _backdrop(image: np.ndarray, options: BackdropOptions) -> np.ndarray | None:
    """(H, W, 3) float, the smooth surface of second order through the border; None when that is not even."""
    height, width = image.shape[:2]
    strip = np.ones((height, width), bool)
    wide = max(2, round(options.border * max(height, width)))
    strip[wide:-wide, wide:-wide] = False
    y, x = np.indices((height, width), float)
    x, y = 2 * x / width - 1, 2 * y / height - 1
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1)
    seen, colours = terms[strip], image[strip].astype(float)
    kept = np.ones(len(seen), bool)
    for _ in range(4):  # each time without what sticks out: the object, where it reaches the border
        surface, *_ = np.linalg.lstsq(seen[kept], colours[kept], rcond=None)
        off = np.abs(seen @ surface - colours).max(1)
        kept = off <= max(options.even / 2, 2.5 * float(np.median(off)))
    even = float((off < options.even).mean())
    return terms @ surface if even > options.most else None


def _object(image: np.ndarray, backdrop: np.ndarray, options: BackdropOptions) -> np.ndarray:
    """(H, W) bool: neither backdrop nor shadow."""
    calm = cv2.GaussianBlur(image, (0, 0), 0.7).astype(np.float32)
    ratio = (calm + 2) / (np.clip(backdrop, 0, 255).astype(np.float32) + 2)
    light = ratio.mean(2)
    tint = np.abs(ratio / np.maximum(light, 1e-3)[..., None] - 1).max(2)
    across, down = (cv2.Sobel(calm, cv2.CV_32F, *d) / 8 for d in ((1, 0), (0, 1)))
    steep = np.sqrt((across**2 + down**2).max(2))
    shadowed = (tint < options.tint) & (light > options.deepest) & (light < options.brightest)
    free = shadowed & (steep < options.step)
    count, labels = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    border = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    sizes = np.maximum(np.bincount(labels.ravel(), minlength=count), 1)
    means = np.stack([np.bincount(labels.ravel(), ratio[..., c].ravel(), count) for c in range(3)], 1) / sizes[:, None]
    light_alone = np.abs(means / np.maximum(means.mean(1, keepdims=True), 1e-3) - 1).max(1) < options.same
    behind = np.array(  # seen through the object: the backdrop, or a shadow that fades into it
        [
            large and grey and abs(np.percentile(light[labels == i], 95) - 1) < 2 * options.same
            for i, (large, grey) in enumerate(zip(sizes >= options.least, light_alone, strict=True))
        ]
    )
    behind[border] = True
    behind[0] = False
    outside = behind[labels]
    mask = _outlined(calm, outside, options.edge)
    if (mask & shadowed).sum() < options.coloured * mask.sum():  # then grey in it is shadow that the object encloses
        grey = cv2.morphologyEx((mask & shadowed).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
        mask &= ~_large(grey, options.least)
    return _large(mask, options.least)


def _outlined(image: np.ndarray, outside: np.ndarray, wide: int) -> np.ndarray:
    """(H, W) bool: all but the outside, and half of the `wide` pixels along it, where an outline is blurred.

    A pixel there belongs to the object when its colour is nearer to the object's than to that of the outside beside it.
    """
    window = (2 * wide + 3, 2 * wide + 3)
    free = outside.astype(np.float32)
    count = cv2.blur(free, window)
    beside = cv2.blur(image * free[..., None], window) / np.maximum(count, 1e-6)[..., None]
    off = np.abs(image - beside).max(2) * (count > 1e-6)
    reach = np.ones((2 * wide + 1, 2 * wide + 1), np.uint8)
    edge = (cv2.dilate(outside.astype(np.uint8), reach) > 0) & ~outside
    return np.where(edge, off > 0.5 * cv2.dilate(off * ~outside, reach), ~outside)


def _large(mask: np.ndarray, least: int) -> np.ndarray:
    """The parts of a mask (H, W) bool that have so many pixels."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    keep = stats[:, cv2.CC_STAT_AREA] >= least
    keep[0] = False
    return keep[labels]
