"""Masks that the user drew (or that came as an alpha channel): found by name, checked, brought to the camera's size."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageOps

from recon.files.photo import FORMATS, opened, thinned
from recon.geometry.undistort import undistorted_mask
from recon.scene import Frames, InputError, Poses
from recon.system import limits
from recon.system.folders import entries, exists, is_file

log = logging.getLogger("recon.masks.silhouettes")

EXTENSIONS = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".gif", ".pgm", ".ppm", ".pbm", ".heic"}
EXPECTED = (
    "expected: a picture named like its photo, of the photo's shape, white = object, black = the rest (middle grey = "
    "hidden or unsure)"
)


class BadMask(Exception):
    """One mask cannot be used; the message starts with the file's name and says what was expected."""


@dataclass(frozen=True)
class UserMasks:
    """The masks of a folder.

    masks    (H, W) bool by photo name
    bad      (photo or file name, reason)
    unknown  (H, W) bool by photo name, only where a mask has grey areas: they may be object or not
    """

    masks: dict[str, np.ndarray]
    bad: tuple[tuple[str, str], ...]
    unknown: dict[str, np.ndarray]


def files(folder: Path) -> list[Path]:
    """The pictures of a folder of masks, or, when it has none of its own, of its folders. Raises InputError."""
    if not (exists(folder) and folder.is_dir()):
        raise InputError(f"the folder of masks {folder} does not exist; give the folder that holds them. {EXPECTED}")
    found = _pictures(folder) or [f for inner in entries(folder) if inner.is_dir() for f in _pictures(inner)]
    if not found:
        raise InputError(f"the folder of masks {folder} holds no pictures. {EXPECTED}")
    return found


def _pictures(folder: Path) -> list[Path]:
    return [f for f in entries(folder) if f.suffix.lower() in EXTENSIONS and is_file(f)]


def drawn(folder: Path, frames: Frames, wanted: tuple[str, ...]) -> tuple[UserMasks, int]:
    """The masks of the photos `wanted` as they were drawn, and the number of masks of other photos.

    A mask belongs to the photo NAME.jpg when it is called NAME.png (any image ending), NAME.jpg.png, or one of these
    with "mask" before or after it (NAME_mask.png, NAME.jpg.mask.png, mask_NAME.png), or NAME/mask.png.
    Raises InputError when the folder holds no pictures.
    """
    masks: dict[str, np.ndarray] = {}
    bad: list[tuple[str, str]] = []
    unknown: dict[str, np.ndarray] = {}
    owners, others = _owners(files(folder), frames, bad), 0
    for name, mine in owners.items():
        if name not in wanted:
            others += len(mine)  # a mask of a photo that was skipped or not placed is no mistake
            continue
        try:
            if len(mine) > 1:
                raise BadMask(f"{mine[1].name}: a second mask for the photo {name}; keep one of them")
            width, height = (int(v) for v in frames.sizes[frames.names.index(name)])
            mask, grey = read_mask(mine[0], (width, height)), read_unknown(mine[0], (width, height))
            masks[name] = mask & ~grey
            if grey.any():
                unknown[name] = grey
        except BadMask as error:
            bad.append((name, str(error)))
    return UserMasks(masks, tuple(bad), unknown), others


def _owners(found: list[Path], frames: Frames, bad: list[tuple[str, str]]) -> dict[str, list[Path]]:
    """The files of each photo; of several, those that call themselves masks. What belongs to none goes to `bad`."""
    owners: dict[str, list[Path]] = {}
    for file in found:
        try:
            owners.setdefault(_photo_of(file, frames), []).append(file)
        except BadMask as error:
            bad.append((file.name, str(error)))
    return {name: [f for f in mine if _plain(f) != f.stem] or mine for name, mine in owners.items()}


def load_folder(folder: Path, frames: Frames, poses: Poses) -> UserMasks:
    """The masks of registered photos in a folder, undistorted as these are.

    Raises InputError when the folder or every mask in it is unusable.
    """
    found, unplaced = drawn(folder, frames, poses.cameras.names)
    if not found.masks:
        problems = (
            "; ".join(reason for _, reason in found.bad[:3])
            or f"{unplaced} masks belong to photos that were not placed"
        )
        raise InputError(f"no mask in {folder} can be used: {problems}{_more(len(found.bad) - 3)}")
    lying = [{n: undistorted_mask(m, poses, n) for n, m in part.items()} for part in (found.masks, found.unknown)]
    return UserMasks(lying[0], found.bad, lying[1])


def known(
    frames: Frames, poses: Poses, folder: Path | None
) -> tuple[dict[str, tuple[str, np.ndarray]], dict[str, np.ndarray], list[tuple[str, str]]]:
    """By photo name (source, mask) of masks that need not be found, and where they say nothing; and (name, reason) of
    those that are no good. The user's own masks (`folder`) win over alpha channels."""
    out: dict[str, tuple[str, np.ndarray]] = {}
    for name, path in zip(frames.names, frames.alpha, strict=True):
        if path is not None and name in poses.cameras.names:
            try:
                out[name] = ("alpha", undistorted_mask(read_mask(path, _frame_size(name, poses)), poses, name))
            except BadMask as error:
                log.info("the alpha channel of %s says nothing: %s", name, error)
    if folder is None:
        return out, {}, []
    own = load_folder(folder, frames, poses)
    out.update({name: ("user", mask) for name, mask in own.masks.items()})
    return out, own.unknown, [(name, reason) for name, reason in own.bad if name not in out]


