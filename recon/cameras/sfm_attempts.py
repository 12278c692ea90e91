"""The ladder of attempts at structure from motion: each in a child process, until enough photos are placed."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import threading
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from datasets.jobs import child
from recon.cameras import sheet_matches, sheet_poses
from recon.cameras.intrinsics import held
from recon.cameras.pair_selection import camera_groups, image_pairs
from recon.cameras.sfm_options import BY_SHEET, Attempt, Rung, ladder
from recon.scene import Frames

if TYPE_CHECKING:
    from recon.cameras.sfm_options import PosesOptions

log = logging.getLogger("recon.cameras.poses")

FOCAL_OFF = 0.02  # share, by which the focal length of an attempt and the sheets' may differ where both are right
SHEET_FIRST = 0.9, 0.5  # of the photos and observations of another attempt, that make one by a sheet the better


def climb(
    frames: Frames, folder: Path, logs: Path, options: PosesOptions
) -> tuple[Attempt | None, str, list[Attempt], list[str]]:
    """The attempt that placed the most photos, its rung's name, all attempts, and what went wrong in crashed ones.

    The attempts work in `folder`, which is for this run alone; what they say goes to `logs`.

    Of few photos every rung that reuses features is tried, which takes seconds: two photos of a plane can be placed in
    two ways, and when they come first, few others are there to show which one is wrong. The evidence decides.
    """
    best, best_name = None, ""
    tried: list[Attempt] = []
    failures: list[str] = []
    enough = options.good_fraction * len(frames.names)
    few = len(frames.names) <= options.few_photos
    rungs = ladder(options.attempts, bool(sheet_matches.marks(frames)))
    for i, rung in enumerate(rungs):
        if rung.keep_focal and (best is None or plausible_focal(frames, best.view, best.K)):
            continue
        log.info("attempt %d, %s", i + 1, rung.name)
        started = time.monotonic()
        try:
            about = _about_sheets(frames, best, enough) if rung.sheet else {}
            request = _request(frames, folder, i, rungs, options, about)
            attempt = _in_child(request, logs / f"attempt_{i + 1}.log", options.attempt_seconds)
        except ChildError as error:
            log.warning("attempt %d (%s) failed: %s", i + 1, rung.name, error)
            failures.append(f"{rung.name}: {error}")
            continue
        tried.append(attempt)
        seconds = time.monotonic() - started
        log.info("placed %d of %d photos in %.0f s", len(attempt.view), len(frames.names), seconds)
        # A reconstruction bent by a wrong focal length may hold every photo, but explains few of the matches.
        if best is None or _beats(attempt, rung.sheet, best, best_name == BY_SHEET.name, enough):
            best, best_name = attempt, rung.name
        plausible = rung.keep_focal or plausible_focal(frames, best.view, best.K)
        certain = best_name == BY_SHEET.name
        if len(best.view) >= enough and plausible and (certain or not _cheap_next(rungs[i + 1 :], few)):
            break
        if not rung.reuse and rung.first_octave < 0 and np.median(attempt.keypoints) < 100:
            break  # there is nothing to find in these photos
    return best, best_name, tried, failures


def _cheap_next(coming: tuple[Rung, ...], few: bool) -> bool:
    """Whether an attempt is worth its time though enough photos are placed."""
    return (few and any(r.reuse for r in coming)) or bool(coming and coming[0].sheet)


def _beats(attempt: Attempt, by_sheet: bool, best: Attempt, best_by_sheet: bool, enough: float) -> bool:
    """Whether an attempt is better than the best so far.

    One by a printed sheet, whose corners are certain, is better unless others place far more: then it was moved.
    """
    if by_sheet == best_by_sheet:
        return _evidence(attempt, enough) > _evidence(best, enough)
    sheet, other = (attempt, best) if by_sheet else (best, attempt)
    wins = len(sheet.view) >= min(SHEET_FIRST[0] * len(other.view), enough) and (
        sheet.tracks.sum() >= SHEET_FIRST[1] * other.tracks.sum()
    )
    return wins == by_sheet


def _evidence(attempt: Attempt, enough: float) -> tuple[float, int]:
    """What attempts are ranked by: photos up to enough of them, then how often points were seen."""
    return min(len(attempt.view), enough), int(attempt.tracks.sum())


def plausible_focal(frames: Frames, view: np.ndarray, K: np.ndarray) -> bool:
    """Whether the focal lengths K (v, 3, 3) of frames `view` are near what EXIF says, or EXIF says nothing."""
    ratio = K[:, 0, 0] / frames.focal_px[view]
    ratio = ratio[np.isfinite(ratio)]
    return not len(ratio) or bool(abs(np.log(np.median(ratio))) <= np.log(1.25))


def pair_error(frames: Frames, options: PosesOptions) -> float:
    """px that matches may miss the common geometry of their two photos by.

    COLMAP's 4 px are meant for large photos: in small ones they make a geometry of chance matches. Of many photos the
    others outvote such a pair, and 4 px find more points.
    """
    if len(frames.names) > options.few_photos:
        return 4.0
    return float(np.clip(frames.sizes.max() / 400, 2.0, 4.0))


def _request(
    frames: Frames,
    folder: Path,
    number: int,
    rungs: tuple[Rung, ...],
    options: PosesOptions,
    about_sheets: dict[str, Any],
) -> Path:
    """Write the child's orders; a rung that reuses features keeps the database of the attempt before."""
    count, rung = len(frames.names), rungs[number]
    source = max((i for i, r in enumerate(rungs[: number + 1]) if not r.reuse), default=number)
    if frames.sizes.max() < options.enlarge_below or count <= options.few_photos:
        rung = replace(rung, first_octave=-1)
    given = held(frames, options.intrinsics, options.focal_mm)
    if given is not None:
        rung = replace(rung, keep_focal=True)
    order = {
        "images": [p.name for p in frames.paths],
        "image_dir": str(frames.paths[0].parent.resolve()),
        "groups": camera_groups(frames, given),
        "pairs": image_pairs(
            count,
            "exhaustive" if rung.every_pair else options.matching,
            options.exhaustive_up_to,
            options.overlap,
        ),
        "database": str((folder / f"features_{source}.db").resolve()),
        "pair_error": pair_error(frames, options),
        **about_sheets,
        "rung": asdict(rung),
        "seed": options.seed + number,
        # Of few photos one thread: the time is short anyway, and nothing is left to the order in which threads end.
        "threads": options.threads or (1 if count <= options.few_photos else os.cpu_count() or 1),
    }
    path = folder / f"attempt_{number}.json"
    path.write_text(json.dumps(order, indent=1))
    return path


