"""The object in one image: a mask file, the alpha channel, GrabCut in a box, the image itself, or a plain backdrop."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from recon.files import frames
from recon.files.frames import FramesOptions
from recon.files.mask_images import BadMask, read_mask, read_unknown
from recon.geometry.mask_checks import EDGED, FULL, RIVAL, areas, outline_support, surely_inverted
from recon.masks import plain_backdrop
from recon.scene import Frames, InputError

LEAST_AREA = 150  # px that an object must cover
MAIN = 0.5  # of an object's mask that its largest part must have
SPECK = (0.005, 0.02)  # of the largest part: smaller ones of a drawn mask, and of one that was found, are none
RUNS = 0.25  # of a side of the box that an object touches, at least, when the box cuts it
REACHED = 0.55  # of a side of the box that an object in it reaches, at least
GRABCUT_SIDE = 640  # px, longest side of the picture that GrabCut works on
WHAT_TO_GIVE = (
    "give --mask FILE (white = object), --box x,y,w,h round the object in pixels, a PNG whose background is "
    "transparent, or a photo before a plain backdrop; 20 to 60 photos from all round need neither"
)


@dataclass(frozen=True)
class Masked:
    """One image as Frames, its mask (H, W) bool at the working copy's size, where the mask comes from, and warnings.

    known  (H, W) bool where a user's mask says something, None for everywhere: middle grey is hidden or unsure
    """

    frames: Frames
    mask: np.ndarray
    source: str
    warnings: tuple[str, ...]
    known: np.ndarray | None = None


def parse_box(text: str) -> tuple[float, float, float, float]:
    """ "x,y,w,h" in pixels of the upright image; raises InputError."""
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"--box wants x,y,w,h in pixels, four numbers with commas, got {text!r}") from error
    if not (np.isfinite([x, y, w, h]).all() and w > 0 and h > 0):
        raise InputError(f"--box wants x,y,w,h with a width and a height above 0, got {text!r}")
    return x, y, w, h


def checked_doubt(degrees: float | None, record: Path | None) -> float:
    """Degrees by which a record's camera may be turned, 0 when nothing was said; raises InputError."""
    if degrees is None:
        return 0.0
    if record is None:
        raise InputError("--camera-off says how far --pix3d's camera may be off; without --pix3d it is found anyway")
    if not 0 < degrees <= 45:
        raise InputError(f"--camera-off wants degrees between 0 and 45, got {degrees:g}")
    return degrees


def run(
    path: Path,
    workdir: Path,
    mask_file: Path | None = None,
    box: tuple[float, float, float, float] | None = None,
    seed: int = 0,
) -> Masked:
    """Read the image into `workdir` and find the object: --mask wins over the alpha channel, and that over --box.

    Without any of them the image may be a mask itself, or show the object before a plain backdrop.
    Raises InputError when the file is no image, nothing says where the object is, or what says so is unusable.
    """
    if not path.is_file():
        raise InputError(f"{path} is not an image file")
    shot = frames.run(path, workdir, FramesOptions(allow_single=True))
    notes: tuple[str, ...] = ()
    width, height = (int(v) for v in shot.sizes[0])
    if mask_file is not None:
        mask, source = _read(mask_file, (width, height)), "user"
    elif shot.alpha[0] is not None:
        mask, source = _read(shot.alpha[0], (width, height)), "alpha"
    elif box is not None:
        (mask, notes), source = _grabcut(shot, box, seed), "grabcut"
    elif _is_mask(shot.paths[0]):
        mask, source = _read(path, (width, height)), "user"
    elif (found := _before_a_plain_backdrop(shot.paths[0])) is not None:
        mask, source = found, "backdrop"
    else:
        raise InputError(f"nothing says where the object is in {path.name}: {WHAT_TO_GIVE}")
    file = {"user": mask_file or path, "alpha": shot.alpha[0]}.get(source)
    known = None if file is None else told(file, (width, height))
    mask, warnings = checked(mask, path.name, known, boxed=source == "grabcut")
    return Masked(shot, mask, source, (*notes, *warnings), known)


def told(file: Path, size: tuple[int, int]) -> np.ndarray | None:
    """(H, W) bool where a mask file says something, or None when it does everywhere."""
    unknown = read_unknown(file, size)
    return ~unknown if unknown.any() else None


def _read(file: Path, size: tuple[int, int]) -> np.ndarray:
    if not file.is_file():
        raise InputError(f"the mask {file} does not exist")
    try:
        return read_mask(file, size)
    except BadMask as error:
        raise InputError(f"the mask cannot be used: {error}") from error


def _before_a_plain_backdrop(path: Path) -> np.ndarray | None:
    image = cv2.imread(str(path))
    return None if image is None else plain_backdrop.find(image)


def _is_mask(path: Path) -> bool:
    """Whether a picture is nearly black and white, and middle grey for the unknown, as a mask in any format is."""
    image = cv2.imread(str(path))
    if image is None:
        return False
    low, high = image.min(2), image.max(2)
    grey = (low > 118) & (high < 138)
    few_valued = np.mean((high < 40) | (low > 215) | grey) > 0.97
    return bool(few_valued and (high < 40).any() and (low > 215).any())


