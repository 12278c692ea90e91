"""Masks in windows as a target: shares of pixels, coarse to fine, and the overlap that decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy import sparse

from recon.fitting.state import Jacobian, Posed
from recon.geometry.object_windows import Crops
from recon.geometry.raster import coverage, coverage_slopes, silhouettes


@dataclass(frozen=True)
class Level:
    """How finely outlines are compared.

    shrink  pixels of a window, along each side, whose mean is one pixel here: exact shares make that a blur for free
    blur    times that a box of 3 x 3 of these pixels goes over the differences: a leg that missed its place by more
            than its own width must still feel it
    """

    shrink: int
    blur: int = 0


@dataclass(frozen=True)
class _Scaled:
    """Windows at a level: shares that are object and weights of pixels (V, H, W) float32, and the lens."""

    masks: np.ndarray
    weights: np.ndarray
    lens_from_window: np.ndarray  # (3, 3)
    sizes: np.ndarray


class Masks:
    """V windows of one size, in the order of the placement's views.

    masks   (V, H, W) float32, share of a window's pixel that is object
    valid   (V, H, W) bool, False where nothing is known
    """

    usual = 1e-4
    noise = 0.01

    def __init__(self, masks: np.ndarray, valid: np.ndarray, levels: Sequence[Level]) -> None:
        self.masks, self.valid, self.looks = masks.astype(np.float32), valid, tuple(levels)
        self.levels = len(self.looks)
        self.hard = (masks >= 0.5) & valid
        self.sizes = np.tile(masks.shape[:0:-1], (len(masks), 1))
        # Differing pixels are counted over the images, the loss over the object.
        self.weight = float(max(self.hard.mean(), 1e-6))
        self._scaled = [self._shrunk(look.shrink) for look in self.looks]

    @staticmethod
    def of(crops: Crops, levels: Sequence[Level]) -> Masks:
        """The masks of windows on an object."""
        return Masks(crops.masks, crops.valid, levels)

    def _shrunk(self, shrink: int) -> _Scaled:
        width, height = self.sizes[0]
        small = max(1, round(width / shrink)), max(1, round(height / shrink))
        lens = np.diag([small[0] / width, small[1] / height, 1])
        valid = self.valid.astype(np.float32)
        known = [cv2.resize(v, small, interpolation=cv2.INTER_AREA) for v in valid]
        object_ = [cv2.resize(m, small, interpolation=cv2.INTER_AREA) for m in self.masks * valid]
        shares = [o / np.maximum(k, 1e-6) for o, k in zip(object_, known, strict=True)]
        weights = np.stack(known) / np.float32(np.sqrt(np.size(known)))
        return _Scaled(np.stack(shares), weights, lens, np.tile(small, (len(valid), 1)))

    def residuals(self, posed: Posed, level: int, at: Posed | None = None) -> np.ndarray:
        """(pixels,) differences of covered shares, whose squares sum to their mean over pixels."""
        scaled = self._scaled[level]
        drawn = coverage(posed.shape, scaled.lens_from_window @ posed.K, posed.cam_from_shape, scaled.sizes)
        return self._blurred((np.stack(drawn) - scaled.masks) * scaled.weights, level).ravel()

    def linearised(self, posed: Posed, level: int, velocities: np.ndarray) -> tuple[np.ndarray, Jacobian]:
        """The residuals, and their derivatives by vertices that move by velocities (n, 3, k) or (V, n, 3, k)."""
        scaled = self._scaled[level]
        K = scaled.lens_from_window @ posed.K
        drawn, slopes = coverage_slopes(posed.shape, K, posed.cam_from_shape, scaled.sizes)
        here = self._blurred((np.stack(drawn) - scaled.masks) * scaled.weights, level).ravel()
        block = slopes.along(velocities).astype(np.float32) * scaled.weights.ravel()[slopes.pixels, None]
        if not self.looks[level].blur:
            return here, Jacobian(len(here), slopes.pixels, block)
        height, width = scaled.masks.shape[1:]
        return here, _spread(len(here), slopes.pixels, block, _kernel(height, width, self.looks[level].blur))

    def _blurred(self, images: np.ndarray, level: int) -> np.ndarray:
        """(V, H, W) as a level looks at them."""
        for _ in range(self.looks[level].blur):
            images = np.stack([cv2.blur(image, (3, 3)) for image in images])
        return images

    def loss(self, posed: Posed) -> float:
        """1 - mean IoU over the views."""
        return 1 - float(self.ious(posed).mean())

    def ious(self, posed: Posed) -> np.ndarray:
        """(V,) intersection over union, where something is known; 1 where nothing is to be seen and nothing is."""
        drawn = np.stack(silhouettes(posed.shape, posed.K, posed.cam_from_shape, self.sizes)) & self.valid
        both, either = (drawn & self.hard).sum((1, 2)), (drawn | self.hard).sum((1, 2))
        return np.where(either > 0, both / np.maximum(either, 1), 1.0)


@lru_cache(maxsize=8)
def _kernel(height: int, width: int, times: int) -> sparse.csc_array:
    """(pixels, pixels) of one image: what boxes of 3 x 3 make of a pixel, so many of them one after the other."""
    lines = [np.linalg.matrix_power(cv2.blur(np.eye(n, dtype=np.float32), (1, 3)), times) for n in (height, width)]
    return sparse.csc_array(sparse.kron(*lines, format="csc"))


def _spread(m: int, pixels: np.ndarray, block: np.ndarray, kernel: sparse.csc_array) -> Jacobian:
    """The derivatives (p, k) of some pixels when all m are blurred: those of the pixels around, too, and no others.

    A kernel's column a pixel: outlines touch few pixels, and whole images a number would take five times as long.
    """
    image, inside = np.divmod(pixels, kernel.shape[0])
    around = kernel[:, inside]
    places = around.indices + (image * kernel.shape[0]).repeat(np.diff(around.indptr))
    touched = np.zeros(m, bool)
    touched[places] = True
    row = np.cumsum(touched) - 1
    shape = int(touched.sum()), len(pixels)
    blurred = sparse.csc_array((around.data, row[places], around.indptr), shape=shape) @ block
    return Jacobian(m, np.flatnonzero(touched), blurred)
