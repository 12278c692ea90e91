"""Photos that a camera file leaves out: placed by structure from motion, and brought into the file's own frame.

All photos are placed anew. Those that the file knows, too, give the similarity between the two frames; the others then
follow it. The file's cameras stay as they are.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from recon.cameras import poses
from recon.cameras.sfm_options import PosesOptions
from recon.geometry.umeyama import similarity_between
from recon.scene import Cameras, Frames, Poses, ReconError

log = logging.getLogger("recon.cameras")

LEAST = 4  # cameras that both frames know
TOLERANCE = 0.03  # median distance between matched camera centres, share of their spread
TURN = 5.0  # degrees, median angle between matched cameras


def run(frames: Frames, given: Poses, workdir: Path, options: PosesOptions = PosesOptions()) -> Poses:
    """`given` with the photos that structure from motion could add; a warning says which could not, and why."""
    missing = given.unregistered
    if not missing:
        return given
    log.info("%d photos have no camera: structure from motion places them", len(missing))
    try:
        found = poses.run(frames, workdir / "filled", options)
        added = merged(given, found)
    except (ReconError, ValueError) as error:
        return _told(
            given, f"{_some(missing)} no camera in the file, and structure from motion could not help: {error}"
        )
    if added.unregistered:
        return _told(added, f"{_some(added.unregistered)} no camera in the file, and could not be placed beside it")
    return added


def merged(given: Poses, found: Poses) -> Poses:
    """The given poses, and those found of other photos, in the given world frame.

    Raises ValueError when the two do not agree on the cameras that both have.
    """
    here = {name: i for i, name in enumerate(given.cameras.names)}
    both = [(here[name], i) for i, name in enumerate(found.cameras.names) if name in here]
    if len(both) < LEAST:
        raise ValueError(f"it placed {len(both)} of the photos with cameras, {LEAST} are needed to compare")
    ours, theirs = (list(side) for side in zip(*both, strict=True))
    target, source = given.cameras.centres()[ours], found.cameras.centres()[theirs]
    given_from_found = similarity_between(source, target)
    scale = float(np.cbrt(np.linalg.det(given_from_found[:3, :3])))
    rotation = given_from_found[:3, :3] / scale
    off = np.linalg.norm(source @ given_from_found[:3, :3].T + given_from_found[:3, 3] - target, axis=1)
    spread = float(np.linalg.norm(target - target.mean(0), axis=1).mean())
    turns = [_angle(given.cameras.cam_from_world[i], found.cameras.cam_from_world[j], rotation) for i, j in both]
    if np.median(off) > TOLERANCE * spread or np.median(turns) > TURN:
        raise ValueError("the cameras that it found do not agree with the given ones")
    new = [i for i, name in enumerate(found.cameras.names) if name not in here]
    added = found.cameras.cam_from_world[new] @ np.linalg.inv(given_from_found)
    added[:, :3] = scale * added[:, :3]  # rigid again, in the file's units
    cameras = Cameras(
        given.cameras.names + tuple(found.cameras.names[i] for i in new),
        np.concatenate([given.cameras.K, found.cameras.K[new]]),
        np.concatenate([given.cameras.cam_from_world, added]),
        np.concatenate([given.cameras.sizes, found.cameras.sizes[new]]),
    )
    lenses = [p.lenses or (None,) * len(p.cameras) for p in (given, found)]
    unseen = np.zeros((len(given.points), len(new)), bool)
    return replace(
        given,
        cameras=cameras,
        paths=given.paths + tuple(found.paths[i] for i in new),
        tracks=np.concatenate([given.tracks, unseen], 1),
        unregistered=tuple(n for n in given.unregistered if n not in cameras.names),
        lenses=lenses[0] + tuple(lenses[1][i] for i in new),
    )


def _angle(given: np.ndarray, found: np.ndarray, rotation: np.ndarray) -> float:
    """Degrees between a camera as given and as found, the world turned by `rotation`."""
    between = given[:3, :3] @ rotation @ found[:3, :3].T
    return float(np.degrees(np.arccos(np.clip((np.trace(between) - 1) / 2, -1, 1))))


def _some(names: tuple[str, ...]) -> str:
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"{', '.join(names[:3])}{more} {'has' if len(names) == 1 else 'have'}"


def _told(result: Poses, warning: str) -> Poses:
    log.warning(warning)
    return replace(result, warnings=(*result.warnings, warning))
