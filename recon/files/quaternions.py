"""Quaternions that are kept as three numbers."""

from __future__ import annotations

import numpy as np


def from_smallest_three(parts: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """(n, 4) unit quaternions from their three smaller parts (n, 3), in order, and which one (n,) is left out."""
    rest = np.sqrt(np.maximum(0, 1 - (parts**2).sum(1)))
    out = np.empty((len(parts), 4))
    for i in range(4):
        here = np.asarray(largest) == i
        out[here] = np.insert(parts[here], i, rest[here], axis=1)
    return out
