"""COLMAP's sparse model, binary or text: cameras, images, points3D."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from recon.files.camera_records import CameraRecords
from recon.geometry.lenses import lens, models
from recon.scene import InputError
from recon.system.user_files import read_bytes

MOST_POINTS = 200_000  # more are thinned out evenly: floor and walls do not need them


@dataclass(frozen=True)
class _Camera:
    model: str
    size: tuple[int, int]
    params: np.ndarray


@dataclass(frozen=True)
class _Image:
    number: int
    quaternion: np.ndarray  # w, x, y, z of cam_from_world
    translation: np.ndarray
    camera: int
    name: str


_Points = tuple[np.ndarray, list[np.ndarray]]  # (n, 3) float, and for each point the numbers of the images that saw it


def is_model(folder: Path) -> bool:
    """Whether a folder holds cameras and images of a COLMAP model."""
    return any((folder / f"cameras{e}").is_file() and (folder / f"images{e}").is_file() for e in (".bin", ".txt"))


def files(folder: Path) -> list[Path]:
    """The files that `read` looks at; binary ones win."""
    ending = ".bin" if (folder / "cameras.bin").is_file() and (folder / "images.bin").is_file() else ".txt"
    named = [folder / f"{part}{ending}" for part in ("cameras", "images", "points3D")]
    return [p for p in named if p.is_file()]


def read(folder: Path) -> CameraRecords:
    """The registered images of a model, in natural order of their names; raises InputError when it is damaged."""
    found = files(folder)
    if len(found) < 2:
        raise InputError(f"{folder} holds no COLMAP model: cameras and images (.bin or .txt) are needed")
    binary = found[0].suffix == ".bin"
    try:
        cameras = (_cameras_bin if binary else _cameras_txt)(read_bytes(found[0]))
        images = (_images_bin if binary else _images_txt)(read_bytes(found[1]))
        points: _Points = (np.zeros((0, 3)), [])
        if len(found) > 2:
            points = (_points_bin if binary else _points_txt)(read_bytes(found[2]))
        return _records(cameras, sorted(images, key=lambda i: i.name), points)
    except InputError as error:
        raise InputError(f"the COLMAP model in {folder}: {error}") from error
    except (struct.error, ValueError, IndexError, KeyError, UnicodeDecodeError, OverflowError, MemoryError) as error:
        raise InputError(f"the COLMAP model in {folder} is damaged or cut off ({error})") from error


def _records(cameras: dict[int, _Camera], images: list[_Image], points: _Points) -> CameraRecords:
    lenses = []
    for image in images:
        if image.camera not in cameras:
            raise ValueError(f"image {image.name} names camera {image.camera}, which is not there")
        camera = cameras[image.camera]
        lenses.append(lens(camera.model, camera.params, camera.size))
    poses = np.tile(np.eye(4), (len(images), 1, 1))
    for pose, image in zip(poses, images, strict=True):
        w, x, y, z = image.quaternion
        pose[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
        pose[:3, 3] = image.translation
    if not np.isfinite(poses).all():
        raise ValueError("a position is not a number")
    xyz, seen = points
    keep = np.flatnonzero(np.isfinite(xyz).all(1))
    keep = keep[:: max(1, -(-len(keep) // MOST_POINTS))]
    column = {image.number: c for c, image in enumerate(images)}
    tracks = np.zeros((len(keep), len(images)), bool)
    for row, i in enumerate(keep):
        tracks[row, [column[n] for n in seen[i].tolist() if n in column]] = True
    return CameraRecords(
        tuple(i.name.replace("\\", "/") for i in images),
        np.array([cameras[i.camera].size for i in images], int).reshape(-1, 2),
        np.array([K for K, _ in lenses]).reshape(-1, 3, 3),
        tuple(bends for _, bends in lenses),
        poses,
        xyz[keep],
        tracks,
    )


# ---- binary: little endian, counts are uint64 ----


def _cameras_bin(data: bytes) -> dict[int, _Camera]:
    (count,), at, out, known = struct.unpack_from("<Q", data), 8, {}, models()
    for _ in range(count):
        number, model, width, height = struct.unpack_from("<iiQQ", data, at)
        if model not in known:
            # The next camera begins where this one's parameters end, and how many it has is not known.
            raise InputError(
                f"COLMAP's camera model number {model} is not known here (0 to {max(known)} are); "
                'undistort the model with "colmap image_undistorter", and give that one'
            )
        name, size = known[model]
        params = np.array(struct.unpack_from(f"<{size}d", data, at + 24))
        out[number], at = _Camera(name, (width, height), params), at + 24 + 8 * size
    return out


def _images_bin(data: bytes) -> list[_Image]:
    (count,), at, out = struct.unpack_from("<Q", data), 8, []
    for _ in range(count):
        number, *pose, camera = struct.unpack_from("<I7di", data, at)
        end = data.index(b"\0", at + 64)
        name = data[at + 64 : end].decode()
        (features,) = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + 24 * features
        if at > len(data):
            raise ValueError("images.bin ends early")
        out.append(_Image(number, np.array(pose[:4]), np.array(pose[4:]), camera, name))
    return out


def _points_bin(data: bytes) -> _Points:
    (count,), at = struct.unpack_from("<Q", data), 8
    xyz, seen = [], []
    for _ in range(count):
        xyz.append(struct.unpack_from("<3d", data, at + 8))
        (length,) = struct.unpack_from("<Q", data, at + 43)
        if at + 51 + 8 * length > len(data):
            raise ValueError("points3D.bin ends early")
        seen.append(np.frombuffer(data, "<u4", 2 * length, at + 51)[::2])
        at += 51 + 8 * length
    return np.array(xyz).reshape(-1, 3), seen


# ---- text ----


def _lines(data: bytes) -> list[list[str]]:
    """The words of every line that is neither empty nor a comment."""
    lines = (line.split() for line in data.decode("utf-8-sig").splitlines() if not line.startswith("#"))
    return [words for words in lines if words]


def _cameras_txt(data: bytes) -> dict[int, _Camera]:
    return {int(w[0]): _Camera(w[1], (int(w[2]), int(w[3])), np.array([float(v) for v in w[4:]])) for w in _lines(data)}


def _images_txt(data: bytes) -> list[_Image]:
    """Every image has two lines, the second (its 2D points) may be empty."""
    out, lines = [], iter(data.decode("utf-8-sig").splitlines())
    for line in lines:
        if line.startswith("#") or not line.strip():
            continue
        words = line.strip().split(maxsplit=9)
        pose = np.array([float(v) for v in words[1:8]])
        out.append(_Image(int(words[0]), pose[:4], pose[4:], int(words[8]), words[9]))
        next(lines, None)
    return out


def _points_txt(data: bytes) -> _Points:
    rows = _lines(data)
    xyz = np.array([[float(v) for v in w[1:4]] for w in rows]).reshape(-1, 3)
    return xyz, [np.array(w[8::2], np.int64) for w in rows]
