"""Printed sheets (recon.sheet) in the user's photos: looked for in all of them, in more detail where there are some."""

from __future__ import annotations

import logging
import os
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from recon.files.photo import UnreadablePhoto, read_photo
from recon.scene import Frames, Sightings
from recon.sheet.detection import Found, find

log = logging.getLogger("recon.files.frames")


@dataclass(frozen=True)
class SheetOptions:
    """How sheets are looked for."""

    search: bool = True
    longest_side: int = 2400  # px, of the photos that they are read in: sheets are small beside furniture
    probe: int = 4  # where no working copy shows one, every so many-th photo is searched at that size


def run(frames: Frames, folder: Path, options: SheetOptions = SheetOptions()) -> Frames:
    """The frames with the corners of sheets that they show.

    folder  holds the user's photos by their names
    """
    if not options.search or len(frames.names) < 2:
        return frames
    with ThreadPoolExecutor(max_workers=min(4, os.cpu_count() or 1)) as pool:
        found = list(pool.map(lambda v: _in_copy(frames, v), range(len(frames.names))))
        shown = any(found)
        closer = [v for v in range(len(found)) if _larger(frames, v, options) and (shown or v % options.probe == 0)]
        detailed = dict(zip(closer, pool.map(lambda v: _in_original(frames, v, folder, options), closer), strict=True))
        if any(detailed.values()) and not shown:
            rest = [v for v in range(len(found)) if v not in detailed and _larger(frames, v, options)]
            detailed |= dict(zip(rest, pool.map(lambda v: _in_original(frames, v, folder, options), rest), strict=True))
    found = [max(f, detailed.get(v, []), key=_corners) for v, f in enumerate(found)]
    if not any(found):
        return frames
    log.info("a printed sheet is seen in %d of %d photos", sum(map(bool, found)), len(found))
    return replace(frames, sheets=_sightings(found))


def _corners(found: list[Found]) -> int:
    return sum(len(f.corner) for f in found)


def _larger(frames: Frames, view: int, options: SheetOptions) -> bool:
    """Whether a photo shows more than its working copy."""
    copy = int(frames.sizes[view].max())
    whole = copy if frames.original is None else int(frames.original[view].max())
    return min(whole, options.longest_side) > 1.2 * copy


def _in_copy(frames: Frames, view: int) -> list[Found]:
    grey = cv2.imread(str(frames.paths[view]), cv2.IMREAD_GRAYSCALE)
    return [] if grey is None else find(grey)


def _in_original(frames: Frames, view: int, folder: Path, options: SheetOptions) -> list[Found]:
    """Found in the photo itself, pixels as of the working copy."""
    try:
        photo = read_photo(folder / frames.names[view], options.longest_side)
    except UnreadablePhoto:  # it changed since
        return []
    if photo is None:
        return []
    scale = frames.sizes[view] / np.array(photo.image.size)
    return [Found(f.board, f.corner, f.pixels * scale) for f in find(np.asarray(photo.image.convert("L")))]


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
