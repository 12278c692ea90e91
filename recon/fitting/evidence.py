"""What speaks for an answer and against it: what is seen and not explained, parts where nothing is seen, odd values.

Every number is 0 for an answer without fault, so that more of any of them is worse. Small differences along outlines
and surfaces are in `misfit` alone: `missing` and `idle` count what lies further than NEAR from its like, which no
polish would mend.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import cv2
import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from procmodels.shape import Part, Shape
from procmodels.space import Params, ParamSpace
from recon.fitting import likeness
from recon.fitting.usual import Usual
from recon.geometry.object_windows import Crops
from recon.geometry.raster import iou, silhouettes
from recon.geometry.triangles import Triangles
from recon.scene import Canonical, cam_from_canonical

NEAR = 0.04  # of the object's longest side
ENDS = 0.005  # of a scalar's range: nearer to an end it is at the end
FINEST = 0.005  # of a misfit: a better one says no more
PLAINEST = 2.0  # times as bad as a convex hull: worse says no more
OFTEN = 1.5  # spreads off the usual value: an end that lies nearer, as that of a cushion's thickness, is common
MOST = 9.0  # squared spreads: a value is no odder than that
PLACES, OF_PART, OF_POINTS = 3000, 60, 4000  # on the shape, on each part, of the input's points
WINDOW, VIEWS = 144, 8  # px of a window on the object, views that are looked at


@dataclass(frozen=True)
class Evidence:
    """Of one answer.

    misfit   what is left unexplained: 1 - mean IoU of outlines; of surfaces, root mean square distance both ways, in
             canonical units
    missing  share of what is seen with nothing of the answer near it
    idle     share of the answer with nothing seen near it
    part     the same of its worst part
    parts    the same by name of part
    plain    misfit beside that of a plain body, the convex hull of what is seen or something turned on a lathe: what it
             explains as well speaks for no class; at most PLAINEST
    unusual  mean squared deviation of what its parameters are from what is usual, in spreads
    edge     share of its scalars at an end of their ranges
    unlike   log-odds that the input's outlines show another kind of thing (recon.fitting.likeness)
    """

    misfit: float
    missing: float
    idle: float
    part: float
    plain: float
    unusual: float
    edge: float
    parts: dict[str, float] = field(default_factory=dict)
    unlike: float = 0.0

    def numbers(self) -> dict[str, float]:
        """Without the parts."""
        return {f.name: float(getattr(self, f.name)) for f in fields(self) if f.name != "parts"}


def of_outlines(space: ParamSpace, params: Params, shape: Shape, crops: Crops, canonical: Canonical) -> Evidence:
    """Of a shape that stands at `canonical` before windows of masks."""
    poses = cam_from_canonical(crops.cameras, canonical)
    seen = [(m >= 0.5) & v for m, v in zip(crops.masks, crops.valid, strict=True)]

    def drawn(of: Shape) -> list[np.ndarray]:
        found = silhouettes(of, crops.cameras.K, poses, crops.cameras.sizes)
        return [d & v for d, v in zip(found, crops.valid, strict=True)]

    whole = drawn(shape)
    reach = [max(1.5, NEAR * _side(m)) for m in seen]
    beyond = [_distance(m) > r for m, r in zip(seen, reach, strict=True)]
    bare = [_distance(d) > r for d, r in zip(whole, reach, strict=True)]
    # A part that is there is inside the outline from everywhere: the view that shows most of it to be absent counts.
    parts: dict[str, float] = {}
    for part in shape.parts:
        views = zip(drawn(Shape((part,))), beyond, strict=True)
        off = max((float((d & b).sum() / d.sum()) for d, b in views if d.sum() >= 4), default=0.0)
        parts[part.name] = max(parts.get(part.name, 0.0), off)
    return _evidence(
        misfit=1 - float(np.mean([iou(d, m) for d, m in zip(whole, seen, strict=True)])),
        plain=1
        - max(float(np.mean([iou(body(m) & v, m) for m, v in zip(seen, crops.valid, strict=True)])) for body in _PLAIN),
        missing=_share([m & b for m, b in zip(seen, bare, strict=True)], seen),
        idle=_share([d & b for d, b in zip(whole, beyond, strict=True)], whole),
        parts=parts,
        space=space,
        params=params,
        unlike=likeness.of_masks(space.name, seen),
    )


def of_surfaces(space: ParamSpace, params: Params, shape: Shape, points: np.ndarray, spacing: float = 0.0) -> Evidence:
    """Of a shape beside an input's surface points (n, 3), both in the shape's frame.

    spacing  between neighbours of a sparse cloud, whose gaps mean nothing; 0 for a dense one
    """
    some = points[np.random.default_rng(0).permutation(len(points))[:OF_POINTS]]
    surface, tree = Triangles.of(shape), cKDTree(points)
    there = np.linalg.norm(surface.nearest(some)[0] - some, axis=1)

    def back(corners: Triangles, count: int) -> np.ndarray:
        found = tree.query(corners.at(corners.places(count))[0])[0]
        return np.maximum(found - spacing, 0)

    home, hull = back(surface, PLACES), _convex(some)
    hull_there = np.linalg.norm(hull.nearest(some)[0] - some, axis=1)
    parts: dict[str, float] = {}
    for part in shape.parts:
        off = float((back(_triangles(part), OF_PART) > NEAR).mean())
        parts[part.name] = max(parts.get(part.name, 0.0), off)
    return _evidence(
        misfit=_both(there, home),
        plain=_both(hull_there, back(hull, PLACES)),
        missing=float((there > NEAR).mean()),
        idle=float((home > NEAR).mean()),
        parts=parts,
        space=space,
        params=params,
        unlike=likeness.of_surface(space.name, points),
    )


def _evidence(
    misfit: float,
    plain: float,
    missing: float,
    idle: float,
    parts: dict[str, float],
    space: ParamSpace,
    params: Params,
    unlike: float,
) -> Evidence:
    odd, edge = looks(space, params)
    beside = min((misfit + FINEST) / (plain + FINEST), PLAINEST)
    return Evidence(misfit, missing, idle, max(parts.values(), default=0.0), beside, odd, edge, parts, unlike)


def looks(space: ParamSpace, params: Params) -> tuple[float, float]:
    """Mean squared deviation from the usual, in spreads, and the share of scalars at an end of their ranges, of the
    parameters that do something. A space that says nothing of what is usual finds nothing unusual."""
    active = space.active(params)
    units = np.array([np.clip(s.unit_from_value(float(params[s.name])), 0, 1) for s in space.scalars])
    moving = np.array([s.name in active for s in space.scalars], bool)
    known = Usual(space)
    off = known.by_scalar(units)[moving]
    rare = known.rarities({p.name: params[p.name] for p in space.discrete if p.name in active})
    costs = [*np.square(off[np.isfinite(off)]), *rare]
    ends = (np.minimum(units, 1 - units) < ENDS)[moving] & (np.abs(off) > OFTEN)
    return float(np.minimum(costs, MOST).mean()) if costs else 0.0, float(ends.mean()) if len(ends) else 0.0


def _both(there: np.ndarray, back: np.ndarray) -> float:
    """Root mean square of distances both ways."""
    return float(np.sqrt((np.square(there).mean() + np.square(back).mean()) / 2))


def _hull(mask: np.ndarray) -> np.ndarray:
    """(H, W) bool: the convex hull of what is white."""
    out = np.zeros(mask.shape, np.uint8)
    if mask.any():
        cv2.fillConvexPoly(out, cv2.convexHull(np.argwhere(mask)[:, ::-1].astype(np.int32)), (1,))
    return out > 0


def _lathed(mask: np.ndarray) -> np.ndarray:
    """(H, W) bool: rows as wide as the mask's, without gaps and about one upright axis."""
    rows = np.flatnonzero(mask.any(1))
    if not len(rows):
        return mask
    left, right = mask[rows].argmax(1), mask.shape[1] - mask[rows, ::-1].argmax(1)
    axis = np.median((left + right) / 2)
    out = np.zeros(mask.shape, bool)
    out[rows] = np.abs(np.arange(mask.shape[1]) + 0.5 - axis) <= ((right - left) / 2)[:, None]
    return out


_PLAIN = (_hull, _lathed)


def _convex(points: np.ndarray) -> Triangles:
    """The convex hull of points (n, 3)."""
    try:
        found = ConvexHull(points)
    except QhullError:
        found = ConvexHull(points, qhull_options="QJ")
    return Triangles(points[found.simplices])


def _triangles(part: Part) -> Triangles:
    return Triangles(part.vertices[part.triangles()])


def _side(mask: np.ndarray) -> float:
    """px, the longer side of the box round what is white."""
    rows, columns = np.nonzero(mask)
    return float(max(np.ptp(rows), np.ptp(columns)) + 1) if len(rows) else float(max(mask.shape))


def _distance(mask: np.ndarray) -> np.ndarray:
    """(H, W) px to the nearest white pixel; far everywhere when there is none."""
    if not mask.any():
        return np.full(mask.shape, np.inf, np.float32)
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def _share(some: Sequence[np.ndarray], of: Sequence[np.ndarray]) -> float:
    """Mean share over the views that show anything."""
    shares = [s.sum() / o.sum() for s, o in zip(some, of, strict=True) if o.any()]
    return float(np.mean(shares)) if shares else 0.0