def checked(
    mask: np.ndarray, name: str, known: np.ndarray | None = None, boxed: bool = False
) -> tuple[np.ndarray, tuple[str, ...]]:
    """The object alone, and warnings; parts that may be another object are left out, an inverted mask is turned round.

    known  (H, W) bool where the mask says something, None for everywhere
    Raises InputError.
    """
    warnings = []
    if not boxed and surely_inverted(mask) and areas(~mask)[0] > MAIN * (~mask).sum():
        warnings.append(f"the mask of {name} is inverted (white all along its edge): black is taken as the object")
        mask = ~mask
    mask = mask if known is None else mask & known
    if mask.sum() < LEAST_AREA:
        raise InputError(f"the mask of {name} is empty or tiny ({int(mask.sum())} px); white must be the object")
    border = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
    if border.mean() > 0.9:
        raise InputError(
            f"the mask of {name} reaches the image's border all round: white must be the object, with some background "
            "in view (is it inverted?)"
        )
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    sizes = stats[1:, cv2.CC_STAT_AREA]
    if boxed and sizes.max() < MAIN * sizes.sum():
        raise InputError(
            f"what was found in --box of {name} falls into {len(sizes)} pieces, none of them half of it: the object "
            "could not be told from the background; give --mask FILE (white = object)"
        )
    largest = 1 + int(sizes.argmax())
    keep = np.r_[False, sizes >= SPECK[int(boxed)] * sizes.max()]
    rivals = (sizes >= RIVAL * sizes.max()).sum() - 1
    if rivals:
        warnings.append(f"the mask of {name} shows {rivals + 1} large separate parts: the largest is taken")
        keep[:] = False
        keep[largest] = True
    out = keep[labels]
    edges = [
        n for n, e in (("left", out[:, 0]), ("top", out[0]), ("right", out[:, -1]), ("bottom", out[-1])) if e.any()
    ]
    if edges:
        warnings.append(f"{name} cuts the object off ({', '.join(edges)}): what lies outside is a guess")
    return out, tuple(warnings)


def _grabcut(shot: Frames, box: tuple[float, float, float, float], seed: int) -> tuple[np.ndarray, tuple[str, ...]]:
    """(H, W) bool and warnings: GrabCut, with what lies outside the box as background. `box` in px of the original."""
    width, height = (int(v) for v in shot.sizes[0])
    original = shot.sizes[0] if shot.original is None else shot.original[0]
    x, y, w, h = box
    if x < 0 or y < 0 or x + w > original[0] or y + h > original[1]:
        raise InputError(
            f"--box {x:g},{y:g},{w:g},{h:g} lies outside the image, which is {original[0]} x {original[1]} px"
        )
    image = cv2.imread(str(shot.paths[0]))
    if image is None:
        raise InputError(f"{shot.names[0]} cannot be read again")
    scale = min(1.0, GRABCUT_SIDE / max(width, height))
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    factor = np.array([small.shape[1], small.shape[0]] * 2) / np.tile(original, 2)
    left, top, wide, high = np.round(np.array(box) * factor).astype(int)
    if min(wide, high) < 12:
        raise InputError(f"--box {x:g},{y:g},{w:g},{h:g} is too small to hold an object")
    labels = np.full(small.shape[:2], cv2.GC_BGD, np.uint8)
    labels[top : top + high, left : left + wide] = cv2.GC_PR_FGD
    if (labels == cv2.GC_BGD).sum() < 100:
        raise InputError("--box holds the whole image: some background must lie outside it; or give --mask FILE")
    cv2.setRNGSeed(seed)
    cv2.grabCut(small, labels, None, np.zeros((1, 65)), np.zeros((1, 65)), 6, cv2.GC_INIT_WITH_MASK)  # type: ignore[call-overload]
    inside = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8)
    found = cv2.morphologyEx(inside, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    if not 0.03 < found.sum() / (wide * high) < 0.97:
        raise InputError(f"no object could be told from the background in --box of {shot.names[0]}; give --mask FILE")
    notes = _in_its_box(found[top : top + high, left : left + wide] > 0, (left, top, wide, high), found.shape, shot)
    if (edged := outline_support(small, found > 0)) < EDGED:
        notes += (
            f"{1 - edged:.0%} of the outline found in {shot.names[0]} runs where the photo shows no edge: it may cut "
            "the object or take in background; look at contact_sheet.png, and give --mask FILE (white = object)",
        )
    return cv2.resize(found.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR) > 0.5, notes


def _in_its_box(
    inside: np.ndarray, box: tuple[int, int, int, int], shape: tuple[int, ...], shot: Frames
) -> tuple[str, ...]:
    """Warnings when the box cuts what was found in it (h, w) bool, or is far too large for it; raises InputError when
    it just fills the box."""
    left, top, wide, high = box
    free = {  # sides of the box that are not the photo's own edge
        "left": (inside[:, 0], left > 0),
        "top": (inside[0], top > 0),
        "right": (inside[:, -1], left + wide < shape[1]),
        "bottom": (inside[-1], top + high < shape[0]),
    }
    cut = [name for name, (line, inner) in free.items() if inner and line.mean() > RUNS]
    if len(cut) >= 3 and inside.mean() > FULL:
        raise InputError(
            f"what was found in --box of {shot.names[0]} fills the box: the object was not told from the background; "
            "draw the box a little larger, or give --mask FILE (white = object)"
        )
    notes = []
    if cut:
        notes.append(f"--box seems to cut the object of {shot.names[0]} ({', '.join(cut)}): draw it a little larger")
    filled = [np.flatnonzero(inside.any(axis)) for axis in (0, 1)]
    share = min((np.ptp(f) + 1) / n for f, n in zip(filled, (wide, high), strict=True))
    if share < REACHED:
        notes.append(
            f"what was found in --box of {shot.names[0]} takes up {share:.0%} of it from side to side: if the object "
            "is larger, parts of it were taken for background; draw the box closer round it, or give --mask FILE"
        )
    return tuple(notes)
