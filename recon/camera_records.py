"""Cameras as files of other programs tell them, before they are matched with photos; and their lenses as one k1."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.scene import InputError

_RADIAL = {"SIMPLE_RADIAL": 1, "RADIAL": 2}
_PLAIN = {"SIMPLE_PINHOLE", "PINHOLE"}
# COLMAP's numbers of its camera models, and how many parameters each has.
MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
}
PARAMETERS = dict(MODELS.values())


@dataclass(frozen=True)
class CameraRecords:
    """V cameras of one file, for images as they are stored.

    names           V image names as the file has them, relative, with "/"
    sizes           (V, 2) int, (width, height) in pixels that K belongs to
    K               (V, 3, 3) float, pixels, pixel centres at +0.5
    k1              (V,) float, radial distortion (SIMPLE_RADIAL's k, OpenCV's k1)
    left_over       (V,) float, pixels at most by which k1 alone misses the lens that the file describes
    cam_from_world  (V, 4, 4) float, rigid, OpenCV axes, the file's own world and units
    points          (n, 3) float, sparse points, same world; n may be 0
    tracks          (n, V) bool, which camera saw which point
    masks           V paths of masks that the file names, or None; empty when it names none
    """

    names: tuple[str, ...]
    sizes: np.ndarray
    K: np.ndarray
    k1: np.ndarray
    left_over: np.ndarray
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
            self.k1[keep],
            self.left_over[keep],
            self.cam_from_world[keep],
            self.points,
            self.tracks[:, keep],
            tuple(self.masks[i] for i in keep) if self.masks else (),
        )


@dataclass(frozen=True)
class Lens:
    """K (3, 3) in pixels; k1; and how many pixels k1 alone misses the described lens by, at most in the picture."""

    K: np.ndarray
    k1: float
    left_over: float


def lens(model: str, params: np.ndarray, size: tuple[int, int]) -> Lens:
    """The pinhole and the one radial term of a COLMAP camera model; raises InputError for fisheye lenses.

    params  (p,) float in COLMAP's order; size (width, height) in pixels
    """
    if PARAMETERS.get(model) != len(params):
        known = ", ".join(sorted(PARAMETERS))
        raise InputError(f"camera model {model} with {len(params)} parameters is not known; known: {known}")
    if "FISHEYE" in model or model == "FOV":
        raise InputError(
            f"the camera model {model} is a fisheye lens, which is not supported; undistort the photos first, "
            'e.g. with "colmap image_undistorter", and give the undistorted model'
        )
    single = model.startswith("SIMPLE") or model == "RADIAL"
    fx, fy, cx, cy = (params[0], params[0], params[1], params[2]) if single else params[:4]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], float)
    if not (np.isfinite(params).all() and fx > 0 and fy > 0 and min(size) > 0):
        raise InputError(f"a camera of {size[0]} x {size[1]} px has focal length {fx:g}, {fy:g}: not a camera")
    if model in _PLAIN:
        return Lens(K, 0.0, 0.0)
    rest = np.asarray(params[3 if single else 4 :], float)
    if model in _RADIAL:
        rest = np.concatenate([rest, np.zeros(2 - len(rest)), [0.0, 0.0]])
    return as_one_term(K, rest, size)


def as_one_term(K: np.ndarray, terms: np.ndarray, size: tuple[int, int]) -> Lens:
    """The k1 that comes nearest to OpenCV's k1, k2, p1, p2[, k3, k4, k5, k6] over the picture, by least squares."""
    k1, k2, p1, p2, k3, k4, k5, k6 = np.concatenate([terms, np.zeros(8 - len(terms))])
    if not np.any([k2, p1, p2, k3, k4, k5, k6]):
        return Lens(K, float(k1), 0.0)
    u, v = np.meshgrid(np.linspace(0, size[0], 33), np.linspace(0, size[1], 33))
    x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6))) - 1
    moved = np.stack([x * radial, y * radial])
    moved += np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y])
    basis = np.stack([x * r2, y * r2])
    best = float((basis * moved).sum() / (basis**2).sum())
    left = np.hypot(*(moved - best * basis)) * K[0, 0]
    return Lens(K, best, float(left.max()))


def rigid(matrix: np.ndarray, what: str) -> np.ndarray:
    """(4, 4) the nearest rigid transform to a (3 or 4, 4) one; raises InputError when it is far from one."""
    m = np.vstack([matrix[:3], [0, 0, 0, 1]]).astype(float)
    scale = np.cbrt(np.linalg.det(m[:3, :3])) if np.isfinite(m).all() else 0.0
    if not scale > 1e-9 or not np.allclose(m[:3, :3].T @ m[:3, :3] / scale**2, np.eye(3), atol=2e-2):
        raise InputError(f"{what}: its matrix is not a rotation with a position")
    u, _, vt = np.linalg.svd(m[:3, :3])
    m[:3, :3] = u @ vt
    return m


def read_bytes(path: Path) -> bytes:
    """A file's content; raises InputError when it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error
