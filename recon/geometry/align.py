"""From the world frame of structure from motion to the canonical frame: up, place, size and yaw.

Up and the ground come from the floor plane, place and size from a coarse carving of the silhouettes, yaw from the
smallest rectangle round its footprint. A rectangle has four sides that may be the front: `front_hypotheses` gives all
of them, and the fit decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from recon.scene import Cameras, Canonical, Poses, ReconstructionError, Silhouettes


@dataclass(frozen=True)
class AlignOptions:
    """How the object's box is found."""

    coarse: int = 40  # cells along each side of the first carving
    fine: int = 96  # cells along each side of the second
    agreement: float = 0.85  # share of the views that must find a cell inside their mask
    trim: float = 0.002  # share of footprint cells ignored at each end: stray cells must not set the size


def run(poses: Poses, silhouettes: Silhouettes, options: AlignOptions = AlignOptions()) -> Canonical:
    """Where the object stands, for the first of its four front hypotheses.

    Raises ReconstructionError without a floor plane, or when the silhouettes have no common inside.
    """
    if silhouettes.floor is None:
        raise ReconstructionError(
            "up is unknown: no floor was found, and the silhouettes have no common inside that could stand on one (are "
            "the cameras right, and do all masks show one object?); photograph more of the floor around it, or give "
            "better masks with --masks"
        )
    used = np.flatnonzero(silhouettes.used)
    cameras = poses.cameras.subset(used)
    masks = [silhouettes.possible(i) for i in used]
    world_from_floor = floor_frame(silhouettes.floor, looked_at(cameras, masks))
    low, high = _reach(cameras, masks, world_from_floor)
    for cells in (options.coarse, options.fine):
        points, step = _carved(cameras, masks, world_from_floor, low, high, cells, options.agreement)
        low, high = points.min(0) - 2 * step, points.max(0) + 2 * step
        low[2] = max(low[2], 0.0)
    return Canonical(world_from_floor @ _box_from_canonical(points, options.trim))


def front_hypotheses(canonical: Canonical) -> list[Canonical]:
    """The same box with its front on each of its four sides: hypothesis k is turned by k quarter turns about Z."""
    return [Canonical(canonical.world_from_canonical @ quarter_turn(k)) for k in range(4)]


def quarter_turn(k: int) -> np.ndarray:
    """(4, 4) rotation about Z by k * 90 degrees, from X towards Y."""
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[k % 4]
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], float)


def looked_at(cameras: Cameras, masks: list[np.ndarray]) -> np.ndarray:
    """(3,) world point nearest to all the rays through the masks' centroids."""
    centres, directions = cameras.centres(), []
    for K, pose, mask in zip(cameras.K, cameras.cam_from_world, masks, strict=True):
        rows, columns = np.nonzero(mask)
        if not len(rows):
            raise ReconstructionError("a silhouette is empty; drop that view or give its mask with --masks")
        ray = pose[:3, :3].T @ np.linalg.solve(K, [columns.mean() + 0.5, rows.mean() + 0.5, 1.0])
        directions.append(ray / np.linalg.norm(ray))
    projectors = np.eye(3) - np.einsum("vi,vj->vij", directions, directions)
    # The small pull to the centres' mean keeps the system solvable for parallel rays.
    pull = 1e-9 * np.eye(3)
    both = np.einsum("vij,vj->i", projectors, centres) + pull @ centres.mean(0)
    return np.linalg.solve(projectors.sum(0) + pull, both)


def floor_frame(floor: np.ndarray, above: np.ndarray) -> np.ndarray:
    """(4, 4) rigid world_from_floor: Z is the floor's normal, z = 0 the floor, the origin below the point `above`."""
    normal, offset = floor[:3], floor[3]
    # Any horizontal axis will do for X: the one least along the normal is the best conditioned.
    seed = np.eye(3)[np.argmin(np.abs(normal))]
    x = np.cross(seed, normal)
    x /= np.linalg.norm(x)
    out = np.eye(4)
    out[:3, :3] = np.stack([x, np.cross(normal, x), normal], 1)
    out[:3, 3] = above - (normal @ above + offset) * normal
    return out


