"""Silhouettes of a built shape in given cameras, fast enough for an optimisation loop, exact to the pixel centre.

A pixel belongs to the silhouette when its centre lies inside the projection of any face. Every face adds +1 to the
pixels that it covers, whichever way it is turned; summed over a shape, the edges between two faces that look the same
way cancel, so that only outline edges are left. Each of them is crossed with the rows of the image, +w or -w is noted
at the crossing, and a running sum along the rows gives how often a pixel is covered. All views share one pass of numpy.
OpenCV's polygons are not used: they include every pixel that the border touches, which thickens a leg by one pixel.

For a fast, coarse variant pass smaller cameras: `cameras.scaled(0.25)`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import sparse

from procmodels.shape import Polygon, Shape

NEAR = 1e-3  # canonical units: what is nearer to the camera (or behind it) is cut away


class _Topology(NamedTuple):
    """What does not depend on the vertices' positions.

    edges      (E, 2) int, first < second
    incidence  (E, F) sparse int: +1 where a face runs along an edge from first to second, -1 against it
    corners    (F, 3) int, three vertices that give a face's plane
    """

    edges: np.ndarray
    incidence: sparse.csr_array
    corners: np.ndarray


def silhouettes(shape: Shape, K: np.ndarray, cam_from_canonical: np.ndarray, sizes: np.ndarray) -> list[np.ndarray]:
    """The shape's silhouette in V pinhole cameras.

    K                   (V, 3, 3) float, pixels, pixel centres at +0.5
    cam_from_canonical  (V, 4, 4) float, rigid, camera frame in canonical units (see scene.cam_from_canonical)
    sizes               (V, 2) int, (width, height)
    Returns V arrays (H, W) bool. Parts behind a camera are left out, parts that reach behind it are cut at NEAR.
    """
    if not len(K) == len(cam_from_canonical) == len(sizes):
        raise ValueError(f"{len(K)} K, {len(cam_from_canonical)} poses and {len(sizes)} sizes: one of each a view")
    counts = [len(p.vertices) for p in shape.parts]
    topology = _topology(tuple(zip(counts, (p.faces for p in shape.parts), strict=True)))
    rotation, translation = cam_from_canonical[:, :3, :3], cam_from_canonical[:, :3, 3]
    in_camera = shape.vertices() @ rotation.transpose(0, 2, 1) + translation[:, None]
    behind = (in_camera[..., 2] < NEAR).any(1)
    if not behind.any():
        return _fill(in_camera, topology, K, sizes)
    out: list[np.ndarray | None] = [None] * len(K)
    front = np.flatnonzero(~behind)
    for view, mask in zip(front, _fill(in_camera[front], topology, K[front], sizes[front]), strict=True):
        out[view] = mask
    for view in np.flatnonzero(behind):
        out[view] = _fill_clipped(shape, in_camera[view], K[view], sizes[view])
    return [mask for mask in out if mask is not None]


def coverage(shape: Shape, K: np.ndarray, cam_from_canonical: np.ndarray, sizes: np.ndarray) -> list[np.ndarray]:
    """As `silhouettes`, but V arrays (H, W) float32: the share of each pixel's middle row that the shape covers.

    It changes with the shape without jumps, which derivatives need. Parts must be closed (each then covers a pixel
    twice, with its front and its back). Views that the shape reaches behind the camera of are filled without shares.
    """
    rotation, translation = cam_from_canonical[:, :3, :3], cam_from_canonical[:, :3, 3]
    in_camera = shape.vertices() @ rotation.transpose(0, 2, 1) + translation[:, None]
    if (in_camera[..., 2] < NEAR).any():
        return [m.astype(np.float32) for m in silhouettes(shape, K, cam_from_canonical, sizes)]
    topology = _topology(tuple((len(p.vertices), p.faces) for p in shape.parts))
    return _fill(in_camera, topology, K, sizes, soft=True)


def iou(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of two bool arrays of one shape; 1 when both are empty."""
    if a.shape != b.shape:
        raise ValueError(f"masks of one shape are needed, got {a.shape} and {b.shape}")
    union = np.count_nonzero(a | b)
    return float(np.count_nonzero(a & b) / union) if union else 1.0


