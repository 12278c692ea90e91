"""Why photos could not be placed, told from what was measured, and what to do about it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from recon.geometry.umeyama import similarity_between
from recon.scene import Frames

if TYPE_CHECKING:
    from recon.cameras.sfm_options import Attempt

REMEDY = (
    "What helps: lay a printed newspaper or a patterned rug under the object, take 20 to 60 sharp photos all round it "
    "from two heights without zooming, each showing two thirds of what the one before shows."
)
FEW_FEATURES = 400  # a photo of a textured room has some thousand
BLURRED = 0.3  # of the median sharpness of the set
RIVAL = 0.9  # of the best attempt's observations of points: an attempt with so many is a rival
ELSEWHERE = 0.1  # of the cameras' spread: a rival that places one so far off contradicts
TELLING = 8  # names listed before "and n more"


def explain(
    frames: Frames, registered: np.ndarray, keypoints: np.ndarray, pairs: np.ndarray, models: np.ndarray
) -> str:
    """A sentence on the missing photos and one on the likely cause.

    registered (V,) bool; keypoints (V,) int, features found; pairs (V,) int, with how many other photos a common
    geometry was verified; models: sizes of the partial reconstructions, largest first.
    """
    missing = np.flatnonzero(~registered)
    text = f"{len(missing)} of {len(registered)} photos could not be placed: {_listed(frames, missing)}."
    return f"{text} Likely cause: {'; '.join(_causes(frames, missing, keypoints, pairs, models))}."


def _causes(
    frames: Frames, missing: np.ndarray, keypoints: np.ndarray, pairs: np.ndarray, models: np.ndarray
) -> list[str]:
    """The measurable causes that apply, the most specific first; never empty."""
    causes = []
    typical = float(np.median(frames.sharpness))
    blurred = missing[frames.sharpness[missing] < BLURRED * typical]
    if len(blurred):
        causes.append(f"blur ({_listed(frames, blurred)}: less than a third of the usual sharpness)")
    rest = np.setdiff1d(missing, blurred)
    weak = rest[keypoints[rest] < FEW_FEATURES]
    if len(weak):
        causes.append(
            f"weak texture or blur in {len(weak)} photos ({np.median(keypoints[weak]):.0f} features in the median one, "
            f"a textured scene gives thousands)"
        )
    rest = np.setdiff1d(rest, weak)
    lonely = rest[pairs[rest] < 2]
    if len(lonely):
        causes.append(f"no overlap: {_listed(frames, lonely)} match fewer than two other photos")
    rest = np.setdiff1d(rest, lonely)
    if len(models) > 1 and len(rest):
        sizes = ", ".join(str(n) for n in models[:5])
        causes.append(f"the photos fall into groups of {sizes} that do not connect: photos between them are missing")
    elif len(rest) and not len(models):
        causes.append("no two photos see the scene from far enough apart, or repeating patterns mislead the matching")
    elif len(rest):
        causes.append(f"{_listed(frames, rest)} match others, but with too few common points")
    return causes


def focal_warnings(frames: Frames, view: np.ndarray, K: np.ndarray) -> list[str]:
    """A warning when the estimated focal length (K (v, 3, 3) of frames `view`) is far from what EXIF says."""
    ratio = K[:, 0, 0] / frames.focal_px[view]
    ratio = ratio[np.isfinite(ratio)]
    if len(ratio) and abs(np.log(np.median(ratio))) > np.log(1.25):
        return [
            f"the focal length found is {np.median(ratio):.2f} times the one in the photos' EXIF data: the photos may "
            "be cropped or zoomed, or the reconstruction may be bent"
        ]
    return []


def other_ways(best: Attempt, tried: list[Attempt]) -> list[str]:
    """A warning when another attempt explains the photos nearly as well as the best one and places them elsewhere."""
    for other in tried:
        common = np.intersect1d(best.view, other.view)
        if other is best or len(common) < 4 or other.tracks.sum() < RIVAL * best.tracks.sum():
            continue
        here, there = (a.centres()[np.searchsorted(a.view, common)] for a in (best, other))
        turn = similarity_between(there, here)
        moved = here - there @ turn[:3, :3].T - turn[:3, 3]
        size = np.sqrt(((here - here.mean(0)) ** 2).sum(1).mean())
        if np.linalg.norm(moved, axis=1).max() > ELSEWHERE * size:
            return [
                "the photos can be placed in another way that explains them nearly as well: check in contact_sheet.png "
                "that the outlines fit; more photos between these would decide"
            ]
    return []


def _listed(frames: Frames, indices: np.ndarray) -> str:
    names = [frames.names[i] for i in indices[:TELLING]]
    more = f" and {len(indices) - TELLING} more" if len(indices) > TELLING else ""
    return ", ".join(names) + more
