"""What the user's INPUT is: told from its content, said in a sentence, and overridden by --input KIND."""

from __future__ import annotations

import json
import logging
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np

from recon.manifest import is_own_picture
from recon.ply import ply_header
from recon.scene import InputError
from recon.shape_files import npy_header, zip_arrays
from recon.whole_files import read_picture

log = logging.getLogger("recon")

COLMAP_FOLDERS = (".", "sparse", "sparse/0", "colmap/sparse/0", "cameras")
PICTURES = (".jpg", ".jpeg", ".png", ".heic", ".heif", ".webp", ".tif", ".tiff", ".bmp")
_HEAD = 4096  # bytes that are looked at first


class Kind(StrEnum):
    """Every kind of input; the values are what --input takes."""

    PHOTOS = "photos"
    VIDEO = "video"
    CAMERAS = "cameras"
    IMAGE = "image"
    MASKS = "masks"
    MESH = "mesh"
    CLOUD = "cloud"
    SPLAT = "splat"
    VOXELS = "voxels"


SHAPES = (Kind.MESH, Kind.CLOUD, Kind.SPLAT, Kind.VOXELS)


@dataclass(frozen=True)
class Recognised:
    """An input's kind, and in words what was seen ("a point cloud of 500 points")."""

    kind: Kind
    what: str


def recognise(path: Path, forced: str | None = None) -> Recognised:
    """What `path` is, which is also said to the user; `forced` (--input) wins over what it looks like.

    Raises InputError for a path that does not exist, for content that nothing here reads, and for an unknown kind.
    """
    if forced is not None and forced not in list(Kind):
        raise InputError(f"--input {forced!r} is not a kind of input; kinds: {', '.join(Kind)}")
    if not path.exists():
        raise InputError(f"{path} does not exist; it is not a folder of photos and not a file")
    try:
        seen = _folder(path) if path.is_dir() else _file(path)
    except InputError:
        if forced is None:
            raise
        return Recognised(Kind(forced), f"taken as {forced}, as --input says")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); check its permissions") from error
    if forced is not None and forced != seen.kind:
        log.info("%s looks like %s; --input says %s, so it is read as that", path, seen.what, forced)
        return Recognised(Kind(forced), f"taken as {forced}, as --input says; it looks like {seen.what}")
    log.info("%s looks like %s%s", path, seen.what, "" if forced else "; --input KIND says otherwise")
    return seen


def _folder(path: Path) -> Recognised:
    """A folder of photos or masks, with or without known cameras."""
    if any((path / name).is_file() for name in ("transforms.json", "transforms_train.json")):
        return Recognised(Kind.CAMERAS, "a photo set with known cameras (transforms.json)")
    for folder in COLMAP_FOLDERS:
        if any((path / folder / f"cameras{e}").is_file() and (path / folder / f"images{e}").is_file() for e in _COLMAP):
            return Recognised(Kind.CAMERAS, "a photo set with known cameras (a COLMAP model)")
    pictures = sorted(
        p for p in path.iterdir() if p.suffix.lower() in PICTURES and p.is_file() and not is_own_picture(p)
    )
    if pictures and all(_two_valued(p) for p in pictures[:12]):
        return Recognised(Kind.MASKS, f"a folder of {len(pictures)} masks")
    return Recognised(Kind.PHOTOS, f"a folder of {len(pictures)} photos")


_COLMAP = (".bin", ".txt")


def _two_valued(path: Path) -> bool:
    """Whether a picture is black and white without colours and greys: a mask."""
    if path.suffix.lower() not in (".png", ".bmp", ".tif", ".tiff"):
        return False
    image = read_picture(path, cv2.IMREAD_UNCHANGED)
    if image is None or (image.ndim == 3 and image.shape[2] != 3):
        return False  # an alpha channel makes a photo with its own mask
    grey = image if image.ndim == 2 else image[..., 0]
    if image.ndim == 3 and not (image == grey[..., None]).all():
        return False
    low, high = int(grey.min()), int(grey.max())
    return low < high and float(np.mean((grey == low) | (grey == high))) > 0.98


def _file(path: Path) -> Recognised:
    """The first of the readers below that knows the content."""
    with path.open("rb") as file:
        head = file.read(_HEAD)
    if not head:
        raise InputError(f"{path} is empty")
    for look in _LOOKS:
        if (seen := look(path, head)) is not None:
            return seen
    raise InputError(
        f"{path} is nothing that can be read here; give a folder of photos, a video, an image, a mesh (OBJ, PLY, GLB, "
        "STL, OFF), a point cloud (PLY, PCD, XYZ, NPY), a splat (.ply) or a voxel grid (.npz, .binvox)"
    )


def _ply(path: Path, head: bytes) -> Recognised | None:
    if head[:3] != b"ply":
        return None
    header = ply_header(path)
    names = {name for name, _ in header.properties}
    if header.faces:
        return Recognised(Kind.MESH, f"a mesh of {header.faces:,} faces")
    if {"scale_0", "rot_0"} <= names:
        return Recognised(Kind.SPLAT, f"a Gaussian splat of {header.vertices:,} Gaussians")
    return Recognised(Kind.CLOUD, f"a point cloud of {header.vertices:,} points")