@lru_cache(maxsize=64)
def _topology(parts: tuple[tuple[int, tuple[Polygon, ...]], ...]) -> _Topology:
    """Edges of all parts together, from (number of vertices, faces) of each."""
    start = 0
    starts: list[int] = []
    ends: list[int] = []
    owners: list[int] = []
    corners: list[list[int]] = []
    for count, faces in parts:
        for face in faces:
            starts += [start + i for i in face]
            ends += [start + i for i in (*face[1:], face[0])]
            owners += [len(corners)] * len(face)
            # Spread over the polygon: neighbouring corners of a rounded n-gon may be almost collinear.
            n = len(face)
            corners.append([start + face[0], start + face[n // 3], start + face[2 * n // 3]])
        start += count
    a, b = np.array(starts, int), np.array(ends, int)
    edges, which = np.unique(np.stack([np.minimum(a, b), np.maximum(a, b)], 1), axis=0, return_inverse=True)
    entries = (np.where(a < b, 1, -1).astype(np.int16), (which.ravel(), np.array(owners, int)))
    incidence = sparse.csr_array(entries, shape=(len(edges), len(corners)))
    return _Topology(edges, incidence, np.array(corners, int).reshape(-1, 3))


def _fill(
    in_camera: np.ndarray, topology: _Topology, K: np.ndarray, sizes: np.ndarray, soft: bool = False
) -> list[np.ndarray]:
    """Silhouettes (or shares, if soft) from vertices (V, n, 3) in the camera frames, all in front of the cameras."""
    widths, heights = sizes[:, 0].astype(int), sizes[:, 1].astype(int)
    pixels = in_camera @ K.transpose(0, 2, 1)
    pixels = pixels[..., :2] / pixels[..., 2:]

    # Which way a face turns: the side of its plane on which the camera centre, the origin, lies.
    p, q, r = (in_camera[:, topology.corners[:, i]] for i in range(3))
    turn = np.sign(np.einsum("vfi,vfi->vf", p, np.cross(q, r))).astype(np.int16)
    weights = (topology.incidence @ turn.T).T  # (V, E), 0 for all but outline edges
    view, edge = np.nonzero(weights)
    weight = weights[view, edge]
    start, end = pixels[view, topology.edges[edge, 0]], pixels[view, topology.edges[edge, 1]]

    # Upwards or downwards through the rows; an edge owns the row centres in [low, high).
    weight = np.where(start[:, 1] < end[:, 1], weight, -weight)
    rows = np.clip(np.ceil(np.stack([start[:, 1], end[:, 1]]) - 0.5), 0, heights[view]).astype(int)
    first, count = rows.min(0), np.abs(rows[1] - rows[0])
    at = np.repeat(np.arange(len(view)), count)
    row = np.arange(len(at)) - np.repeat(np.cumsum(count) - count, count) + first[at]
    with np.errstate(divide="ignore", invalid="ignore"):  # level edges cross no row and are not looked up
        slope = (end[:, 0] - start[:, 0]) / (end[:, 1] - start[:, 1])
    x = start[at, 0] + slope[at] * (row + 0.5 - start[at, 1])
    width = widths[view[at]]

    # One running sum serves all rows of a view, because every row sums to zero; the spare last column absorbs what
    # lies to the right of the image.
    offsets = np.concatenate([[0], np.cumsum((widths + 1) * heights)])
    line = offsets[view[at]] + row * (width + 1)
    if soft:
        # The crossed pixel gets the share to the right of the crossing, the next one the rest.
        x = np.clip(x, 0, width)
        column = np.minimum(x.astype(int), width - 1)
        cover = np.bincount(line + column, weight[at] * (column + 1 - x), offsets[-1])
        cover += np.bincount(line + column + 1, weight[at] * (x - column), offsets[-1])
    else:
        column = np.clip(np.ceil(x - 0.5), 0, width).astype(int)
        cover = np.zeros(offsets[-1], np.int16)
        np.add.at(cover, line + column, weight[at].astype(np.int16))
    out = []
    for low, high, h, w in zip(offsets[:-1], offsets[1:], heights, widths, strict=True):
        times = np.abs(np.cumsum(cover[low:high], dtype=cover.dtype)).reshape(h, w + 1)[:, :w]
        out.append(np.clip(times / 2, 0, 1).astype(np.float32) if soft else times > 0)
    return out


def _fill_clipped(shape: Shape, in_camera: np.ndarray, K: np.ndarray, size: np.ndarray) -> np.ndarray:
    """One view whose camera the shape surrounds or touches: faces are cut at NEAR first. in_camera (n, 3)."""
    vertices: list[np.ndarray] = []
    faces: list[Polygon] = []
    start = 0
    for part in shape.parts:
        for face in part.faces:
            kept = _cut(in_camera[[start + i for i in face]])
            if len(kept) >= 3:
                faces.append(tuple(range(len(vertices), len(vertices) + len(kept))))
                vertices += kept
        start += len(part.vertices)
    if not faces:
        return np.zeros((int(size[1]), int(size[0])), bool)
    # Not through the cache: this topology is of no use to another view.
    topology = _topology.__wrapped__(((len(vertices), tuple(faces)),))
    return _fill(np.array(vertices)[None], topology, K[None], size[None])[0]


def _cut(polygon: np.ndarray) -> list[np.ndarray]:
    """Corners of the piece of a convex polygon (n, 3) with z >= NEAR."""
    out = []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if a[2] >= NEAR:
            out.append(a)
        if (a[2] >= NEAR) != (b[2] >= NEAR):
            out.append(a + (b - a) * (NEAR - a[2]) / (b[2] - a[2]))
    return out
