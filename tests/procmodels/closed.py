"""Whether a mesh is closed, as those see it who get its triangles alone."""

import numpy as np

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def triangles_of_stl(data):
    """(t, 3, 3) float32 corners of a binary STL file's bytes."""
    count = int(np.frombuffer(data, "<u4", 1, 80)[0])
    assert len(data) == 84 + 50 * count
    return np.frombuffer(data, RECORD, count, 84)["corners"]


def open_edges(corners):
    """How many edges of triangles (t, 3, 3) are not shared by exactly two of them, running opposite ways."""
    flat = np.ascontiguousarray(corners.reshape(-1, 3)).view(np.dtype((np.void, 12))).ravel()
    index = np.unique(flat, return_inverse=True)[1].reshape(-1, 3).astype(np.int64)
    edges = np.concatenate([index[:, [0, 1]], index[:, [1, 2]], index[:, [2, 0]]])
    assert (edges[:, 0] != edges[:, 1]).all(), "a triangle without area"
    total = index.max() + 1
    ways = np.sort(edges[:, 0] * total + edges[:, 1])
    back = np.sort(edges[:, 1] * total + edges[:, 0])
    twice = len(ways) - len(np.unique(ways))
    return twice + int((~np.isin(ways, back)).sum())
