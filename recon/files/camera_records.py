"""Cameras as files of other programs tell them, before they are matched with photos."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recon.scene import InputError, Lens
from recon.system import limits
from recon.system.user_files import read_bytes

SizeOf = Callable[[str], tuple[int, int] | None]  # (width, height) of the image of that name, None when it is missing


@dataclass(frozen=True)
class CameraRecords:
    """V cameras of one file, for images as they are stored.

    names           V image names as the file has them, relative, with "/"
    sizes           (V, 2) int, (width, height) in pixels that K belongs to
    K               (V, 3, 3) float, pixels, pixel centres at +0.5
    lenses          V lenses that bent the images, None where none did
    cam_from_world  (V, 4, 4) float, rigid, OpenCV axes, the file's own world and units
    points          (n, 3) float, sparse points, same world; n may be 0
    tracks          (n, V) bool, which camera saw which point
    masks           V paths of masks that the file names, or None; empty when it names none
    """

    names: tuple[str, ...]
    sizes: np.ndarray
    K: np.ndarray
    lenses: tuple[Lens | None, ...]
    cam_from_world: np.ndarray
    points: np.ndarray
    tracks: np.ndarray
    masks: tuple[Path | None, ...] = ()

    def subset(self, keep: list[int]) -> CameraRecords:
        """The cameras at these indices, in that order, with all points."""
        return CameraRecords(
            tuple(self.names[i] for i in keep),
            self.sizes[keep],
            self.K[keep],
            tuple(self.lenses[i] for i in keep),
            self.cam_from_world[keep],
            self.points,
            self.tracks[:, keep],
            tuple(self.masks[i] for i in keep) if self.masks else (),
        )


def rigid(matrix: np.ndarray, what: str) -> np.ndarray:
    """(4, 4) the nearest rigid transform to a (3 or 4, 4) one; raises InputError when it is far from one."""
    m = np.vstack([matrix[:3], [0, 0, 0, 1]]).astype(float)
    scale = np.cbrt(np.linalg.det(m[:3, :3])) if np.isfinite(m).all() else 0.0
    if not scale > 1e-9 or not np.allclose(m[:3, :3].T @ m[:3, :3] / scale**2, np.eye(3), atol=2e-2):
        raise InputError(f"{what}: its matrix is not a rotation with a position")
    u, _, vt = np.linalg.svd(m[:3, :3])
    m[:3, :3] = u @ vt
    return m


def read_json(path: Path) -> Any:
    """A JSON file's content, with a byte-order mark or without; raises InputError, ValueError or RecursionError."""
    return json.loads(read_bytes(path, limits.JSON))


Row = tuple[str, tuple[int, int], np.ndarray, Lens | None, np.ndarray]  # name, size, K, lens, cam_from_world


def from_rows(rows: list[Row]) -> CameraRecords:
    """Cameras without points and masks; of a name that comes twice the first row counts."""
    rows = list({row[0].replace("\\", "/"): row for row in reversed(rows)}.values())[::-1]
    return CameraRecords(
        tuple(row[0].replace("\\", "/") for row in rows),
        np.array([row[1] for row in rows], int).reshape(-1, 2),
        np.array([row[2] for row in rows]).reshape(-1, 3, 3),
        tuple(row[3] for row in rows),
        np.array([row[4] for row in rows]).reshape(-1, 4, 4),
        np.zeros((0, 3)),
        np.zeros((0, len(rows)), bool),
    )
