"""Masks that the user drew (or that came as an alpha channel): found by name, checked, brought to the camera's size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from recon.scene import Frames, InputError, Poses
from recon.undistort import undistorted_mask

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

    masks    (H, W) bool by photo name, as the undistorted photo lies
    bad      (photo or file name, reason)
    unknown  (H, W) bool by photo name, only where a mask has grey areas: they may be object or not
    """

    masks: dict[str, np.ndarray]
    bad: tuple[tuple[str, str], ...]
    unknown: dict[str, np.ndarray]


def load_folder(folder: Path, frames: Frames, poses: Poses) -> UserMasks:
    """The masks of registered photos in a folder; raises InputError when the folder or every mask in it is unusable.

    A mask belongs to the photo NAME.jpg when it is called NAME.png (any image extension) or NAME.jpg.png.
    """
    if not folder.is_dir():
        raise InputError(f"the folder of masks {folder} does not exist; give the folder that holds them. {EXPECTED}")
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in EXTENSIONS and not f.name.startswith("."))
    if not files:
        raise InputError(f"the folder of masks {folder} holds no pictures. {EXPECTED}")
    masks: dict[str, np.ndarray] = {}
    bad: list[tuple[str, str]] = []
    unknown: dict[str, np.ndarray] = {}
    unplaced = 0
    for file in files:
        try:
            name = _photo_of(file, frames)
        except BadMask as error:
            bad.append((file.name, str(error)))
            continue
        if name not in poses.cameras.names:
            unplaced += 1  # a mask of a photo that was skipped or not placed is no mistake
            continue
        try:
            if name in masks:
                raise BadMask(f"{file.name}: a second mask for the photo {name}; keep one of them")
            size = _frame_size(name, frames, poses)
            mask, grey = read_mask(file, size), read_unknown(file, size)
            masks[name] = undistorted_mask(mask & ~grey, poses, name)
            if grey.any():
                unknown[name] = undistorted_mask(grey, poses, name)
        except BadMask as error:
            bad.append((name, str(error)))
    if not masks:
        problems = (
            "; ".join(reason for _, reason in bad[:3]) or f"{unplaced} masks belong to photos that were not placed"
        )
        raise InputError(f"no mask in {folder} can be used: {problems}{_more(len(bad) - 3)}")
    return UserMasks(masks, tuple(bad), unknown)


def _more(count: int) -> str:
    return f" (and {count} more)" if count > 0 else ""


def _frame_size(name: str, frames: Frames, poses: Poses) -> tuple[int, int]:
    """Width and height of the working copy, which the camera shares."""
    width, height = poses.cameras.sizes[poses.cameras.names.index(name)]
    return int(width), int(height)


def _photo_of(file: Path, frames: Frames) -> str:
    """The photo that a mask belongs to; an exact name wins over a stem, capitals do not matter if nothing else fits."""
    names = [*frames.names, *(name for name, _ in frames.skipped)]
    for fold in (str, str.lower):
        for key in (str, lambda n: Path(n).stem):
            fitting = [n for n in names if fold(key(n)) in (fold(file.stem), fold(file.name) if key is str else None)]
            if len(set(fitting)) > 1:
                raise BadMask(f"{file.name}: could belong to {' or '.join(fitting)}; call it {fitting[0]}.png")
            if fitting:
                return fitting[0]
    raise BadMask(f"{file.name}: no photo has this name (photos: {', '.join(names[:3])}, ...). {EXPECTED}")


def read_mask(file: Path, size: tuple[int, int]) -> np.ndarray:
    """(height, width) bool from a mask file of the same shape, at the size (width, height) of the working copy.

    Object is what is brighter than half of the brightest pixel, so that 0/1 and 0/255 both work and JPEG's noise does
    no harm; a transparent background counts as such. Raises BadMask.
    """
    try:
        with Image.open(file) as picture:
            grey = _grey(ImageOps.exif_transpose(picture))
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError, SyntaxError, ValueError) as error:
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
    with Image.open(file) as picture:
        grey = _grey(ImageOps.exif_transpose(picture))
    middle = (np.abs(grey / grey.max() - 0.5) < 0.06).astype(np.uint8)
    areas = cv2.morphologyEx(middle, cv2.MORPH_OPEN, np.ones((9, 9), np.uint8))
    return cv2.resize(areas, size, interpolation=cv2.INTER_NEAREST) > 0


def _grey(picture: Image.Image) -> np.ndarray:
    """(h, w) float, of any number of bits; the alpha channel where it says anything."""
    if "A" in picture.getbands() or "transparency" in picture.info:
        alpha = np.asarray(picture.convert("RGBA"))[..., 3]
        if alpha.min() < alpha.max():
            return alpha.astype(float)
    if picture.mode.startswith(("I", "F")):
        return np.asarray(picture).astype(float)
    return np.asarray(picture.convert("RGB")).max(axis=2).astype(float)
