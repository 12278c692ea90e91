"""Pix3D's pix3d.json: the camera of one image, brought to this project's conventions.

Pix3D (Sun et al. 2018) lists one record an image, with "img", "mask", "rot_mat" (3 x 3), "trans_mat" (3),
"focal_length" in mm on a sensor 32 mm wide, and "img_size" (width, height). A model's vertex v, y up and facing -z,
lies at rot_mat v + trans_mat before the camera, whose axes are x left, y up, z forward; the principal point is the
image's middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from datasets.pix3d import PIX3D_FROM_CANONICAL
from recon.scene import InputError
from recon.system import limits
from recon.system.user_files import read_json

SENSOR_MM = 32.0
LENS_MM = (1.0, 10_000.0)  # focal lengths outside are no lens
MOST_DISTANCE = 1e6  # of the object, in the model's units
OPENCV_FROM_PIX3D = np.diag([-1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Pix3dCamera:
    """K (3, 3) in pixels of an image of `size` (width, height), and cam_from_model (4, 4): rigid, OpenCV axes, from the
    model's frame with its axes renamed as in the canonical frame (unscaled, not centred)."""

    K: np.ndarray
    cam_from_model: np.ndarray
    size: tuple[int, int]

    def K_for(self, width: int, height: int) -> np.ndarray:
        """K for a copy of the image of another size."""
        return np.diag([width / self.size[0], height / self.size[1], 1]) @ self.K


def read_camera(file: Path, name: str, size: tuple[int, int]) -> Pix3dCamera:
    """The camera of the image or mask that is called `name`; `size` (width, height) is used when the record has none.

    Raises InputError when the file is not pix3d.json or no record, or a broken one, belongs to the name.
    """
    record = _entry(_records(file), file, name)
    try:
        rotation = np.array(record["rot_mat"], float).reshape(3, 3)
        translation = np.array(record["trans_mat"], float).reshape(3)
        focal = float(record["focal_length"])
        width, height = (int(v) for v in record.get("img_size") or size)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{file}: the record of {name} is not complete ({error}); rot_mat (3 x 3), trans_mat (3) and focal_length "
            "(mm, for a 32 mm wide sensor) are needed"
        ) from error
    # No entry of a rotation is above 1; products of huge ones would overflow.
    turns = bool((np.abs(rotation) < 2).all()) and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-2)
    if not turns or np.linalg.det(rotation) < 0:
        raise InputError(f"{file}: rot_mat of {name} is not a rotation")
    before = bool(np.abs(translation).max() < MOST_DISTANCE) and translation[2] > 0
    sized = min(width, height) > 0 and max(width, height) <= limits.PICTURE_SIDE
    if not (before and sized and LENS_MM[0] < focal < LENS_MM[1]):
        raise InputError(f"{file}: the record of {name} puts the object behind the camera, or its lens is absurd")
    u, _, vt = np.linalg.svd(rotation)
    pixels = focal / SENSOR_MM * width
    K = np.array([(pixels, 0, width / 2), (0, pixels, height / 2), (0, 0, 1)], float)
    pose = np.eye(4)
    pose[:3, :3] = OPENCV_FROM_PIX3D @ (u @ vt) @ PIX3D_FROM_CANONICAL
    pose[:3, 3] = OPENCV_FROM_PIX3D @ translation
    return Pix3dCamera(K, pose, (width, height))


def _records(file: Path) -> list[dict[str, Any]]:
    content = read_json(file, "Pix3D's pix3d.json")
    records = [content] if isinstance(content, dict) else content
    if not isinstance(records, list) or not all(isinstance(r, dict) for r in records):
        raise InputError(f"{file} is not Pix3D's pix3d.json: a list of records is expected")
    return records


def _entry(records: list[dict[str, Any]], file: Path, name: str) -> dict[str, Any]:
    """The one record whose image or mask has this file name; a path such as img/chair/0001.png may say which."""
    wanted = Path(name)
    for keys in (("img", "mask"), ("mask",), ("img",)):
        named = [r for r in records if any(Path(str(r.get(k, ""))).name == wanted.name for k in keys)]
        if not named:  # the image may have another ending than its mask
            named = [r for r in records if any(Path(str(r.get(k, ""))).stem == wanted.stem for k in keys)]
        folder = [r for r in named if any(Path(str(r.get(k, ""))).parent.name == wanted.parent.name for k in keys)]
        best = folder if len(named) > 1 and folder else named
        if len(best) == 1:
            return best[0]
    if not named:
        raise InputError(f"{file} has no record of an image or mask called {wanted.name}")
    folders = ", ".join(sorted({str(r.get("img")) for r in named})[:3])
    raise InputError(f"{file} has {len(named)} records called {wanted.name} ({folders}); keep Pix3D's folder names")