def _reach(cameras: Cameras, masks: list[np.ndarray], world_from_floor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A box in the floor frame that surely holds the object: the largest mask seen at the object's distance."""
    middle = looked_at(cameras, masks)
    radii = []
    for K, pose, mask in zip(cameras.K, cameras.cam_from_world, masks, strict=True):
        rows, columns = np.nonzero(mask)
        depth = (pose @ [*middle, 1.0])[2]
        radii.append(np.hypot(np.ptp(rows) + 1, np.ptp(columns) + 1) * depth / K[0, 0])
    radius = float(np.median(radii))
    height = (np.linalg.inv(world_from_floor) @ [*middle, 1.0])[2]
    return np.array([-radius, -radius, 0.0]), np.array([radius, radius, max(height, 0) + radius])


def _carved(
    cameras: Cameras,
    masks: list[np.ndarray],
    world_from_floor: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    cells: int,
    agreement: float,
) -> tuple[np.ndarray, float]:
    """Centres (n, 3), in the floor frame, of cells that enough views find inside; and the side of a cell.

    Masks are widened by half a cell: posts thinner than a cell would slip between the cells' centres otherwise, and
    what they carry would be lost with them.
    """
    step = float((high - low).max() / cells)
    axes = [np.arange(a + step / 2, b, step) for a, b in zip(low, high, strict=True)]
    shape = tuple(len(a) for a in axes)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    inside, seen = np.zeros(len(points), np.int32), np.zeros(len(points), np.int32)
    middle = world_from_floor @ [*(low + high) / 2, 1.0]
    for K, pose, mask in zip(cameras.K, cameras.cam_from_world, masks, strict=True):
        wide = _widened(mask, 0.5 * step * K[0, 0] / max((pose @ middle)[2], step))
        matrix = (K @ (pose @ world_from_floor)[:3]).astype(np.float32)
        u, v, depth = matrix[:, :3] @ points.T.astype(np.float32) + matrix[:, 3:]
        valid = depth > 0
        depth = np.where(valid, depth, 1)
        column, row = np.floor(u / depth).astype(int), np.floor(v / depth).astype(int)
        valid &= (column >= 0) & (column < mask.shape[1]) & (row >= 0) & (row < mask.shape[0])
        seen += valid
        inside += valid & wide[np.where(valid, row, 0), np.where(valid, column, 0)]
    kept = (inside >= agreement * seen) & (seen >= max(2, len(cameras) // 2))
    labels, count = ndimage.label(kept.reshape(shape), np.ones((3, 3, 3)))
    if not count:
        raise ReconstructionError(
            "the silhouettes have no common inside, so the object could not be located; "
            "check the masks in the report, or give your own with --masks"
        )
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    return points[labels.ravel() == largest], step


def _widened(mask: np.ndarray, radius: float) -> np.ndarray:
    """The mask grown by `radius` pixels."""
    side = 2 * int(np.ceil(radius)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return cv2.dilate(mask.astype(np.uint8), kernel).astype(bool)


def _box_from_canonical(points: np.ndarray, trim: float) -> np.ndarray:
    """(4, 4) floor_from_canonical: the footprint's smallest rectangle, from the floor to the top."""
    ground = points[:, :2]

    def extent(degrees: float) -> tuple[np.ndarray, np.ndarray]:
        turned = ground @ _axes(degrees).T
        # No half cell is added: the masks were widened by as much.
        return np.quantile(turned, trim, axis=0), np.quantile(turned, 1 - trim, axis=0)

    def area(degrees: float) -> float:
        low, high = extent(degrees)
        return float(np.prod(high - low))

    best = min(np.arange(0, 90, 2.0), key=area)
    best = min(np.arange(best - 2, best + 2, 0.25), key=area)
    low, high = extent(best)
    top = np.quantile(points[:, 2], 1 - trim / 4)
    scale = max(*(high - low), top)
    out = np.eye(4)
    out[:2, :2] = _axes(best).T
    out[:3, :3] *= scale
    out[:2, 3] = _axes(best).T @ ((low + high) / 2)
    out[2, 3] = top / 2
    return out


def _axes(degrees: float) -> np.ndarray:
    """(2, 2) rows are the axes of a frame turned by an angle."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, s], [-s, c]])