def _more(count: int) -> str:
    return f" (and {count} more)" if count > 0 else ""


def _frame_size(name: str, poses: Poses) -> tuple[int, int]:
    """Width and height of the working copy, which the camera shares."""
    width, height = poses.cameras.sizes[poses.cameras.names.index(name)]
    return int(width), int(height)


_MASK_WORD = r"(?:masks?|alpha|matte|seg|segmentation)"
_AFFIX = re.compile(rf"^{_MASK_WORD}[._\- ]+(?=.)|(?<=.)[._\- ]+{_MASK_WORD}$", re.IGNORECASE)


def _plain(file: Path) -> str:
    """A mask file's stem without the word that says what it is; that of NAME/mask.png is NAME."""
    if re.fullmatch(_MASK_WORD, file.stem, re.IGNORECASE):
        return file.parent.name
    return _AFFIX.sub("", file.stem)


def _photo_of(file: Path, frames: Frames) -> str:
    """The photo that a mask belongs to; an exact name wins over a stem, capitals do not matter if nothing else fits."""
    names = [*frames.names, *(name for name, _ in frames.skipped)]
    if (owner := _owner(file, list(frames.names)) or _owner(file, names)) is not None:
        return owner
    raise BadMask(f"{file.name}: no photo has this name (photos: {', '.join(names[:3])}, ...). {EXPECTED}")


def _owner(file: Path, names: list[str]) -> str | None:
    """The one of `names` that a mask is called like. Raises BadMask when several fit."""
    for called in dict.fromkeys((file.name, f"{_plain(file)}{file.suffix}")):
        stem = Path(called).stem
        for fold in (str, str.lower):
            for key in (str, lambda n: Path(n).stem):
                fitting = [n for n in names if fold(key(n)) in (fold(stem), fold(called) if key is str else None)]
                if len(set(fitting)) > 1:
                    raise BadMask(f"{file.name}: could belong to {' or '.join(fitting)}; call it {fitting[0]}.png")
                if fitting:
                    return fitting[0]
    return None


def read_mask(file: Path, size: tuple[int, int]) -> np.ndarray:
    """(height, width) bool from a mask file of the same shape, at the size (width, height) of the working copy.

    Object is what is brighter than half of the brightest pixel, so that 0/1 and 0/255 both work and JPEG's noise does
    no harm; a transparent background counts as such. Raises BadMask.
    """
    try:
        grey = _grey_of(file)
    except MemoryError:
        raise
    except Exception as error:  # decoders fail in many ways on damaged files
        raise BadMask(f"{file.name}: cannot be read as a picture ({error}). {EXPECTED}") from error
    (height, width), (w, h) = grey.shape, size
    # One pixel of rounding on the shorter side is allowed besides 1 %.
    if abs(width * h / (height * w) - 1) > 0.01 + 1 / min(width, height):
        turned = " (it looks turned by 90 degrees: draw it on the upright photo)" if (width > height) != (w > h) else ""
        raise BadMask(
            f"{file.name}: is {width} x {height}, which is not the shape of its photo ({w} x {h}){turned}. {EXPECTED}"
        )
    inside = (grey > grey.max() / 2).astype(np.float32)
    mask = cv2.resize(inside, (w, h), interpolation=cv2.INTER_AREA if width > w else cv2.INTER_LINEAR) >= 0.5
    if mask.all() or not mask.any():
        colour = "white" if mask.all() else "black"
        raise BadMask(f"{file.name}: is all {colour}. {EXPECTED}")
    return mask


def read_unknown(file: Path, size: tuple[int, int]) -> np.ndarray:
    """(height, width) bool: areas of middle grey, as trimaps have them, of a mask that `read_mask` takes.

    Soft edges are grey as well, but thin: what an opening by 9 pixels takes away does not count.
    """
    grey = _grey_of(file)
    middle = (np.abs(grey / grey.max() - 0.5) < 0.06).astype(np.uint8)
    areas = cv2.morphologyEx(middle, cv2.MORPH_OPEN, np.ones((9, 9), np.uint8))
    return cv2.resize(areas, size, interpolation=cv2.INTER_NEAREST) > 0


def _grey_of(file: Path) -> np.ndarray:
    """(h, w) float of a mask file as people see it; of a very large one a reduced copy. Raises what readers raise."""
    with opened(file, (*FORMATS, "GIF", "PPM")) as picture:
        return _grey(ImageOps.exif_transpose(thinned(picture, limits.PIXELS_AT_ONCE)))


def _grey(picture: Image.Image) -> np.ndarray:
    """(h, w) float, of any number of bits; the alpha channel where it says anything."""
    if "A" in picture.getbands() or "transparency" in picture.info:
        alpha = np.asarray(picture.convert("RGBA"))[..., 3]
        if alpha.min() < alpha.max():
            return alpha.astype(float)
    if picture.mode.startswith(("I", "F")):
        return np.asarray(picture).astype(float)
    return np.asarray(picture.convert("RGB")).max(axis=2).astype(float)
