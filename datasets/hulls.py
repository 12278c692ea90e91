"""Visual hulls of generated shapes: what an encoder is given when a real object is known by its silhouettes alone.

Cameras stand on random rings round the object; its silhouettes carve the cube, and of what is left the skin is kept, as
reconstruction does it. Half of the hulls are shaky, as real ones are: outlines a pixel too fat or too thin, cameras a
little off, a piece of an outline missing, a box that is not quite the object's own.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from datasets.camera_rings import look_at
from datasets.voxels import RESOLUTION, voxel_centres
from procmodels.shape import Shape

SHIFT = 4  # bits below the point in coordinates that cv2 draws
# The cube's centres (3, n) in slabs that stay in the cache: all at once take three times as long.
_SLABS = [np.ascontiguousarray(s.reshape(-1, 3).T, np.float32) for s in np.split(voxel_centres(), 16)]


@dataclass(frozen=True)
class HullOptions:
    """Where the cameras stand, and how well outlines, cameras and box are known.

    Angles are degrees, distances from the cube's middle are in canonical units, where the cube's side is 1.
    """

    views: tuple[int, int] = (4, 24)
    elevations: tuple[float, float] = (5.0, 50.0)
    low: float = 0.2  # share of rings that stand about as low as the object
    lowest: tuple[float, float] = (-5.0, 8.0)  # elevations of those
    rings: float = 0.75  # share of sets that go all round; the others cover an arc
    arc: tuple[float, float] = (150.0, 330.0)
    distances: tuple[float, float] = (1.3, 4.0)
    pixels: int = 192  # along each side of a window that the cube fills
    agreement: float = 0.85  # share of the views that must find a voxel inside
    shaky: float = 0.5  # share of hulls that suffer the following
    camera: float = 0.8  # pixels, spread of a window's place
    fringe: int = 2  # pixels by which outlines are too fat or too thin at most
    torn: float = 0.15  # share of the outlines that lack a piece
    yaw: float = 1.5  # spread of the box's turn
    scale: tuple[float, float] = (0.95, 1.015)  # of the object in its box
    middle: float = 0.008  # canonical units, spread of the object's place in it


def hull(shape: Shape, rng: np.random.Generator, options: HullOptions = HullOptions()) -> np.ndarray:
    """(64, 64, 64) bool: the skin of a shape's visual hull, in the shape's own canonical cube."""
    return skin(solid_hull(shape, rng, options))


def solid_hull(shape: Shape, rng: np.random.Generator, options: HullOptions = HullOptions()) -> np.ndarray:
    """(64, 64, 64) bool: every voxel that enough of the random views find inside."""
    shaky = rng.random() < options.shaky
    box = _box_from_canonical(rng, options) if shaky else np.eye(4)
    cameras = windows(rng, options)
    masks = [silhouette(shape, camera @ box, options.pixels) for camera in cameras]
    if shaky:
        grown = int(rng.integers(-options.fringe, options.fringe + 1))
        masks = [_shaken(mask, grown, rng, options) for mask in masks]
    return carve(cameras, masks, options.agreement)


def windows(rng: np.random.Generator, options: HullOptions = HullOptions()) -> np.ndarray:
    """(V, 3, 4) float: pixels of square windows from canonical points, for V cameras round the cube that fills them."""
    views = int(rng.integers(options.views[0], options.views[1] + 1))
    around = 360.0 if rng.random() < options.rings else rng.uniform(*options.arc)
    azimuths = rng.uniform(0, 360) + around * (np.arange(views) + rng.uniform(-0.3, 0.3, views)) / views
    heights = [rng.uniform(*(options.lowest if rng.random() < options.low else options.elevations)) for _ in range(2)]
    elevations = np.where(rng.random(views) < rng.choice([0.5, 1.0]), *heights) + rng.normal(0, 3, views)
    distance = rng.uniform(*options.distances)
    corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), -1).reshape(-1, 3)
    out = []
    for azimuth, elevation in zip(np.radians(azimuths), np.radians(elevations), strict=True):
        level, up = np.cos(elevation), np.sin(elevation)
        eye = distance * np.array([level * np.cos(azimuth), level * np.sin(azimuth), up])
        pose = look_at(eye, np.zeros(3))[:3]
        local = corners @ pose[:, :3].T + pose[:, 3]
        seen = local[:, :2] / local[:, 2:]
        low, high = seen.min(0), seen.max(0)
        focal = options.pixels / (high - low).max()
        place = options.pixels / 2 - focal * (low + high) / 2
        out.append(np.array([(focal, 0, place[0]), (0, focal, place[1]), (0, 0, 1)]) @ pose)
    return np.array(out)


def silhouette(shape: Shape, pixels_from_canonical: np.ndarray, size: int) -> np.ndarray:
    """(size, size) uint8, 1 where the shape is seen through a (3, 4) projection."""
    vertices = shape.vertices() @ pixels_from_canonical[:, :3].T + pixels_from_canonical[:, 3]
    # Coordinates of cv2 count from the middle of the first pixel; far outside the picture nothing is drawn.
    seen = np.clip(vertices[:, :2] / np.maximum(vertices[:, 2:], 1e-3) - 0.5, -size, 2 * size)
    points = np.rint(seen * (1 << SHIFT)).astype(np.int32)
    out, first = np.zeros((size, size), np.uint8), 0
    for part in shape.parts:
        own = points[first : first + len(part.vertices)]
        first += len(part.vertices)
        # What is convex is its outline; of other closed parts every triangle is drawn.
        polygons = [cv2.convexHull(own)] if part.convex else own[part.triangles()]
        for polygon in polygons:
            cv2.fillConvexPoly(out, polygon, (1,), cv2.LINE_8, SHIFT)
    return out


def carve(pixels_from_canonical: np.ndarray, masks: list[np.ndarray], agreement: float = 1.0) -> np.ndarray:
    """(64, 64, 64) bool: voxels whose centres a share `agreement` of the masks (S, S) show as object.

    Every window must hold the whole cube.
    """
    allowed = int((1 - agreement) * len(masks) + 1e-6)
    views = list(zip(pixels_from_canonical.astype(np.float32), masks, strict=True))
    out = [_carved(centres, views, allowed) for centres in _SLABS]
    return np.concatenate(out).reshape((RESOLUTION,) * 3)


def _carved(centres: np.ndarray, views: list[tuple[np.ndarray, np.ndarray]], allowed: int) -> np.ndarray:
    """(n,) bool: which of the centres (3, n) are missed by so many of the (projection, mask) at most."""
    out = np.zeros(centres.shape[1], bool)
    left = np.arange(len(out))  # not carved away yet
    misses = np.zeros(len(out), np.uint8)
    for matrix, mask in views:
        x, y, depth = matrix[:, :3] @ centres + matrix[:, 3:]
        index = (y / depth).astype(np.int32) * len(mask) + (x / depth).astype(np.int32)
        misses += np.take(mask, index, mode="clip") == 0
        stays = np.flatnonzero(misses <= allowed)
        if len(stays) < len(left):
            left, misses, centres = left[stays], misses[stays], centres[:, stays]
        if not len(left):
            break
    out[left] = True
    return out


def skin(solid: np.ndarray) -> np.ndarray:
    """(R, R, R) bool: filled voxels that touch an empty one, or the border, with a face, an edge or a corner."""
    inside = solid
    for axis in range(3):
        padded = np.moveaxis(np.pad(inside, [(1, 1) if a == axis else (0, 0) for a in range(3)]), axis, 0)
        inside = np.moveaxis(padded[:-2] & padded[1:-1] & padded[2:], 0, axis)
    return solid & ~inside


def _box_from_canonical(rng: np.random.Generator, options: HullOptions) -> np.ndarray:
    """(4, 4) similarity: where the object stands in a box that is not quite its own."""
    yaw = np.radians(rng.normal(0, options.yaw))
    out = np.eye(4)
    out[:2, :2] = [(np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw))]
    out[:3, :3] *= rng.uniform(*options.scale)
    out[:3, 3] = rng.normal(0, options.middle, 3)
    return out


def _shaken(mask: np.ndarray, grown: int, rng: np.random.Generator, options: HullOptions) -> np.ndarray:
    """A silhouette as a careless hand would draw it."""
    if grown:
        kernel = np.ones((abs(grown) + 1,) * 2, np.uint8)
        mask = cv2.dilate(mask, kernel) if grown > 0 else cv2.erode(mask, kernel)
    right, down = (int(v) for v in np.rint(rng.normal(0, options.camera, 2)))
    mask = np.roll(mask, (down, right), (0, 1))
    if rng.random() < options.torn:
        side, row, column = (int(v * len(mask)) for v in (rng.uniform(0.05, 0.25), *rng.random(2)))
        mask[row : row + side, column : column + side] = 0
    return mask
