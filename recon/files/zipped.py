"""A zip file of photos (and of the cameras beside them): unpacked safely into a folder of the run's own."""

from __future__ import annotations

import logging
import shutil
import stat
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from recon.files.photo import ENDINGS
from recon.files.raw_photo import ENDINGS as RAW
from recon.scene import InputError
from recon.system import limits
from recon.system.folders import entries, is_left_by_systems

log = logging.getLogger("recon.files.frames")
_CAMERAS = {".json", ".bin", ".txt", ".xml", ".csv", ".npy"}
_WANTED = ENDINGS | RAW | _CAMERAS
_CHUNK = 1 << 20


def photos_in(path: Path) -> int:
    """How many photos a zip file holds; 0 for other files. Reads the directory only."""
    try:
        with zipfile.ZipFile(path) as archive:
            return sum(PurePosixPath(i.filename).suffix.lower() in ENDINGS | RAW for i in _wanted(archive))
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError):
        return 0


def _wanted(archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    """Photos and cameras, without what systems leave; names may still lead anywhere."""
    out = []
    for info in archive.infolist():
        parts = PurePosixPath(info.filename.replace("\\", "/")).parts
        odd = any(is_left_by_systems(p) and p not in ("..", ".") for p in parts)
        if not info.is_dir() and not odd and PurePosixPath(info.filename).suffix.lower() in _WANTED:
            out.append(info)
    return out


def unpack(path: Path, folder: Path) -> Path:
    """Unpack photos and cameras into `folder` (made anew) and return the folder in it that holds them.

    Raises InputError, before anything is written, for names that lead out of the folder, links, too many or too large
    files and passwords; and when the archive is damaged.
    """
    shutil.rmtree(folder, ignore_errors=True)
    try:
        with zipfile.ZipFile(path) as archive:
            wanted = _wanted(archive)
            _check(path, wanted)
            folder.mkdir(parents=True)
            for info in wanted:
                _write(archive, info, folder / _place(info))
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, NotImplementedError) as error:
        raise InputError(f"{path} is damaged, or cannot be unpacked ({error}); unpack it yourself") from error
    log.info("unpacked %d files of %s", len(wanted), path.name)
    return _holding(folder)


def _place(info: zipfile.ZipInfo) -> Path:
    return Path(*PurePosixPath(info.filename.replace("\\", "/")).parts)


def _check(path: Path, wanted: list[zipfile.ZipInfo]) -> None:
    for info in wanted:
        place = _place(info)
        if place.is_absolute() or ".." in place.parts or ":" in place.parts[0]:
            raise InputError(f"{path} wants to write {info.filename} outside its folder; it is not unpacked")
        if stat.S_ISLNK(info.external_attr >> 16):
            raise InputError(f"{path} holds a link ({info.filename}), which is not followed; zip the photos themselves")
        if info.flag_bits & 1:
            raise InputError(f"{path} has a password; unpack it and give the folder")
        if info.file_size > limits.PICTURE_BYTES:
            raise InputError(f"{path}: {info.filename} unpacks to {info.file_size >> 20} MB, which is no photo")
    if len(wanted) > limits.FILES or sum(i.file_size for i in wanted) > limits.UNPACKED:
        size = sum(i.file_size for i in wanted) >> 20
        raise InputError(f"{path} unpacks to {len(wanted)} files, {size} MB; unpack it yourself and give some of them")


def _write(archive: zipfile.ZipFile, info: zipfile.ZipInfo, target: Path) -> None:
    """One member, no longer than its header says."""
    target.parent.mkdir(parents=True, exist_ok=True)
    left = info.file_size
    with archive.open(info) as source, target.open("wb") as out:
        while chunk := source.read(_CHUNK):
            left -= len(chunk)
            if left < 0:
                raise ValueError(f"{info.filename} is longer than its header says")
            out.write(chunk)


def _holding(folder: Path) -> Path:
    """The folder itself, or the one that an archive of a single folder holds."""
    while True:
        inside = entries(folder)
        if len(inside) != 1 or not inside[0].is_dir():
            return folder
        folder = inside[0]