def _about_sheets(frames: Frames, best: Attempt | None, enough: float) -> dict[str, Any]:
    """Where each camera stands about the sheets, and its lens, by file name.

    The focal length that sheets tell is held where other matches have placed too few photos to know better.
    """
    focals = sheet_poses.focal_lengths(frames)
    known = False
    if best is not None and len(best.view) >= enough:
        off = np.abs(np.log(best.K[:, 0, 0] / focals[best.view]))
        known = bool(np.isfinite(off).any() and np.nanmedian(off) < FOCAL_OFF)
    middles = (frames.sizes / 2).tolist()
    return {
        "marks": sheet_matches.marks(frames),
        "sheet_hold": not known,
        "sheet_poses": sheet_poses.run(frames),
        "sheet_K": {
            p.name: [float(f), *m] for p, f, m in zip(frames.paths, focals, middles, strict=True) if np.isfinite(f)
        },
        "sheet_tolerance": sheet_matches.TOLERANCE * float(frames.sizes.max()),
    }


class ChildError(Exception):
    """The child crashed or took too long."""


def _in_child(request: Path, chatter: Path, seconds: float) -> Attempt:
    """Run one request in a process of its own and read its answer. Raises ChildError."""
    with chatter.open("w") as file:
        process = child.start(
            "recon.cameras.poses",
            str(request.resolve()),
            stdout=subprocess.PIPE,
            stderr=file,
            # Photos and pairs are spread over threads already. Threads below that (matrix products of the matching)
            # gain nothing and split their sums by what is free at the moment: not the same result twice.
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
        timer = threading.Timer(seconds, process.kill)
        timer.start()
        late = False
        try:
            for line in process.stdout or ():
                log.info("  %s", line.strip())
            code = process.wait()
            late = not timer.is_alive()
        finally:
            timer.cancel()
            process.kill()
            process.wait()
    if code != 0:
        tail = " | ".join(chatter.read_text(errors="replace").strip().splitlines()[-5:])
        reason = f"took longer than {seconds:.0f} s" if late else f"ended with code {code}"
        raise ChildError(f"{reason}; the end of {chatter}: {tail or '(empty)'}")
    with np.load(request.with_suffix(".npz"), allow_pickle=False) as arrays:
        return Attempt(**{name: arrays[name] for name in arrays.files})
