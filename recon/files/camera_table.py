"""Every format of known cameras: which file or folder is one, told by its content, and how it is read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from recon.files import colmap_model, llff, metashape, polycam, realitycapture, splat_cameras, transforms_json
from recon.files.camera_records import CameraRecords
from recon.files.image_library import Library
from recon.scene import InputError
from recon.system.folders import entries

MODEL_FOLDERS = (".", "sparse/0", "sparse", "colmap/sparse/0", "cameras")
TRANSFORMS = ("transforms.json", "transforms_train.json")
_MOST_FILES = 50  # of a folder that are looked into


@dataclass(frozen=True)
class CameraReader:
    """One format. `matches` and the others take the file, or the folder where the format is one.

    describe  what it is, in words
    axes      the cameras' axes in the format, "OpenCV" or "OpenGL", as people mix them up
    files     the files that decide the cameras, for telling whether they changed
    """

    describe: str
    matches: Callable[[Path], bool]
    read: Callable[[Path, Library], CameraRecords]
    files: Callable[[Path], list[Path]] = lambda path: [path]
    axes: str = "OpenCV"


def _transforms_files(path: Path) -> list[Path]:
    return [p for p in (path, transforms_json.points_file(path)) if p is not None]


# A model first: it brings points.
READERS = (
    CameraReader("a COLMAP model", colmap_model.is_model, lambda p, _: colmap_model.read(p), colmap_model.files),
    CameraReader(
        "transforms.json",
        transforms_json.is_transforms,
        lambda p, library: transforms_json.read(p, library.upright_size),
        _transforms_files,
        "OpenGL",
    ),
    CameraReader("Polycam's raw data", polycam.matches, lambda p, _: polycam.read(p), polycam.files, "OpenGL"),
    CameraReader("cameras.json of a splat", splat_cameras.matches, lambda p, _: splat_cameras.read(p)),
    CameraReader("Metashape's XML", metashape.matches, lambda p, _: metashape.read(p)),
    CameraReader(
        "RealityCapture's CSV",
        realitycapture.matches,
        lambda p, library: realitycapture.read(p, library.upright_size),
    ),
    CameraReader("poses_bounds.npy", llff.matches, lambda p, library: llff.read(p, library.photos())),
)


def find(path: Path) -> tuple[Path, CameraReader] | None:
    """The file or folder of cameras that `path` (a folder or a file) is or holds, and its format; None if none."""
    if path.is_file():
        beside = path.name.startswith(("cameras.", "images.")) and colmap_model.is_model(path.parent)
        candidates = [path.parent] if beside and path.suffix in (".bin", ".txt") else [path]
    else:
        folders = [path / f for f in MODEL_FOLDERS] + [path, path / "keyframes"]
        candidates = [*folders, *(path / name for name in TRANSFORMS), *_loose(path)]
    for candidate in candidates:
        if (candidate.name in TRANSFORMS and candidate.is_file()) or any(_matches(r, candidate) for r in READERS):
            return candidate, reader_of(candidate)
    return None


def reader_of(source: Path) -> CameraReader:
    """The format of a file or folder that `find` gave."""
    # A file of this name is one, however damaged: saying so beats taking the photos without it.
    by_name = READERS[1] if source.name in TRANSFORMS and source.is_file() else None
    found = by_name or next((r for r in READERS if _matches(r, source)), None)
    if found is None:
        raise InputError(f"{source} changed while it was read, or cannot be read; run again")
    return found


def _loose(folder: Path) -> list[Path]:
    """Files of a folder that may hold cameras."""
    if not folder.is_dir():
        return []
    own = ("cameras.json", "poses_bounds.npy")
    named = [p for p in entries(folder) if p.name in own or p.suffix.lower() in (".xml", ".csv")]
    return named[:_MOST_FILES]


def _matches(reader: CameraReader, path: Path) -> bool:
    try:
        return reader.matches(path)
    except OSError:  # one file of a folder that cannot be read is no reason to stop
        return False
