"""What each photo shows of a shape: which part is where, how near, and how far from whatever is something else.

Photos are read one at a time, cut to the object, and kept in 8 bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from procmodels.look import linear
from recon.appearance.atlas import Atlas
from recon.scene import InputError, Scene, cam_from_canonical

LINEAR = linear(np.arange(256) / 255).astype(np.float32)  # of 8 bits of sRGB


@dataclass(frozen=True)
class ViewOptions:
    """How photos are looked at."""

    most: int = 80  # photos; of more, evenly spread ones
    jump: float = 0.02  # canonical units: where depth changes by more, one thing hides another
    feather: float = 0.008  # of the photo's longest side: nearer to an edge, a pixel is trusted less
    unsure: float = 1e-3  # trust in a pixel right at an edge


@dataclass(frozen=True)
class View:
    """The part of a photo that shows the object.

    photo               (h, w, 3) uint8 sRGB
    part                (h, w) int16: the part that is seen, -1 where none is or the mask says that it is not the object
    depth               (h, w) float32, canonical units along the viewing direction
    trust               (h, w) float32, 0..1: small near edges, where a pose that is a little off shows another thing
    K                   (3, 3) float, of the cut-out
    cam_from_canonical  (4, 4) float, rigid
    """

    photo: np.ndarray
    part: np.ndarray
    depth: np.ndarray
    trust: np.ndarray
    K: np.ndarray
    cam_from_canonical: np.ndarray

    @property
    def eye(self) -> np.ndarray:
        """(3,) the camera's centre in the canonical frame."""
        return -self.cam_from_canonical[:3, :3].T @ self.cam_from_canonical[:3, 3]


class Rays:
    """The triangles of an atlas in open3d's ray caster, on one core: the same answer on every machine."""

    def __init__(self, atlas: Atlas) -> None:
        import open3d as o3d  # slow to import, and only needed here

        tensor: Any = o3d.core.Tensor  # its stubs do not know that it takes arrays
        self._tensor = tensor
        self._scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        vertices = np.ascontiguousarray(atlas.corners.reshape(-1, 3), np.float32)
        self._scene.add_triangles(tensor(vertices), tensor(np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)))

    def cast(self, eye: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (n,) in lengths of the directions (n, 3), inf where nothing is hit, and triangle (n,) int."""
        hit = self._scene.cast_rays(self._rays(eye, directions), nthreads=1)
        return hit["t_hit"].numpy(), np.where(np.isfinite(hit["t_hit"].numpy()), hit["primitive_ids"].numpy(), 0)

    def free(self, origins: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """(n,) bool, whether rays from (n, 3) origins leave without a hit."""
        return ~self._scene.test_occlusions(self._rays(origins, direction), nthreads=1).numpy()

    def _rays(self, origins: np.ndarray, directions: np.ndarray) -> Any:
        rays = np.empty((max(origins.size, directions.size) // 3, 6), np.float32)
        rays[:, :3], rays[:, 3:] = origins, directions
        return self._tensor(rays)


def views(scene: Scene, atlas: Atlas, rays: Rays, options: ViewOptions = ViewOptions()) -> Iterator[View]:
    """The photos whose masks count, those that show anything of the shape. Raises InputError for one that is gone."""
    poses = cam_from_canonical(scene.cameras, scene.canonical)
    used = np.flatnonzero(scene.silhouettes.used)
    if len(used) > options.most:
        used = used[np.linspace(0, len(used) - 1, options.most).astype(int)]
    for i in used:
        photo = cv2.imread(str(scene.poses.paths[i]), cv2.IMREAD_COLOR)
        if photo is None:
            raise InputError(f"{scene.poses.paths[i]} is missing or damaged; run again with --force")
        mask = scene.silhouettes.masks[i]
        if not mask.any():
            continue
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        K = scene.cameras.K[i].copy()
        K[:2, 2] -= columns[0], rows[0]
        photo = np.ascontiguousarray(photo[window][..., ::-1])
        longest = int(scene.cameras.sizes[i].max())
        yield _seen(photo, mask[window], K, poses[i], longest, atlas, rays, options)


def _seen(
    photo: np.ndarray,
    mask: np.ndarray,
    K: np.ndarray,
    cam_from_canonical: np.ndarray,
    longest: int,
    atlas: Atlas,
    rays: Rays,
    options: ViewOptions,
) -> View:
    row, column = np.nonzero(mask)
    pixels = np.stack([column + 0.5, row + 0.5, np.ones(len(row))], 1)
    directions = pixels @ np.linalg.inv(K).T @ cam_from_canonical[:3, :3]  # forward by one: distances are depths
    eye = -cam_from_canonical[:3, :3].T @ cam_from_canonical[:3, 3]
    distance, triangle = rays.cast(eye, directions)
    part, depth = np.full(mask.shape, -1, np.int16), np.full(mask.shape, np.inf, np.float32)
    part[row, column] = np.where(np.isfinite(distance), atlas.part[triangle], -1)
    depth[row, column] = distance
    return View(photo, part, depth, _trust(part, depth, longest, options), K, cam_from_canonical)


def _trust(part: np.ndarray, depth: np.ndarray, longest: int, options: ViewOptions) -> np.ndarray:
    seen = part >= 0
    inside = np.pad(seen, 1)
    inner = np.ones_like(inside)
    part, depth = np.pad(part, 1, constant_values=-1), np.pad(np.where(seen, depth, 0), 1)
    for axis in (0, 1):
        for step in (-1, 1):
            same = np.roll(part, step, axis) == part
            inner &= same & (np.abs(np.roll(depth, step, axis) - depth) < options.jump)
    away = cv2.distanceTransform((inside & inner).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    near = np.clip(away / max(2.0, options.feather * longest), 0, 1) ** 2
    return np.where(seen, np.maximum(near, options.unsure), 0).astype(np.float32)