def _magic_shape(path: Path, head: bytes) -> Recognised | None:
    """Formats that open with their own words."""
    text = head.lstrip()
    if head[:4] == b"glTF":
        return Recognised(Kind.MESH, "a mesh (GLB)")
    if text[:6] == b"# .PCD" or text[:8] == b"VERSION ":
        return Recognised(Kind.CLOUD, "a point cloud (PCD)")
    if text.split(b"\n", 1)[0].split(b" ", 1)[0].strip() in (b"OFF", b"COFF", b"NOFF", b"CNOFF", b"STOFF"):
        return Recognised(Kind.MESH, "a mesh (OFF)")
    if head[:7] == b"#binvox":
        return Recognised(Kind.VOXELS, "a voxel grid (binvox)")
    size = path.stat().st_size
    if size >= 84 and size == 84 + 50 * int.from_bytes(head[80:84], "little"):
        return Recognised(Kind.MESH, f"a mesh of {(size - 84) // 50:,} faces (STL)")
    if text[:5] == b"solid" and (b"facet" in head or b"endsolid" in head):
        return Recognised(Kind.MESH, "a mesh (STL, text)")
    return None


def _arrays(path: Path, head: bytes) -> Recognised | None:
    """Numpy's files: voxels are 3-d, points are rows of at least three numbers."""
    if head[:6] == b"\x93NUMPY":
        shapes = [npy_header(path)]
    elif head[:4] == b"PK\x03\x04" and zipfile.is_zipfile(path):
        shapes = list(zip_arrays(path).values())
    else:
        return None
    for shape in shapes:
        if len(shape) == 3:
            return Recognised(Kind.VOXELS, f"a voxel grid of {' x '.join(map(str, shape))}")
        if len(shape) == 2 and shape[1] >= 3:
            return Recognised(Kind.CLOUD, f"a point cloud of {shape[0]:,} points")
    raise InputError(f"{path} holds no 3-d voxel grid and no (n, 3) points, but arrays of shapes {shapes}")


def _picture(path: Path, head: bytes) -> Recognised | None:
    brand = head[8:12] if head[4:8] == b"ftyp" else b""
    still = brand in (b"heic", b"heix", b"mif1", b"msf1", b"avif", b"heim", b"heis")
    known = head[:3] == b"\xff\xd8\xff" or head[:8] == b"\x89PNG\r\n\x1a\n" or head[:2] == b"BM"
    known = known or head[:4] in (b"II*\0", b"MM\0*") or (head[:4] == b"RIFF" and head[8:12] == b"WEBP")
    if not (known or still):
        return None
    return Recognised(Kind.MASKS, "one mask") if _two_valued(path) else Recognised(Kind.IMAGE, "one image")


def _video(path: Path, head: bytes) -> Recognised | None:
    avi = head[:4] == b"RIFF" and head[8:12] == b"AVI "
    if avi or head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free") or head[:4] in (b"\x1aE\xdf\xa3", b"OggS"):
        return Recognised(Kind.VIDEO, "a video")
    return None


def _json(path: Path, head: bytes) -> Recognised | None:
    """glTF's text form, or a transforms.json of known cameras."""
    if head.lstrip()[:1] != b"{":
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is damaged JSON ({error})") from error
    if "frames" in content:
        return Recognised(Kind.CAMERAS, "a photo set with known cameras (transforms.json)")
    if "asset" in content and ("meshes" in content or "nodes" in content):
        return Recognised(Kind.MESH, "a mesh (glTF)")
    return None


def _text(path: Path, head: bytes) -> Recognised | None:
    """OBJ by its keywords, else rows of at least three numbers."""
    if b"\0" in head:
        return None
    lines = head.decode("utf-8", "replace").splitlines()
    if len(head) == _HEAD:
        lines = lines[:-1]  # the last one may be cut
    first = [line.split()[0] for line in lines if line.strip() and not line.startswith("#")]
    if first and set(first) & {"v", "mtllib", "o", "g", "vn", "vt"} and set(first) <= _OBJ_WORDS:
        faces = any(line[:2] in (b"f ", b"f\t") for line in path.open("rb"))
        return Recognised(Kind.MESH, "a mesh (OBJ)") if faces else Recognised(Kind.CLOUD, "points of an OBJ file")
    rows = [line.replace(",", " ").replace(";", " ").split() for line in lines if line.strip()]
    numbers = [row for row in rows if len(row) >= 3 and all(map(_is_number, row[:3]))]
    # A heading and a count may precede the rows.
    if numbers and len(numbers) >= len(rows) - 2 - sum(line.startswith(("#", "//")) for line in lines):
        return Recognised(Kind.CLOUD, "a point cloud (rows of numbers)")
    return None


_OBJ_WORDS = {
    *("v", "vt", "vn", "vp", "f", "l", "p", "o", "g", "s", "mtllib", "usemtl", "mg", "cstype", "deg", "curv", "surf"),
    *("bevel", "c_interp", "d_interp", "lod", "shadow_obj", "trace_obj", "parm", "trim", "hole", "end"),
}


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


_LOOKS: tuple[Callable[[Path, bytes], Recognised | None], ...] = (
    _ply,
    _magic_shape,
    _arrays,
    _picture,
    _video,
    _json,
    _text,
)
