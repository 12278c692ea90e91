"""Outline edges of a built shape in several pinhole views, and how they move when the shape's vertices do.

Every face adds +1 to what it covers in the image, whichever way it is turned. Summed over a shape, an edge between two
faces that look the same way cancels; the edges that are left are the outlines. Views that the shape reaches behind the
camera of are cut at the plane z = NEAR.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import sparse

from procmodels.shape import Polygon, Shape

NEAR = 1e-3  # canonical units: what is nearer to the camera (or behind it) is cut away


class Topology(NamedTuple):
    """What does not depend on the vertices' positions.

    edges      (E, 2) int, first < second
    incidence  (E, F) sparse int: +1 where a face runs along an edge from first to second, -1 against it
    corners    (F, 3) int, three vertices that give a face's plane
    border     (B, 3) int, every face's own edges, face after face: edge, face, +1 or -1 as in `incidence`
    """

    edges: np.ndarray
    incidence: sparse.csr_array
    corners: np.ndarray
    border: np.ndarray


class Cuts(NamedTuple):
    """Points where edges pass the near plane: (c, 2) int numbers of the two vertices among all views' vertices, and
    (c,) the share of the way from the first to the second."""

    ends: np.ndarray
    share: np.ndarray


class Outlines(NamedTuple):
    """m outline edges of all views together.

    view    (m,) int
    weight  (m,) int, how many more faces lie to the right of the edge, walking from start to end, than to the left
    points  (m, 2) int, start and end: vertex + view * n, or from V * n on the number of a cut
    pixels  (m, 2, 2) float, start and end in the image
    in_camera (V, n, 3) float, all vertices
    """

    view: np.ndarray
    weight: np.ndarray
    points: np.ndarray
    pixels: np.ndarray
    in_camera: np.ndarray
    cuts: Cuts


def outlines(shape: Shape, K: np.ndarray, cam_from_shape: np.ndarray, closed: bool = True) -> Outlines:
    """Outlines in V cameras K (V, 3, 3), cam_from_shape (V, 4, 4) rigid.

    closed  the parts are closed and their faces are counter-clockwise from outside: where the near plane cuts a part,
            the section counts as a face. Otherwise what is cut off leaves the part open
    """
    topology = topology_of(tuple((len(p.vertices), p.faces) for p in shape.parts))
    vertices = shape.vertices()
    rotation, translation = cam_from_shape[:, :3, :3], cam_from_shape[:, :3, 3]
    in_camera = vertices @ rotation.transpose(0, 2, 1) + translation[:, None]
    turn = _turns(vertices[topology.corners], -np.einsum("vji,vj->vi", rotation, translation))
    weights = np.ascontiguousarray((topology.incidence @ turn.T).T)  # (V, E), 0 for all but outline edges
    view, edge = np.nonzero(weights)
    weight, points = weights[view, edge], topology.edges[edge] + (view * len(vertices))[:, None]
    cuts = Cuts(np.zeros((0, 2), int), np.zeros(0))
    if (in_camera[..., 2] < NEAR).any():
        view, weight, points, cuts = _clipped(view, weight, points, in_camera, topology, turn, closed)
    places = in_camera.reshape(-1, 3)
    if len(cuts.share):
        a, b = places[cuts.ends].transpose(1, 0, 2)
        places = np.concatenate([places, a + (b - a) * cuts.share[:, None]])
    seen = places[points]  # (m, 2, 3)
    lens = K[view]
    pixels = np.einsum("mij,mej->mei", lens[:, :2, :2], seen[..., :2] / seen[..., 2:]) + lens[:, None, :2, 2]
    return Outlines(view, weight, points, pixels, in_camera, cuts)


def _turns(corners: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(V, F) int: on which side of each face's plane, given by corners (F, 3, 3), each camera centre (V, 3) lies."""
    p, q, r = corners.transpose(1, 0, 2)
    normal = np.cross(q - p, r - p)
    return np.sign(np.einsum("fi,fi->f", normal, p) - centres @ normal.T).astype(np.int16)


