"""The photos that a camera file names: finding them, their shape and orientation, one folder with flat names."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image

from recon.files.camera_records import CameraRecords
from recon.files.photo import ENDINGS, FORMATS
from recon.scene import InputError, Lens
from recon.system.folders import entries, is_file, lies_in
from recon.system.manifest import is_own_picture
from recon.system.names import unique

# Clockwise quarter turns that bring an image as stored upright, by EXIF orientation (mirrored ones are not cameras').
_TURNS = {1: 0, 6: 1, 3: 2, 8: 3}

_ENDINGS = ("", ".png", ".jpg", ".jpeg", ".PNG", ".JPG")


class Library:
    """Finds the images that a camera file names: in and around INPUT and the file's own folder.

    photos   INPUT; source the file or folder of the cameras
    outside  whether a file may name images anywhere else (absolute paths, "..")
    """

    def __init__(self, photos: Path, source: Path, outside: bool = False) -> None:
        base = source if source.is_dir() else source.parent
        around = [photos if photos.is_dir() else photos.parent, base]
        around += [base.parents[i] for i in range(min(3, len(base.parents)))] if source.is_dir() else []
        self.source, self.outside = source, outside
        self.roots = list(dict.fromkeys(r for a in around for r in (a, a / "images") if r.is_dir()))
        self.own = photos if photos.is_dir() else base
        files = [p for r in (self.own, self.own / "images") if r.is_dir() for p in entries(r) if is_file(p)]
        files = [p for p in files if not is_own_picture(p)]
        self.by_name = {p.name.lower(): p for p in reversed(files)}
        self.by_stem = {p.stem.lower(): p for p in reversed(files) if p.suffix.lower() in ENDINGS}

    def find(self, name: str) -> Path | None:
        """By path, by path without ending (NeRF leaves it out), by name, then by name with another ending.

        Raises InputError for an image that is only there where the file must not lead.
        """
        relative = Path(name.lstrip("/")) if not Path(name).is_absolute() else Path(name)
        written = [root / f"{relative}{ending}" for root in self.roots for ending in _ENDINGS]
        found = [p for p in written if is_file(p)]
        if inside := [p for p in found if self.outside or any(lies_in(p, root) for root in self.roots)]:
            return inside[0]
        last = relative.name.lower()
        named = self.by_name.get(last) or self.by_stem.get(last) or self.by_stem.get(Path(last).stem)
        if named is None and found:
            raise InputError(
                f"{self.source} names {name}, which lies outside its folder and INPUT; put the photos into one of "
                "them, or say --allow-outside"
            )
        return named

    def photos(self) -> list[str]:
        """Names of the folder's photos, or of those in its folder images/ when it has one."""
        folder = self.own / "images" if (self.own / "images").is_dir() else self.own
        return [p.name for p in entries(folder) if is_file(p) and p.suffix.lower() in ENDINGS]

    def others(self, used: list[Path | None]) -> list[str]:
        """Names of the folder's photos that are none of the `used` files."""
        known = {p.resolve() for p in used if p is not None}
        photos = sorted(p for p in self.by_name.values() if p.suffix.lower() in ENDINGS)
        return [p.name for p in photos if p.resolve() not in known]

    def upright_size(self, name: str) -> tuple[int, int] | None:
        """(width, height) as people see it."""
        found = self.find(name)
        seen = None if found is None else _size(found)
        if seen is None:
            return None
        (width, height), turns = seen
        return (height, width) if turns % 2 else (width, height)


def _size(path: Path) -> tuple[tuple[int, int], int] | None:
    """(width, height) as stored and clockwise quarter turns to upright; None for what is no photo or mirrored."""
    try:
        with Image.open(path, formats=FORMATS) as image:
            turns = _TURNS.get(image.getexif().get(ExifTags.Base.Orientation, 1))
            return None if turns is None else (image.size, turns)
    except Exception:  # decoders fail in many ways on damaged files; the frames stage says why it is skipped
        return None


def upright(
    records: CameraRecords, i: int, path: Path
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Lens | None] | None:
    """Size, K, cam_from_world and lens for the upright photo; None when it does not have the camera's shape."""
    seen = _size(path)
    if seen is None:
        return None
    (width, height), turns = seen
    size, K, pose, lens = records.sizes[i], records.K[i], records.cam_from_world[i], records.lenses[i]
    lying = (height, width) if turns % 2 else (width, height)
    if _same_shape(size, lying) and turns != 2:
        return size, K, pose, lens
    if not _same_shape(size, (width, height)):
        return None
    for _ in range(turns):  # a turn by 90 degrees clockwise: pixel (u, v) goes to (h - v, u)
        quarter = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        K = np.array([[K[1, 1], 0, size[1] - K[1, 2]], [0, K[0, 0], K[0, 2]], [0, 0, 1]])
        pose, size = quarter @ pose, size[::-1]
    return size, K, pose, None if lens is None else replace(lens, turns=turns)


def _same_shape(a: np.ndarray, b: tuple[int, int]) -> bool:
    """Whether two sizes have one aspect ratio, but for a pixel of rounding."""
    return min(*a, *b) > 0 and bool(abs(a[0] * b[1] / (a[1] * b[0]) - 1) <= 0.01 + 1 / min(*a, *b))


def flat_names(names: list[str], paths: list[Path | None], taken: list[str] | None = None) -> tuple[str, ...]:
    """A file name for each photo that was found, all different and none of `taken`.

    It is the photo's own, or its folders joined to it where two are equal, and numbered where that is another's.
    """
    found = [(n, p.name) for n, p in zip(names, paths, strict=True) if p is not None]
    counts = Counter(own.casefold() for own in (*(own for _, own in found), *(taken or ())))
    return unique((own if counts[own.casefold()] == 1 else _joined(n, own) for n, own in found), taken or ())


def _joined(name: str, own: str) -> str:
    """The folders of a path and a file's own name, as one name."""
    return "_".join([*(p for p in Path(name).parts[:-1] if p not in (".", "..", "/")), own])


def link(paths: list[Path | None], names: tuple[str, ...], folder: Path) -> None:
    """Symbolic links in `folder` (made anew) where the file system has them, copies elsewhere.

    A name that is there already is an error (FileExistsError): writing to it would go through its link.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for path, name in zip(paths, names, strict=True):
        if path is None:
            continue
        try:
            os.symlink(path.resolve(), folder / name)
        except FileExistsError:
            raise
        except OSError:
            with path.open("rb") as source, (folder / name).open("xb") as copy:
                shutil.copyfileobj(source, copy)
