"""Stage 1: the user's photos become upright RGB working copies of moderate size.

Working copies are JPEG at quality 95 without chroma subsampling: a fifth of a PNG's size, written and read three times
as fast, and the loss is far below a photo's own noise. Orientation is applied here, once, and not stored.
"""

from __future__ import annotations

import logging
import os
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.files.photo import Photo, UnreadablePhoto, read_photo
from recon.files.photo_folder import choose
from recon.files.video import is_video
from recon.scene import Frames, InputError
from recon.system import scratch

log = logging.getLogger("recon.files.frames")

THUMB = 24  # px, side of the square thumbnails that photos are compared by


@dataclass(frozen=True)
class FramesOptions:
    """How photos are read."""

    longest_side: int = 1000  # px of the working copy; smaller photos are never enlarged
    shortest_side: int = 64  # px; a photo below this in either direction is skipped
    same_difference: float = 4.0  # grey levels of 255: thumbnails nowhere further apart are the same picture
    allow_single: bool = False  # accept one photo without alpha channel: set it when the user gives a mask
    quality: int = 95  # JPEG quality of the working copies


def run(input_dir: Path, workdir: Path, options: FramesOptions = FramesOptions()) -> Frames:
    """Read every photo in a folder (not its subfolders), or one photo; working copies go to `workdir`/frames.

    Photos are recognised by their content. Those that cannot be used are in `Frames.skipped` with the reason, and so
    are repetitions of a photo. Raises InputError when nothing usable is left.
    """
    choice = choose(input_dir)
    files = choice.files
    out = workdir / "frames"
    if out.resolve() in (input_dir.resolve(), *input_dir.resolve().parents):
        raise InputError(f"{input_dir} is inside the work folder's own {out}; move the photos elsewhere")
    scratch.fresh(out)
    # The decoders release the interpreter lock, so threads help; a photo is written as soon as it is read, and only
    # its thumbnail is kept.
    with ThreadPoolExecutor(max_workers=min(4, os.cpu_count() or 1)) as pool:
        found = list(pool.map(lambda i: _copy(i, files[i], out, options), range(len(files))))
    skipped = [(f.name, r.reason) for f, r in zip(files, found, strict=True) if isinstance(r, UnreadablePhoto)]
    kept = [r for r in found if isinstance(r, _Kept)]
    if not kept:
        raise InputError(_nothing_usable(input_dir, files, skipped))
    photos, repeated = _without_repetitions(kept, options.same_difference)
    skipped += repeated
    log.info("%d of %d pictures are used", len(photos), len(photos) + len(skipped))
    for name, reason in skipped:
        log.warning("%s is skipped: %s", name, reason)
    if len(photos) == 1 and len(kept) > 1:
        raise InputError(f"all {len(kept)} photos in {input_dir} are identical; walk round the object between photos")
    if len(photos) == 1 and photos[0].alpha is None and not options.allow_single:
        raise InputError(
            f"there is only one usable photo ({photos[0].name}), and a single photo needs a mask: give one "
            "(white = object), a PNG whose background is transparent, or 20 to 60 photos from all round"
        )
    return _frames(photos, skipped)


@dataclass(frozen=True)
class _Kept:
    """What stays of a photo once its working copy is on disk; `thumb` (THUMB, THUMB) uint8."""

    name: str
    path: Path
    size: tuple[int, int]
    original: tuple[int, int]
    focal_px: float
    sharpness: float
    alpha: Path | None
    thumb: np.ndarray


def _copy(index: int, file: Path, out: Path, options: FramesOptions) -> _Kept | UnreadablePhoto | None:
    """Read one file and write its working copy (and mask); None for files that are no photos."""
    try:
        photo = read_photo(file, options.longest_side)
        if photo is None:
            log.debug("%s is not a photo", file.name)
            return None
        if min(photo.image.size) < options.shortest_side:
            width, height = photo.image.size
            raise UnreadablePhoto(f"too small: {width} x {height} px, at least {options.shortest_side} are needed")
    except UnreadablePhoto as error:
        return error
    # The number keeps the order for programs that sort by name; odd characters stay out of paths.
    stem = f"{index:04d}_" + re.sub(r"[^A-Za-z0-9_-]+", "_", file.stem)[:60]
    path = out / f"{stem}.jpg"
    photo.image.save(path, quality=options.quality, subsampling=0)
    return _kept(file.name, path, photo, out / f"{stem}_alpha.png")


def _kept(name: str, path: Path, photo: Photo, mask_path: Path) -> _Kept:
    if photo.mask is not None:
        photo.mask.save(mask_path)
    return _Kept(
        name,
        path,
        photo.image.size,
        photo.original,
        photo.focal_px,
        photo.sharpness(),
        mask_path if photo.mask is not None else None,
        photo.thumbnail(THUMB),
    )


def _without_repetitions(kept: list[_Kept], tolerance: float) -> tuple[list[_Kept], list[tuple[str, str]]]:
    """The first of each group of equal pictures, and the others as (name, reason)."""
    unique: list[_Kept] = []
    repeated: list[tuple[str, str]] = []
    for photo in kept:
        thumb = photo.thumb.astype(np.int16)
        twin = next((u for u in unique if np.abs(u.thumb - thumb).max() <= tolerance), None)
        if twin is None:
            unique.append(photo)
        else:
            repeated.append((photo.name, f"the same picture as {twin.name}"))
    stems: dict[str, str] = {}
    for photo in unique:
        first = stems.setdefault(Path(photo.name).stem, photo.name)
        if first != photo.name:
            log.warning("%s and %s differ only in their endings: one mask will serve both", first, photo.name)
    return unique, repeated


def _nothing_usable(source: Path, files: list[Path], skipped: list[tuple[str, str]]) -> str:
    """Why a folder gave no photo at all."""
    if skipped:
        listed = "; ".join(f"{name}: {reason}" for name, reason in skipped[:5])
        return f"none of the {len(skipped)} photos in {source} can be used ({listed})"
    video = next((f.name for f in files if is_video(f)), None)
    if video:
        return f"{video} is a video; give the video itself instead of the folder {source}"
    named = ", ".join(f.name for f in files[:3]) + (", ..." if len(files) > 3 else "")
    return (
        f"there is no photo among the {len(files)} files in {source} ({named}); JPEG, PNG, HEIC, AVIF, WebP, "
        "TIFF, JPEG 2000 and raw photos are read"
    )


def _frames(photos: list[_Kept], skipped: list[tuple[str, str]]) -> Frames:
    return Frames(
        names=tuple(p.name for p in photos),
        paths=tuple(p.path for p in photos),
        sizes=np.array([p.size for p in photos], dtype=int),
        focal_px=np.array([p.focal_px for p in photos], dtype=float),
        sharpness=np.array([p.sharpness for p in photos], dtype=float),
        alpha=tuple(p.alpha for p in photos),
        skipped=tuple(skipped),
        original=np.array([p.original for p in photos], dtype=int),
    )
