"""Printed sheets (recon.sheet) in the user's photos: looked for in all of them, in more detail where there are some."""

from __future__ import annotations

import logging
import os
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from recon.files.photo import UnreadablePhoto, read_photo
from recon.scene import Frames, Sightings
from recon.sheet.detection import Found, find, find_outlined
from recon.sheet.layout import LARGE, SMALL

log = logging.getLogger("recon.files.frames")


@dataclass(frozen=True)
class SheetOptions:
    """How sheets are looked for."""

    search: bool = True
    longest_side: int = 3200  # px, of the photos that they are read in: sheets are small beside furniture
    probe: int = 4  # where no working copy shows one, every so many-th photo is searched at that size


def run(frames: Frames, folder: Path, options: SheetOptions = SheetOptions()) -> Frames:
    """The frames with the corners of sheets that they show.

    folder  holds the user's photos by their names
    """
    if not options.search or len(frames.names) < 2:
        return frames
    views = range(len(frames.names))
    with ThreadPoolExecutor(max_workers=min(4, os.cpu_count() or 1)) as pool:
        found = list(pool.map(lambda v: find(_copy(frames, v)), views))
        if not any(found):
            found = list(
                pool.map(lambda v: _closer(frames, v, folder, options) if v % options.probe == 0 else [], views)
            )
        if not any(found):
            return frames
        found = list(pool.map(lambda v: max(found[v], _closer(frames, v, folder, options), key=_corners), views))
        numbers = sorted({f.board.number for sheets in found for f in sheets})
        found = list(pool.map(lambda v: found[v] + _outlined(frames, v, folder, options, found[v], numbers), views))
    log.info("a printed sheet is seen in %d of %d photos", sum(map(bool, found)), len(found))
    return replace(frames, sheets=_sightings(found))


def _corners(found: list[Found]) -> int:
    return sum(len(f.corner) for f in found)


def _larger(frames: Frames, view: int, options: SheetOptions) -> bool:
    """Whether a photo shows more than its working copy."""
    copy = int(frames.sizes[view].max())
    whole = copy if frames.original is None else int(frames.original[view].max())
    return min(whole, options.longest_side) > 1.2 * copy


def _copy(frames: Frames, view: int) -> np.ndarray:
    """The working copy, grey."""
    grey = cv2.imread(str(frames.paths[view]), cv2.IMREAD_GRAYSCALE)
    return np.zeros((8, 8), np.uint8) if grey is None else grey


def _best(frames: Frames, view: int, folder: Path, options: SheetOptions) -> np.ndarray:
    """The photo itself, grey, no larger than the options say; its working copy where that shows as much."""
    if _larger(frames, view, options):
        with suppress(UnreadablePhoto):  # it changed since
            if (photo := read_photo(folder / frames.names[view], options.longest_side)) is not None:
                return np.asarray(photo.image.convert("L"))
    return _copy(frames, view)


def _closer(frames: Frames, view: int, folder: Path, options: SheetOptions) -> list[Found]:
    """Found in the photo itself; nothing where the working copy shows as much."""
    if not _larger(frames, view, options):
        return []
    grey = _best(frames, view, folder, options)
    return _in_copys_pixels(frames, view, grey, find(grey))


def _probed(frames: Frames, view: int, folder: Path, options: SheetOptions) -> list[Found]:
    """In the photo itself, or by the outline of the pages that most people print."""
    return _closer(frames, view, folder, options) or _outlined(frames, view, folder, options, [], [SMALL[0], LARGE[0]])


def _outlined(
    frames: Frames, view: int, folder: Path, options: SheetOptions, found: list[Found], numbers: list[int]
) -> list[Found]:
    """Sheets that other photos show and this one's markers do not, by the page's outline."""
    missing = [n for n in numbers if n not in {f.board.number for f in found}]
    if not missing:
        return []
    grey = _best(frames, view, folder, options)
    return _in_copys_pixels(frames, view, grey, [f for n in missing for f in find_outlined(grey, n)])


def _in_copys_pixels(frames: Frames, view: int, grey: np.ndarray, found: list[Found]) -> list[Found]:
    scale = frames.sizes[view] / np.array(grey.shape[::-1])
    return [Found(f.board, f.corner, f.pixels * scale) for f in found]


def _sightings(found: list[list[Found]]) -> Sightings:
    """All findings in one table; copies of a sheet in one photo are numbered."""
    rows, pixels = [], []
    for view, sheets in enumerate(found):
        copies: Counter[int] = Counter()
        for sheet in sheets:
            number = sheet.board.number
            rows += [(view, number, copies[number], int(c)) for c in sheet.corner]
            pixels.append(sheet.pixels)
            copies[number] += 1
    table = np.array(rows, int).reshape(-1, 4)
    return Sightings(table[:, 0], table[:, 1], table[:, 2], table[:, 3], np.concatenate(pixels))
