"""Camera models as COLMAP names them: which there are, what a camera of one is, and where its rays land.

pycolmap knows the formulas. It must be loaded after cv2 and PIL (before them it breaks their PNG writing), so it is
imported only here, on first use.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2  # noqa: F401
import numpy as np
from PIL import Image  # noqa: F401

from recon.scene import InputError, Lens
from recon.system import process

SHORTEST, LONGEST = 0.05, 100.0  # of the picture's diagonal: no lens has a focal length outside
LARGEST = 1_000_000  # px, sides of a picture
FARTHEST = 3.0  # of the picture's sides, from its middle: crops have principal points outside the picture


@cache
def _pycolmap() -> Any:
    with process.signals_kept():  # pycolmap's own handler would end a run with a stack trace
        import pycolmap

    pycolmap.logging.minloglevel = 3  # it would print what it raises
    return pycolmap


@cache
def models() -> dict[int, tuple[str, int]]:
    """COLMAP's numbers of its camera models, and name and count of parameters of each."""
    pycolmap = _pycolmap()
    ids = [i for i in pycolmap.CameraModelId.__members__.values() if i.value >= 0]
    made = {i.value: pycolmap.Camera.create_from_model_name(1, i.name, 1.0, 2, 2) for i in ids}
    return {number: (camera.model.name, len(camera.params)) for number, camera in made.items()}


def lens(model: str, params: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, Lens | None]:
    """K (3, 3) in pixels of the pinhole that the camera is without its lens, and the lens; None where it bends nothing.

    params  (p,) float in COLMAP's order; size (width, height) in pixels
    Raises InputError for models that are unknown or no camera with a focal length, and for absurd values.
    """
    known = dict(models().values())
    if model in ("EQUIRECTANGULAR", "ORTHOPHOTO"):
        raise InputError(
            f"the camera model {model} is no camera with a focal length but a {_PICTURE[model]}; cut ordinary "
            "(pinhole) pictures out of it, or give the photos that it was made of"
        )
    if known.get(model) != len(params):
        if model in known:
            raise InputError(f"camera model {model} has {known[model]} parameters, but {len(params)} are given")
        raise InputError(f"camera model {model} is not known; known: {', '.join(sorted(known))}")
    width, height = size
    if not (0 < width <= LARGEST and 0 < height <= LARGEST):
        raise InputError(f"a camera's size is {width:g} x {height:g} px")
    if not np.isfinite(params).all():
        raise InputError(f"a camera ({model}) has parameters that are no numbers")
    camera = _pycolmap().Camera(model=model, width=width, height=height, params=params)
    K = camera.calibration_matrix()
    _check(K, size)
    bends = any(camera.params[i] for i in camera.extra_params_idxs()) or "FISHEYE" in model
    return K, Lens(model, np.asarray(params, float), np.array(size)) if bends else None


_PICTURE = {"EQUIRECTANGULAR": "panorama all round", "ORTHOPHOTO": "map, seen by parallel rays"}


def _check(K: np.ndarray, size: tuple[int, int]) -> None:
    """Raise InputError when no camera has such a focal length or principal point."""
    width, height = size
    diagonal, focal, middle = np.hypot(width, height), (K[0, 0], K[1, 1]), (K[0, 2], K[1, 2])
    if not all(SHORTEST * diagonal < f < LONGEST * diagonal for f in focal):
        raise InputError(
            f"a camera of {width} x {height} px has the focal length {focal[0]:g}, {focal[1]:g} px: no lens has; it is "
            "wanted in pixels"
        )
    if any(abs(c - side / 2) > FARTHEST * side for c, side in zip(middle, size, strict=True)):
        raise InputError(
            f"a camera of {width} x {height} px has its principal point at {middle[0]:g}, {middle[1]:g}: far outside"
        )


def bent(lens: Lens, rays: np.ndarray) -> np.ndarray:
    """(n, 2) pixels of the upright photo, at the lens's own size, where rays (n, 3) of the upright camera land.

    NaN where the lens sees nothing of that direction.
    """
    x, y, z = rays.T
    for _ in range(lens.turns):  # back from upright to as it was taken
        x, y = y, -x
    width, height = (int(v) for v in lens.size)
    camera = _pycolmap().Camera(model=lens.model, width=width, height=height, params=lens.params)
    u, v = np.asarray(camera.img_from_cam(np.column_stack([x, y, z])), float).T
    for _ in range(lens.turns):  # a turn by 90 degrees clockwise: pixel (u, v) goes to (h - v, u)
        u, v, width, height = height - v, u, height, width
    return np.column_stack([u, v])


def unbent(lens: Lens, pixels: np.ndarray) -> np.ndarray:
    """(n, 3) rays (x, y, 1) of the upright camera landing on pixels (n, 2) of the upright photo, of the lens's size."""
    u, v = pixels.T
    width, height = (int(n) for n in (lens.size[::-1] if lens.turns % 2 else lens.size))
    for _ in range(lens.turns):  # back to as it was taken
        u, v, width, height = v, width - u, height, width
    camera = _pycolmap().Camera(model=lens.model, width=width, height=height, params=lens.params)
    x, y = np.asarray(camera.cam_from_img(np.column_stack([u, v])), float).reshape(-1, 2).T
    for _ in range(lens.turns):
        x, y = -y, x
    return np.column_stack([x, y, np.ones(len(x))])
