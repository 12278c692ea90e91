"""Stage 3: where the object is in every photo.

A mask that the user drew wins over the photo's alpha channel, and that over what is found automatically (`cutout`).
All masks are compared with the shape that the others agree on; those that contradict it are not used.
"""

from __future__ import annotations

import logging
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from recon.files import mask_images
from recon.geometry import floor_from_masks, mask_checks, voxel_carving
from recon.geometry.room_planes import FloorOptions, Room, find_room
from recon.geometry.sheet_floor import floor_of
from recon.geometry.undistort import undistorted_mask
from recon.masks import consistency
from recon.masks.segmentation import CutoutOptions, cut_out
from recon.scene import Cameras, Frames, InputError, Poses, ReconstructionError, Silhouettes
from recon.system.names import unique
from recon.system.whole_files import write_picture

log = logging.getLogger("recon.masks.silhouettes")
INSIDE = 0.03  # of a mask outside the others' shape: no more lies outside that of a right one


@dataclass(frozen=True)
class SilhouetteOptions:
    """How the object is told from the room."""

    seed: int = 0  # RANSAC and GrabCut; same seed, same photos: same masks
    floor: FloorOptions = field(default_factory=FloorOptions)
    cutout: CutoutOptions = field(default_factory=CutoutOptions)
    few: int = 8  # photos; with fewer, that nothing was found is put down to it
    judge_cells: int = 96  # cells along the object's box in which masks are compared
    judge_share: float = 0.8  # of the other masks that must contain a cell
    judge_slack: tuple[float, float] = (0.09, 0.12)  # of a mask, drawn or found, that may lie outside the others' shape
    consistent: float = 0.6  # of inverted masks, turned round, that their common shape must explain to be believed
    judge_least: int = 4  # masks; fewer cannot outvote one


def run(
    frames: Frames,
    poses: Poses,
    masks_dir: Path | None,
    workdir: Path,
    options: SilhouetteOptions = SilhouetteOptions(),
) -> Silhouettes:
    """Masks of all registered photos; also written to `workdir`/masks as PHOTO.png, white = object.

    masks_dir  the user's own masks (`usermasks.load_folder`), drawn on the upright photos before undistortion
    Raises InputError when no given mask can be used, ReconstructionError when the object cannot be found without one.
    """
    cameras = poses.cameras
    known, unknown, reasons = mask_images.known(frames, poses, masks_dir)
    given = {cameras.names.index(name): mask for name, (_, mask) in known.items()}
    open_views = [v for v, name in enumerate(cameras.names) if v not in given and name not in dict(reasons)]
    room, problem, about_sheets = _room(poses, options, bool(open_views))
    given, warnings = _white_is_object(given, poses, room, options)
    warnings += about_sheets
    masks = [given.get(v, np.zeros((int(h), int(w)), bool)) for v, (w, h) in enumerate(cameras.sizes)]
    if open_views:
        try:
            if room is None:
                raise ReconstructionError(problem)
            found = _found(poses, room, given, options)
            masks = [found[v] if v in open_views else m for v, m in enumerate(masks)]
        except ReconstructionError as error:
            if not given and len(cameras) < options.few:
                raise ReconstructionError(
                    f"{len(cameras)} photos are too few to tell the object from the room by themselves; give masks "
                    "(--masks, white = object), or more photos"
                ) from error
            if not given:
                raise
            reasons += [(cameras.names[v], f"has no mask, and none was found: {error}") for v in open_views]
    warnings += mask_checks.implausible([masks[v] for v in open_views])
    reasons += [(n, "nothing of the object was found in it") for n in _empty(cameras, masks, reasons)]
    reasons += [(cameras.names[v], f"{why} (--masks)") for v in open_views if (why := mask_checks.unusable(masks[v]))]
    bad = dict(reasons)
    used = np.array([name not in bad for name in cameras.names])
    hidden = {v: unknown[n] for v, n in enumerate(cameras.names) if n in unknown}
    judged = judge(cameras, masks, used, room, options, hidden, set(open_views))
    used, reasons = judged.used, [*reasons, *judged.reasons]
    for name, reason in reasons:
        log.warning("%s is not used: %s", name, reason)
    for warning in warnings:
        log.warning(warning)
    if not used.any():
        raise ReconstructionError("no photo shows the object clearly; give masks (--masks, white = object)")
    _write(cameras, masks, workdir / "masks")
    source = tuple("grabcut" if v in open_views else known.get(n, ("user",))[0] for v, n in enumerate(cameras.names))
    trusted = np.flatnonzero(used)
    level = floor_from_masks.floor(
        None if room is None else room.floor, cameras.subset(trusted), [masks[v] for v in trusted], not open_views
    )
    unseen = tuple(unknown.get(name) for name in cameras.names) if unknown else ()
    return Silhouettes(
        cameras.names,
        tuple(masks),
        source,
        used,
        level,
        tuple(reasons),
        unseen,
        tuple(warnings),
        judged.misplaced,
    )


@dataclass(frozen=True)
class Judged:
    """Which views may be used (V,) bool, (name, reason) of others, and names of those whose cameras stand elsewhere."""

    used: np.ndarray
    reasons: tuple[tuple[str, str], ...] = ()
    misplaced: tuple[str, ...] = ()


