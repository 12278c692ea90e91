"""The room as planes: the floor under the object and the walls behind it, from sparse points and cameras.

A plane is (4,) float (n, d) in the world frame with n . X + d = 0, |n| = 1 and n towards the cameras; SfM units.
The room is convex, so along a viewing ray the nearest plane that faces the camera is what stands behind the object.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recon.scene import Cameras, ReconstructionError


@dataclass(frozen=True)
class FloorOptions:
    tolerance: float = 0.006  # a point lies on a plane when nearer than this x the median camera distance
    lean: float = 35.0  # degrees that the floor's normal may differ from the cameras' up
    trials: int = 2000  # RANSAC draws
    least: int = 25  # points that a plane must carry
    walls: int = 6  # most walls that are looked for; 0 = floor only
    wall_share: float = 0.004  # of all points, that a wall must carry at least
    wall_distance: float = 0.45  # of the median camera distance, from the focus to a wall at least
    near_wall: float = 0.08  # instead of wall_distance, for a wall whose points spread wider than any object
    near_width: float = 1.1  # of what a photo's longest side shows at the object, that they spread at least


@dataclass(frozen=True)
class Room:
    """The planes round the object and a frame that stands on the floor.

    floor    (4,) float plane
    walls    (k, 4) float planes, k may be 0
    focus    (3,) float, the point of the floor under the place that all cameras look at, world frame
    distance float, median distance from the cameras to the place they look at, SfM units
    axes     (3, 3) float, rows are the right-handed axes of the floor frame, the third is the floor's normal
    """

    floor: np.ndarray
    walls: np.ndarray
    focus: np.ndarray
    distance: float
    axes: np.ndarray


def up_direction(cameras: Cameras) -> np.ndarray:
    """(3,) unit vector, the world's up as the photographer held the camera.

    Nobody rolls a camera on purpose: up is at right angles to all the cameras' x axes. Where those leave it open
    (all photos from one side) the mean of the cameras' own up decides.
    """
    right, own_up = cameras.cam_from_world[:, 0, :3], -cameras.cam_from_world[:, 1, :3]
    mean_up = own_up.mean(0)
    spread = right.T @ right / len(cameras) - 0.1 * np.outer(mean_up, mean_up)
    up = np.linalg.eigh(spread)[1][:, 0]
    return up if up @ mean_up > 0 else -up


def look_point(cameras: Cameras) -> np.ndarray:
    """(3,) point nearest to all optical axes, world frame; halfway along the axes when they are parallel."""
    forward, centres = cameras.cam_from_world[:, 2, :3], cameras.centres()
    across = np.eye(3) - np.einsum("vi,vj->vij", forward, forward)
    # The small pull to the centres' mean keeps the system solvable for parallel axes.
    A = across.sum(0) + 1e-6 * np.eye(3)
    return np.linalg.solve(A, np.einsum("vij,vj->i", across, centres) + 1e-6 * centres.mean(0))


def _best_plane(
    points: np.ndarray, normals: np.ndarray, anchors: np.ndarray, tolerance: float, below_cost: float
) -> np.ndarray:
    """The candidate plane (normal, through anchor) with the most points on it; points behind it count against it."""
    best, best_score = np.zeros(4), -np.inf
    offsets = -np.einsum("ni,ni->n", normals, anchors)
    for start in range(0, len(normals), 64):
        height = points @ normals[start : start + 64].T + offsets[start : start + 64]
        score = (np.abs(height) < tolerance).sum(0) - below_cost * (height < -2 * tolerance).sum(0)
        k = int(score.argmax())
        if score[k] > best_score:
            best_score = float(score[k])
            best = np.append(normals[start + k], offsets[start + k])
    return best


def _refine(points: np.ndarray, plane: np.ndarray, tolerance: float) -> np.ndarray:
    """Least squares through the plane's points, three times, as the points that lie on it change."""
    for _ in range(3):
        on = points[np.abs(points @ plane[:3] + plane[3]) < tolerance]
        if len(on) < 3:
            return plane
        middle = on.mean(0)
        normal = np.linalg.svd(on - middle, full_matrices=False)[2][2]
        normal = normal if normal @ plane[:3] > 0 else -normal
        plane = np.append(normal, -normal @ middle)
    return plane


def floor_plane(
    points: np.ndarray, cameras: Cameras, rng: np.random.Generator, options: FloorOptions = FloorOptions()
) -> np.ndarray:
    """(4,) floor plane, world frame, n towards the cameras.

    points  (n, 3) float, sparse points, SfM units
    Raises ReconstructionError when no horizontal plane carries enough points.
    """
    up, centres = up_direction(cameras), cameras.centres()
    distance = float(np.median(np.linalg.norm(centres - look_point(cameras), axis=1)))
    tolerance = options.tolerance * distance
    near = points[np.linalg.norm(points - look_point(cameras), axis=1) < 3 * distance]
    if len(near) >= options.least:
        plane = _horizontal(near, up, centres, tolerance, rng, options)
        while plane is not None:  # a table top can carry more points than the floor: go down while there is support
            under = near[near @ plane[:3] + plane[3] < -4 * tolerance]
            lower = _horizontal(under, up, centres, tolerance, rng, options) if len(under) >= options.least else None
            if lower is None or _count(under, lower, tolerance) < 0.1 * _count(near, plane, tolerance):
                return plane
            plane = lower
    raise ReconstructionError(
        f"no floor found: fewer than {options.least} of {len(points)} points lie on one level plane below the cameras. "
        "Give masks (--masks, white = object), or photograph the object on a textured floor (rug, newspapers)."
    )


