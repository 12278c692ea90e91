"""Voxel grids made coarser while they are read."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from recon.system import limits


def thinned(filled: np.ndarray) -> np.ndarray:
    """(X, Y, Z) bool at most limits.CELLS long: a cell is filled when any of its voxels is."""
    return gathered(iter(filled), filled.shape)


def gathered(layers: Iterable[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """The same from layers (Y, Z) bool along the first axis of a grid of this shape, one at a time."""
    factor = -(-max(shape) // limits.CELLS)
    small = np.zeros([-(-side // factor) for side in shape], bool)
    rows, columns = (np.arange(0, side, factor) for side in shape[1:])
    for i, layer in enumerate(layers):
        small[i // factor] |= np.logical_or.reduceat(np.logical_or.reduceat(layer, rows, 0), columns, 1)
    return small