def _white_is_object(
    given: dict[int, np.ndarray], poses: Poses, room: Room | None, options: SilhouetteOptions
) -> tuple[dict[int, np.ndarray], list[str]]:
    """The given masks, by view, with inverted ones turned round, and a warning that says so.

    An inverted mask is white along the photo's edge. An object that fills its photos may be so, too: the masks turned
    round must agree on a shape.
    """
    suspects = [v for v, mask in given.items() if mask_checks.edge_share(mask) > mask_checks.SUSPECT]
    if not suspects:
        return given, []
    names = [poses.cameras.names[v] for v in suspects]
    turned = dict(given)
    for v, name in zip(suspects, names, strict=True):
        seen = np.ones_like(given[v])  # what the lens did not see is no object either
        turned[v] = undistorted_mask(seen, poses, name) & ~given[v]
    views = sorted(turned)
    if len(views) == 1:
        agree = mask_checks.surely_inverted(given[views[0]])
    else:
        agree = _explained(poses.cameras.subset(views), [turned[v] for v in views], room, options) > options.consistent
    if not agree:
        return given, []
    some = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
    return turned, [
        f"{len(names)} of {len(given)} masks are inverted (white = background: {some}); black is taken as the object"
    ]


def _room(poses: Poses, options: SilhouetteOptions, needed: bool) -> tuple[Room | None, str, list[str]]:
    """The room, or None and why it was not found, which is only said when it is needed; warnings about sheets."""
    floor: np.ndarray | None = None
    about_sheets: list[str] = []
    if poses.sheets:
        rng = np.random.default_rng(options.seed)
        floor, about_sheets = floor_of(poses.sheets, poses.points, poses.cameras, rng, options.floor)
    rng = np.random.default_rng(options.seed)
    try:
        return find_room(poses.points, poses.cameras, rng, options.floor, floor), "", about_sheets
    except ReconstructionError as error:
        log.log(logging.INFO if needed and len(poses.points) else logging.DEBUG, "%s", error)
        return None, str(error), about_sheets


def _found(poses: Poses, room: Room, given: dict[int, np.ndarray], options: SilhouetteOptions) -> list[np.ndarray]:
    images = []
    for path, (width, height) in zip(poses.paths, poses.cameras.sizes, strict=True):
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None or image.shape[:2] != (height, width):
            raise InputError(f"the undistorted photo {path} is missing or damaged; run again with --force")
        images.append(image)
    return cut_out(images, poses.cameras, room, given, options.cutout, options.seed)


def _empty(cameras: Cameras, masks: list[np.ndarray], reasons: list[tuple[str, str]]) -> list[str]:
    named = dict(reasons)
    return [n for n, m in zip(cameras.names, masks, strict=True) if n not in named and not m.any()]


def judge(
    cameras: Cameras,
    masks: list[np.ndarray],
    used: np.ndarray,
    room: Room | None,
    options: SilhouetteOptions,
    hidden: dict[int, np.ndarray] | None = None,
    found: set[int] | None = None,
) -> Judged:
    """Which views agree with the shape that the other used views carve.

    hidden  (H, W) bool by view, where the object may go on out of sight
    found   the views whose masks were cut out automatically: these may be a little wrong
    """
    views = np.flatnonzero(used)
    if len(views) < options.judge_least:
        return Judged(used)
    some, shown = cameras.subset(views), [masks[v] for v in views]
    possible = [masks[v] | hidden[v] if hidden and v in hidden else masks[v] for v in views]
    cells = _block(some, shown, room, 64)
    votes = consistency.votes(cells, some, shown, possible, options.judge_share, options.judge_cells)
    if votes is None:  # no common shape to measure with: do not accuse anybody
        return Judged(used)
    slack = np.array([options.judge_slack[int(found is not None and v in found)] for v in views])
    wrong = consistency.contradictions(votes, options.judge_share, slack, options.judge_least)
    used = used.copy()
    used[[views[c.view] for c in wrong]] = False
    reasons = tuple((some.names[c.view], _contradicts(c)) for c in wrong)
    return Judged(used, reasons, tuple(some.names[c.view] for c in wrong if c.turned is not None))


def _contradicts(c: consistency.Contradiction) -> str:
    """What is wrong with a view, and what to do."""
    outside = f"{1 - c.covered:.0%} of its outline lies outside their shape (usual for this object: {1 - c.usual:.0%})"
    if c.turned is not None:
        return (
            f"its camera was placed wrongly, which contradicts the others: {outside}, and it would fit about "
            f"{abs(c.turned):.0f} degrees further round the object; more photos in between help"
        )
    if 1 - c.covered < INSIDE:
        return f"its mask contradicts the others: it lacks {1 - c.kept:.0%} of what they show of the object"
    return f"its mask or its camera contradicts the others: {outside}"


def _explained(cameras: Cameras, masks: list[np.ndarray], room: Room | None, options: SilhouetteOptions) -> float:
    """The median share of a mask that the shape which all of them carve covers: 1 for masks of one object."""
    values = [m.astype(np.float32) for m in masks]
    cells = _block(cameras, masks, room, 64)
    for longest in (options.judge_cells, 0):
        solid = voxel_carving.held(cells, cameras, values, options.judge_share * len(cameras))
        if not solid.any():
            return 0.0
        if longest:
            cells = voxel_carving.around(cells, solid, longest)
    shown = map(voxel_carving.pictures(cells, solid, cameras), range(len(cameras)))
    return float(np.median([(p & m).sum() / max(1, m.sum()) for p, m in zip(shown, masks, strict=True)]))


def _block(cameras: Cameras, masks: list[np.ndarray], room: Room | None, longest: int) -> voxel_carving.Cells:
    """The region that the cameras look at; without a floor it is centred where the masks' middles are."""
    if room is not None:
        return voxel_carving.region(room.axes, room.focus, room.distance, cameras, longest)
    return floor_from_masks.block(cameras, longest, masks)


def _write(cameras: Cameras, masks: list[np.ndarray], folder: Path) -> None:
    """PHOTO.png a view, each whole or absent; masks of an earlier run are removed."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, mask in zip(unique(f"{name}.png" for name in cameras.names), masks, strict=True):
        write_picture(folder / name, mask.astype(np.uint8) * 255)
