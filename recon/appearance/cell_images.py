"""Values at the squares of a texture, spread smoothly over its pixels."""

from __future__ import annotations

import cv2
import numpy as np

from recon.appearance.texels import CELL, Texels


class CellImages:
    """From values at cells to values at texels; empty squares take the nearest one's."""

    def __init__(self, cells: Texels, texels: Texels) -> None:
        self._side = -(-texels.size // CELL)
        row, column = np.divmod(cells.flat, cells.size)
        self.square = row // CELL * self._side + column // CELL  # of every cell
        row, column = np.divmod(texels.flat, texels.size)
        self._flat, self._size = texels.flat, texels.size
        self.cell_of_square = np.full(self._side**2, -1)
        self.cell_of_square[self.square] = np.arange(len(self.square))
        self.cell_of_texel = self.cell_of_square[row // CELL * self._side + column // CELL]
        empty = (self.cell_of_square < 0).astype(np.uint8).reshape(self._side, self._side)
        _, label = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
        owner = np.zeros(label.max() + 1, int)
        owner[label.ravel()[self.square]] = np.arange(len(self.square))
        self._nearest = owner[label.ravel()]

    def spread(self, values: np.ndarray) -> np.ndarray:
        """(n, c) float32 at texels, of values (m, c) at cells."""
        image = values.astype(np.float32)[self._nearest].reshape(self._side, self._side, -1)
        whole = self._side * CELL  # squares at the picture's edge may reach beyond it
        large = cv2.resize(image, (whole, whole), interpolation=cv2.INTER_LINEAR)[: self._size, : self._size]
        return np.ascontiguousarray(large).reshape(self._size**2, -1)[self._flat]

    def means(self, values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(m, c) float weighted means over cells of values (n, c) at texels; 0 where all weights are."""
        count = len(self.square)
        total = np.bincount(self.cell_of_texel, weights, count)
        sums = [np.bincount(self.cell_of_texel, weights * values[:, k], count) for k in range(values.shape[1])]
        return np.stack(sums, 1) / np.maximum(total, 1e-12)[:, None]
