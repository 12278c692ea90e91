"""A Gaussian splat with known cameras as pictures for the photo route: the object alone, its outline as alpha channel.

The cameras need no images: the splat itself is drawn. Floor, walls and floaters are left out first, by the planes of
the room and by the cleaning that clouds get.
"""

from __future__ import annotations

import logging
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from recon.cameras import known_cameras
from recon.cameras.known_cameras import Given
from recon.files import formats
from recon.files.camera_records import CameraRecords
from recon.files.head import head_of
from recon.files.image_library import Library, flat_names
from recon.files.shape import Kind
from recon.geometry import floor_from_masks
from recon.geometry.room_planes import Room, find_room
from recon.scene import Cameras, InputError, ReconstructionError
from recon.shapes import splat_rendering
from recon.shapes.outlier_removal import CleaningOptions, cleaned
from recon.shapes.splat_rendering import Splat
from recon.system.whole_files import write_picture

log = logging.getLogger("recon.splat")


@dataclass(frozen=True)
class SplatViewOptions:
    """How a splat is drawn."""

    views: int = 50  # as in the paper; of more cameras, evenly spread ones
    longest_side: int = 320  # px; the fit and the refinement work at about this size
    threshold: float = 0.5  # accumulated opacity of the silhouette
    opacity: float = 0.3  # Gaussians below do not say where the object is
    points: int = 20_000  # centres that are looked at to tell the object from the rest
    least_area: int = 40  # px of the object that a view must show
    seed: int = 0
    cleaning: CleaningOptions = field(default_factory=lambda: CleaningOptions(floor_share=0.02))


def is_splat(path: Path) -> bool:
    """Whether a file is a Gaussian splat of any format."""
    try:
        head = head_of(path)
        form = formats.format_of(head)
        return form is not None and formats.describe(head, form).kind == Kind.SPLAT
    except (OSError, InputError):
        return False


def gather(path: Path, cameras: Path, folder: Path, options: SplatViewOptions = SplatViewOptions()) -> Given:
    """Draw the splat's object in the cameras of a COLMAP model or transforms.json, as RGBA pictures in `folder`.

    Raises InputError when either file is damaged, or the cameras do not look at the splat.
    """
    records = _records(path, cameras, options)
    splat = splat_rendering.read(path)
    names = flat_names(list(records.names), [Path(n).with_suffix(".png") for n in records.names])
    scale = min(1.0, options.longest_side / float(records.sizes.max()))
    views = Cameras(names, records.K, records.cam_from_world, records.sizes).scaled(scale)
    alone, points, said = the_object(splat, path, views, options)
    log.info("drawing %d of %d Gaussians in %d views", len(alone), len(splat), len(views))
    alphas = [splat_rendering.opacity(alone, views, v) for v in range(len(views))]
    keep = [v for v, a in enumerate(alphas) if (a >= options.threshold).sum() >= options.least_area]
    if len(keep) < max(2, len(views) / 4):
        raise InputError(
            f"{cameras}: only {len(keep)} of {len(views)} cameras look at the object in {path}; are they those that "
            "the splat was trained with, in the same world?"
        )
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for v in keep:
        write_picture(folder / names[v], _picture(alphas[v], options.threshold))
    views = views.subset(keep)
    drawn = CameraRecords(
        views.names,
        views.sizes,
        views.K,
        (None,) * len(keep),
        views.cam_from_world,
        points,
        np.zeros((len(points), len(keep)), bool),
    )
    if len(keep) < len(alphas):
        said.append(f"{len(alphas) - len(keep)} of {len(alphas)} cameras do not see the object and are not used")
    return Given(known_cameras.required(cameras), folder, views.names, drawn, tuple(said))


def the_object(
    splat: Splat, path: Path, views: Cameras, options: SplatViewOptions = SplatViewOptions()
) -> tuple[Splat, np.ndarray, list[str]]:
    """The Gaussians of what the cameras look at; opaque centres (n, 3) of all, for the floor; what was left out.

    Raises InputError when there is nothing where the cameras look.
    """
    rng = np.random.default_rng(options.seed)
    opaque = splat.centres[splat.opacity >= options.opacity]
    points = opaque[rng.permutation(len(opaque))[: options.points]]
    cells = floor_from_masks.block(views, 2)
    side = cells.side * cells.shape[0]
    middle = cells.origin + cells.axes.T @ (np.array(cells.shape) * cells.side / 2)
    near = points[np.linalg.norm(points - middle, axis=1) < side / 2]
    axes, kept, lies = cells.axes, np.ones(len(near), bool), np.zeros(len(splat), bool)
    try:
        room = find_room(near, views, rng)
    except ReconstructionError:
        log.debug("no floor in the splat")
    else:
        axes = room.axes
        thick = 0.02 * room.distance
        height = near @ room.floor[:3] + room.floor[3]
        if (height < -thick).mean() < 0.1:  # else it is a seat: legs are below
            kept &= height > -thick
            lies = _on(room, splat, thick)
        for wall in room.walls:
            kept &= near @ wall[:3] + wall[3] > thick
    if kept.sum() < options.cleaning.least_points:
        raise InputError(
            f"{path} has {int(kept.sum())} opaque Gaussians where the cameras look; are they those that the splat was "
            "trained with, in the same world?"
        )
    left = cleaned(near[kept] @ axes.T, path, ("z",), True, len(near), options.seed, options.cleaning)
    clean, said = left.points, left.said
    tree = cKDTree(near)
    belongs = np.zeros(len(near), bool)
    belongs[tree.query(clean @ axes)[1]] = True
    # A Gaussian goes with the centre nearest to it; what is far from all, or wide as a wall, is a floater.
    extent = float(np.ptp(clean, axis=0).max())
    distance, nearest = tree.query(splat.centres)
    wide = np.linalg.norm(splat.axes, axis=1).max(1)
    mine = belongs[nearest] & ~lies & (distance < 0.05 * extent) & (wide < 0.25 * extent)
    return splat.subset(mine), points, said


def _on(room: Room, splat: Splat, thick: float) -> np.ndarray:
    """(n,) bool: Gaussians that lie spread out on the floor; a leg's foot is narrow."""
    height = splat.centres @ room.floor[:3] + room.floor[3]
    spread = np.linalg.norm(room.axes[:2] @ splat.axes, axis=2).max(1)
    return (height < -thick) | ((np.abs(height) < thick) & (spread > thick / 2))


def _records(path: Path, cameras: Path, options: SplatViewOptions) -> CameraRecords:
    """The cameras to draw, evenly spread; raises InputError when there are fewer than two."""
    source = known_cameras.required(cameras)
    records = known_cameras.read(source, Library(path.parent, source))
    known = [i for i, size in enumerate(records.sizes) if size.min() > 0]
    if len(known) < 2:
        raise InputError(
            f"{source}: the size of {len(known)} of {len(records.names)} cameras is known, at least 2 are needed; give "
            "w and h, or put the images beside it"
        )
    if len(known) > options.views:
        known = [known[i] for i in np.linspace(0, len(known) - 1, options.views).astype(int)]
    return known_cameras.apart(records.subset(known), source)


def _picture(alpha: np.ndarray, threshold: float) -> np.ndarray:
    """(H, W, 4) uint8: grey by opacity, and the silhouette as alpha channel."""
    grey = np.round(60 + 150 * alpha).astype(np.uint8)
    return np.dstack([grey, grey, grey, np.where(alpha >= threshold, 255, 0).astype(np.uint8)])
