"""The floor from silhouettes alone, for photos that show no room: where what they carve ends below."""

from __future__ import annotations

import numpy as np

from recon.geometry import voxel_carving
from recon.geometry.align import looked_at
from recon.geometry.room_planes import look_point, up_direction
from recon.scene import Cameras

COARSE, FINE = 64, 128  # cells along the block's longest side
AGREEMENTS = (0.85, 0.7, 0.55)  # of the masks that must contain a cell; less where cameras are a little off
FULL = 0.5  # of the widest layer near the bottom: narrower ones below are the masks' shadows; legs may taper
BOTTOM = 0.15  # of the object's height in which that widest layer is looked for
SUNK = 0.08  # of the object's height: a floor found by points that it reaches through so far is a seat or a table top


def block(cameras: Cameras, longest: int, masks: list[np.ndarray] | None = None) -> voxel_carving.Cells:
    """The region that the cameras look at, upright as they were held, centred on what masks show or where they look."""
    up, target = up_direction(cameras), _target(cameras, masks)
    distance = float(np.median(np.linalg.norm(cameras.centres() - target, axis=1)))
    first = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    first /= np.linalg.norm(first)
    axes = np.array([first, np.cross(up, first), up])
    half = voxel_carving.region(axes, target, distance, cameras, longest)
    return voxel_carving.region(axes, target - up * half.side * half.shape[2] / 2, distance, cameras, longest)


def _target(cameras: Cameras, masks: list[np.ndarray] | None) -> np.ndarray:
    """(3,) where the rays through the masks' middles meet; where the cameras look when there are too few of them."""
    shown = [v for v, mask in enumerate(masks or ()) if mask.any()]
    if masks is None or len(shown) < 2:
        return look_point(cameras)
    return looked_at(cameras.subset(shown), [masks[v] for v in shown])


def floor_under(cameras: Cameras, masks: list[np.ndarray]) -> tuple[np.ndarray, float] | None:
    """The level plane (4,) that the carved shape stands on, n up, and the shape's height in SfM units; None if empty.

    A camera above the floor cannot see under the object, so what its masks carve runs on below, ever narrower; the
    floor is where that begins.
    """
    values = [m.astype(np.float32) for m in masks]
    carved = next((c for share in AGREEMENTS if (c := _carved(cameras, values, share)) is not None), None)
    if carved is None:
        return None
    cells, solid = carved
    layers = np.flatnonzero(solid.any((0, 1)))
    low, high = int(layers[0]), int(layers[-1]) + 1
    area = solid.sum((0, 1))
    near = area[low : low + max(1, round(BOTTOM * (high - low)))]
    foot = low + int(np.argmax(near >= FULL * near.max()))
    up = cells.axes[2]
    level = float(up @ cells.origin) + foot * cells.side
    return np.array([*up, -level]), (high - foot) * cells.side


def _carved(cameras: Cameras, values: list[np.ndarray], share: float) -> tuple[voxel_carving.Cells, np.ndarray] | None:
    """Fine cells and which of them this share of the masks contain; None when there are none."""
    cells = block(cameras, COARSE, values)
    for longest in (FINE, 0):
        solid = voxel_carving.held(cells, cameras, values, share * len(cameras))
        solid = voxel_carving.main_part(solid, np.array(cells.shape) / 2)
        if not solid.any():
            return None
        if longest:
            cells = voxel_carving.around(cells, solid, longest)
    return cells, solid


def floor(found: np.ndarray | None, cameras: Cameras, masks: list[np.ndarray], whole: bool) -> np.ndarray | None:
    """The floor (4,) that points gave, or the one under the silhouettes when points gave none or a wrong one.

    found  (4,) or None, from points; whole: the masks do not depend on it, so they may contradict it
    """
    if found is not None and not whole:
        return found
    stood = floor_under(cameras, masks)
    if stood is None:
        return found
    plane, height = stood
    if found is None:
        return plane
    target = _target(cameras, masks)
    foot = target - (plane[:3] @ target + plane[3]) * plane[:3]
    return plane if found[:3] @ foot + found[3] < -SUNK * height else found