def _count(points: np.ndarray, plane: np.ndarray, tolerance: float) -> int:
    return int((np.abs(points @ plane[:3] + plane[3]) < tolerance).sum())


def _horizontal(
    points: np.ndarray,
    up: np.ndarray,
    centres: np.ndarray,
    tolerance: float,
    rng: np.random.Generator,
    options: FloorOptions,
) -> np.ndarray | None:
    """The best plane through three points whose normal is near up and that all cameras are above; None if none is."""
    triples = points[rng.integers(len(points), size=(options.trials, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(length, 1e-12)[:, None]
    normals *= np.where(normals @ up < 0, -1.0, 1.0)[:, None]
    above = np.einsum("nvi,ni->nv", centres[None] - triples[:, :1], normals).min(1) > tolerance
    ok = (length > 0) & (normals @ up > np.cos(np.radians(options.lean))) & above
    if not ok.any():
        return None
    plane = _best_plane(points, normals[ok], triples[ok, 0], tolerance, 0.5)
    plane = _refine(points, plane, tolerance)
    return plane if _count(points, plane, tolerance) >= options.least else None


def find_room(
    points: np.ndarray,
    cameras: Cameras,
    rng: np.random.Generator,
    options: FloorOptions = FloorOptions(),
    floor: np.ndarray | None = None,
) -> Room:
    """Floor, walls and the floor frame; raises ReconstructionError when there is no floor.

    floor  (4,) float where it is known
    """
    floor = floor_plane(points, cameras, rng, options) if floor is None else floor
    normal, target = floor[:3], look_point(cameras)
    distance = float(np.median(np.linalg.norm(cameras.centres() - target, axis=1)))
    focus = target - (normal @ target + floor[3]) * normal
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    axes = np.array([first, np.cross(normal, first), normal])
    walls = _walls(points, cameras, floor, focus, distance, rng, options)
    return Room(floor, walls, focus, distance, axes)


def _walls(
    points: np.ndarray,
    cameras: Cameras,
    floor: np.ndarray,
    focus: np.ndarray,
    distance: float,
    rng: np.random.Generator,
    options: FloorOptions,
) -> np.ndarray:
    """(k, 4) upright planes that carry points, with the cameras and the object in front of them; strongest first."""
    tolerance, inside = 2 * options.tolerance * distance, np.vstack([cameras.centres(), focus])
    rest = points[points @ floor[:3] + floor[3] > 3 * tolerance]
    walls: list[np.ndarray] = []
    least = max(options.least, int(options.wall_share * len(points)))
    shown = float(np.median(cameras.sizes.max(1) / cameras.K[:, 0, 0])) * distance
    # What is near may be the object's own back, but no object is wider than the photos that show it whole.
    for gap, width in ((options.wall_distance, 0.0), (options.near_wall, options.near_width * shown)):
        while len(walls) < options.walls and len(rest) >= least:
            wall = _upright(rest, floor[:3], inside, gap * distance, tolerance, rng, options.trials)
            if wall is None or _count(rest, wall, tolerance) < least:
                break
            on = np.abs(rest @ wall[:3] + wall[3])
            across = rest[on < tolerance] @ np.cross(wall[:3], floor[:3])
            if np.ptp(np.quantile(across, (0.05, 0.95))) >= width:
                walls.append(wall)
            rest = rest[on > 2 * tolerance]
    return np.array(walls).reshape(-1, 4)


def _upright(
    points: np.ndarray,
    up: np.ndarray,
    inside: np.ndarray,
    gap: float,
    tolerance: float,
    rng: np.random.Generator,
    trials: int,
) -> np.ndarray | None:
    """The best plane along `up` through two points, with all of `inside` (V + 1, 3) before it, the last by `gap`."""
    pairs = points[rng.integers(len(points), size=(trials, 2))]
    normals = np.cross(pairs[:, 1] - pairs[:, 0], up)
    length = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(length, 1e-12)[:, None]
    normals *= np.where(np.einsum("ni,ni->n", normals, inside[-1] - pairs[:, 0]) < 0, -1.0, 1.0)[:, None]
    before = np.einsum("nvi,ni->nv", inside[None] - pairs[:, :1], normals)
    ok = (length > 0) & (before[:, :-1].min(1) > 0) & (before[:, -1] > gap)
    if not ok.any():
        return None
    return _refine(points, _best_plane(points, normals[ok], pairs[ok, 0], tolerance, 1.0), tolerance)