@lru_cache(maxsize=256)
def topology_of(parts: tuple[tuple[int, tuple[Polygon, ...]], ...]) -> Topology:
    """Edges of all parts together, from (number of vertices, faces) of each."""
    first = 0
    starts: list[int] = []
    ends: list[int] = []
    owners: list[int] = []
    corners: list[list[int]] = []
    for count, faces in parts:
        for face in faces:
            starts += [first + i for i in face]
            ends += [first + i for i in (*face[1:], face[0])]
            owners += [len(corners)] * len(face)
            # Spread over the polygon: neighbouring corners of a rounded n-gon may be almost collinear.
            n = len(face)
            corners.append([first + face[0], first + face[n // 3], first + face[2 * n // 3]])
        first += count
    a, b, owner = np.array(starts, int), np.array(ends, int), np.array(owners, int)
    edges, which = np.unique(np.stack([np.minimum(a, b), np.maximum(a, b)], 1), axis=0, return_inverse=True)
    along, which = np.where(a < b, 1, -1), which.ravel()
    incidence = sparse.csr_array((along.astype(np.int16), (which, owner)), shape=(len(edges), len(corners)))
    return Topology(edges, incidence, np.array(corners, int).reshape(-1, 3), np.stack([which, owner, along], 1))


def _clipped(
    view: np.ndarray,
    weight: np.ndarray,
    points: np.ndarray,
    in_camera: np.ndarray,
    topology: Topology,
    turn: np.ndarray,
    closed: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Cuts]:
    """Edges cut at NEAR, and where faces are cut the lines along which that happens."""
    depth = in_camera.reshape(-1, 3)[:, 2]
    count, n = in_camera.shape[:2]
    # Every crossing of the near plane, numbered: view by view, edge by edge.
    in_front = (in_camera[..., 2] >= NEAR)[:, topology.edges]  # (V, E, 2)
    crossed = in_front[..., 0] != in_front[..., 1]
    at, edge = np.nonzero(crossed)
    number = np.full(crossed.shape, -1)
    number[at, edge] = count * n + np.arange(len(at))
    ends = topology.edges[edge] + (at * n)[:, None]
    cuts = Cuts(ends, (NEAR - depth[ends[:, 0]]) / (depth[ends[:, 1]] - depth[ends[:, 0]]))

    behind = depth[points] < NEAR
    keep = ~behind.all(1)
    view, weight, points, behind = view[keep], weight[keep], points[keep].copy(), behind[keep]
    part = np.flatnonzero(behind.any(1))
    known = {(int(a), int(b)): count * n + i for i, (a, b) in enumerate(ends)}
    points[part, behind[part].argmax(1)] = [known[int(a), int(b)] for a, b in points[part]]

    closing = _closing(np.flatnonzero(crossed.any(1)), number, in_front, topology, turn, closed)
    return (
        np.concatenate([view, closing[0]]),
        np.concatenate([weight, closing[1]]),
        np.concatenate([points, closing[2]]),
        cuts,
    )


def _closing(
    views: np.ndarray, number: np.ndarray, in_front: np.ndarray, topology: Topology, turn: np.ndarray, closed: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """View, weight and points of the edges that cut faces get along the near plane, from where they leave it to where
    they come back. The section of a closed part faces the camera and runs along the same edges the other way."""
    edge, face, along = topology.border.T
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for v in views:
        starts_in_front = np.where(along > 0, in_front[v, edge, 0], in_front[v, edge, 1])
        is_cut = number[v, edge] >= 0
        leaving, coming = np.flatnonzero(is_cut & starts_in_front), np.flatnonzero(is_cut & ~starts_in_front)
        # A convex face is left once and entered once, so that both lists hold the same faces in the same order.
        points = number[v][np.stack([edge[leaving], edge[coming]], 1)]
        weight = turn[v, face[leaving]] + (1 if closed else 0)
        some = weight != 0
        rows.append((np.full(some.sum(), v), weight[some], points[some]))
    if not rows:
        return np.zeros(0, int), np.zeros(0, np.int16), np.zeros((0, 2), int)
    view, weight, points = (np.concatenate(r) for r in zip(*rows, strict=True))
    return view, weight, points


def end_gradients(
    found: Outlines, K: np.ndarray, across: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How fast each edge's ends move in a direction of the image: entries (end, vertex of all views, (3,) gradient).

    End 2 e + s is the start (s = 0) or end (1) of edge e. Its velocity in pixels times `across` (m, 2) is the sum over
    its entries of gradient . velocity, with the vertex's velocity in the camera's frame. By default `across` is as long
    as the edge and points to the right of the way from start to end.
    """
    n = found.in_camera.shape[0] * found.in_camera.shape[1]
    places = found.in_camera.reshape(-1, 3)
    if across is None:
        along = found.pixels[:, 1] - found.pixels[:, 0]
        across = np.stack([along[:, 1], -along[:, 0]], -1)
    lens = np.einsum("mi,mij->mj", across, K[found.view][:, :2, :2]).repeat(2, 0)  # (2 m, 2)
    point = found.points.ravel()
    end = np.arange(len(point))
    is_cut = point >= n
    whole = np.flatnonzero(~is_cut)
    gradient = _projected(lens[whole], places[point[whole]])
    if not is_cut.any():
        return end, point, gradient
    which, cut = np.flatnonzero(is_cut), point[is_cut] - n
    ends, share = found.cuts.ends[cut], found.cuts.share[cut][:, None]
    a, b = places[ends].transpose(1, 0, 2)
    g = _projected(lens[which], a + (b - a) * share)
    # The cut slides along the edge when its ends change their depths.
    g[:, 2] = -np.einsum("mi,mi->m", g[:, :2], ((b - a) / (b - a)[:, 2:])[:, :2])
    return (
        np.concatenate([whole, which, which]),
        np.concatenate([point[whole], ends[:, 0], ends[:, 1]]),
        np.concatenate([gradient, g * (1 - share), g * share]),
    )


def _projected(lens: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(k, 3) gradient of lens . (x / z, y / z) at places (k, 3), for lens (k, 2)."""
    z = place[:, 2:]
    return np.concatenate([lens / z, -(lens * place[:, :2]).sum(1, keepdims=True) / z**2], 1)
