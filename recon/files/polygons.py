"""Polygons and strips as triangles."""

from __future__ import annotations

import numpy as np


def fans(counts: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(m, 3) int triangles of polygons: `counts` corners each, their vertex numbers one after the other in `corners`.

    Polygons of fewer than three corners are left out.
    """
    counts = np.asarray(counts, np.int64)
    first = np.cumsum(counts) - counts
    pieces = np.maximum(counts - 2, 0)
    start = np.repeat(first, pieces)
    step = np.arange(len(start)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    return np.stack([corners[start], corners[start + step + 1], corners[start + step + 2]], 1).astype(np.int64)


def strips(corners: np.ndarray) -> np.ndarray:
    """(m, 3) int triangles of strips, one after the other with -1 between them. Their winding is not kept."""
    windows = np.stack([corners[:-2], corners[1:-1], corners[2:]], 1) if len(corners) > 2 else np.zeros((0, 3))
    return windows[(windows >= 0).all(1)].astype(np.int64)


def table_triangles(table: np.ndarray) -> np.ndarray:
    """(m, 3) int triangles of a table of polygons (n, k), k >= 3; negative corners end a polygon early."""
    counts = (table >= 0).sum(1)
    return fans(counts, table[table >= 0])
