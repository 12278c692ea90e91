"""Photos whose cameras are known: a COLMAP model or a transforms.json takes the place of structure from motion."""

from __future__ import annotations

import logging
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from recon.cameras import camera_check
from recon.cameras.triangulation import triangulate
from recon.files import camera_table, mask_images
from recon.files.camera_records import CameraRecords
from recon.files.image_library import Library, flat_names, link, upright
from recon.geometry.undistort import undistorted
from recon.scene import Cameras, Frames, InputError, Lens, Poses, camera_centres
from recon.system.folders import is_file, lies_in
from recon.system.whole_files import write_picture

log = logging.getLogger("recon.cameras")

MOST = 120  # photos; of more, evenly spread ones are used: the result gains nothing and every stage takes longer
FARTHEST = 1e9  # units: earth-wide coordinates in metres are below 10^8
SAME_PLACE = 1e-9  # of the largest coordinate: cameras no further apart stand in one place
LEAST_POINTS = 100  # fewer do not carry a floor; matching the photos gives more


@dataclass(frozen=True)
class Given:
    """Cameras matched with photos.

    source   the file or folder that the cameras come from
    folder   holds the photos under flat names
    names    V names in `folder`
    records  their V cameras, for the upright photos at the sizes in the records
    warnings what the user should know
    masks    folder of the masks that the file names, called like the photos with another ending added; None: none
    others   names in `folder` of photos without a camera, which structure from motion may place
             (recon.cameras.register_missing)
    """

    source: Path
    folder: Path
    names: tuple[str, ...]
    records: CameraRecords
    warnings: tuple[str, ...]
    masks: Path | None = None
    others: tuple[str, ...] = ()

    @property
    def masked(self) -> bool:
        """Whether every photo has a mask in the file."""
        return self.masks is not None and all(self.records.masks)


def find(path: Path) -> Path | None:
    """The file or folder of known cameras that `path` (a folder or a file) is or holds; None if none."""
    found = camera_table.find(path)
    return None if found is None else found[0]


def required(path: Path) -> Path:
    """As `find`; raises InputError when there are no cameras."""
    if (source := find(path)) is None:
        raise InputError(
            f"{path} holds no cameras; --cameras wants a COLMAP model's folder (cameras and images, .bin or .txt), a "
            f"transforms.json, or one of {', '.join(r.describe for r in camera_table.READERS[2:])}"
        )
    return source


def camera_files(source: Path) -> list[Path]:
    """The files that decide the cameras, for telling whether they changed."""
    return camera_table.reader_of(source).files(source)


def read(source: Path, library: Library) -> CameraRecords:
    """The cameras that `required` found. Raises InputError when they are damaged, or no camera could be like that."""
    records = camera_table.reader_of(source).read(source, library)
    for name, pose in zip(records.names, records.cam_from_world, strict=True):
        if not np.abs(pose[:3, 3]).max() < FARTHEST:
            raise InputError(f"{source}: the camera of {name} stands {np.abs(pose[:3, 3]).max():.3g} units away")
    near = (np.abs(records.points) < FARTHEST).all(1)
    return replace(records, points=records.points[near], tracks=records.tracks[near])


def apart(records: CameraRecords, source: Path) -> CameraRecords:
    """The same cameras; raises InputError when all stand in one place, which shows no shape."""
    centres = camera_centres(records.cam_from_world)
    if len(centres) > 1 and np.ptp(centres, axis=0).max() <= SAME_PLACE * max(1e-12, float(np.abs(centres).max())):
        raise InputError(
            f"{source}: all {len(centres)} cameras stand in one place, which shows no shape; are their positions "
            "missing? Photos alone do without them (--input photos)"
        )
    return records


def gather(photos: Path, cameras: Path, folder: Path, outside: bool = False) -> Given:
    """Read cameras, find their photos at and around `photos`, and link these into `folder` (made anew).

    outside  whether the file may name images beyond its own folder and `photos`
    Raises InputError when the file is damaged, leads outside, or fewer than two of its images are found.
    """
    source = required(cameras)
    library = Library(photos, source, outside)
    records = read(source, library)
    paths = [library.find(name) for name in records.names]
    records, paths, twice = _once(records, paths)
    placed = [None if p is None else upright(records, i, p) for i, p in enumerate(paths)]
    have = [i for i, u in enumerate(placed) if u is not None]
    warnings = _missing(source, records, paths, have, photos) + twice
    left = library.others([*paths, *records.masks]) if photos.is_dir() else []
    if len(have) > MOST:
        warnings.append(f"{MOST} of the {len(have)} photos with cameras are used, evenly spread")
        have = [have[i] for i in np.linspace(0, len(have) - 1, MOST).astype(int)]
    names = flat_names([records.names[i] for i in have], [paths[i] for i in have], left)
    others = tuple(left)
    if others and (len(others) > len(have) or (records.masks and all(records.subset(have).masks))):
        # So many, or photos of a set that is masked throughout, are rather something else: depths, other sizes.
        warnings.append(
            f"{len(others)} photos are left out, because {source} has no cameras for them ({_listed(left)}); to "
            "include them, have all photos placed anew with --input photos and without --cameras"
        )
        others = ()
    link([*(paths[i] for i in have), *map(library.find, others)], (*names, *others), folder)
    kept = apart(records.subset(have), source)
    sizes, K, poses, lenses = zip(*(u for i in have if (u := placed[i]) is not None), strict=True)
    turned = replace(kept, sizes=np.array(sizes), K=np.array(K), cam_from_world=np.array(poses), lenses=lenses)
    masks = folder.with_name(f"{folder.name}-masks") if kept.masks else None
    if masks is not None:
        _link_masks(source, kept, names, masks, outside)
    return Given(source, folder, names, turned, tuple(warnings), masks, others)


def _once(records: CameraRecords, paths: list[Path | None]) -> tuple[CameraRecords, list[Path | None], list[str]]:
    """Each photo with the first camera that names it, in whatever spelling; and a warning when one was named twice."""
    first: dict[Path, int] = {}
    keep = [i for i, p in enumerate(paths) if p is None or first.setdefault(p.resolve(), i) == i]
    if len(keep) == len(paths):
        return records, paths, []
    again = [records.names[i] for i in range(len(paths)) if i not in keep]
    warning = f"{len(again)} cameras name a photo that another names, too ({_listed(again)}); the first one is used"
    return records.subset(keep), [paths[i] for i in keep], [warning]


def _link_masks(source: Path, records: CameraRecords, names: tuple[str, ...], folder: Path, outside: bool) -> None:
    """Masks called like the photos, PHOTO.jpg.png; raises InputError when one is missing or lies elsewhere."""
    # This project's own cameras/transforms.json names ../masks.
    own = (source.parent, source.parent.parent / "masks")
    for name, mask in zip(records.names, records.masks, strict=True):
        if mask is not None and not (outside or any(lies_in(mask, place) for place in own)):
            raise InputError(
                f"{source}, frame {name}: its mask {mask} lies outside the file's folder; put the masks there, or say "
                "--allow-outside"
            )
        if mask is not None and not is_file(mask):
            raise InputError(
                f"{source}, frame {name}: its mask {mask} is missing; put it there, or remove mask_path from the frame "
                "to have the object found in the photo"
            )
    link(
        list(records.masks),
        tuple(f"{n}{(m and m.suffix) or '.png'}" for n, m in zip(names, records.masks, strict=True)),
        folder,
    )


def run(frames: Frames, given: Given, workdir: Path, masks: Path | None = None) -> Poses:
    """The given cameras at the size of the working copies, checked; undistorted photos go to `workdir`/undistorted.

    They are checked against the masks (the folder `masks`, alpha channels) and their own points. Where the file has too
    few points for floor and walls, and masks are not given, the photos are searched for more.
    Raises InputError when they do not fit.
    """
    log.info("cameras given: %d photos, from %s", len(given.names), given.source)
    placed = place(frames, given, workdir)
    known, _, _ = mask_images.known(frames, placed, masks)
    by_view = {placed.cameras.names.index(name): mask for name, (_, mask) in known.items()}
    axes = camera_table.reader_of(given.source).axes
    checked, said = camera_check.fitting(placed.cameras, by_view, placed.points, placed.tracks, given.source, axes)
    points, tracks = placed.points, placed.tracks
    if not (given.masked or len(by_view) == len(checked)) and len(points) < LEAST_POINTS:
        log.info("looking for points of the room, which the file has too few of")
        points, tracks = triangulate(checked, placed.paths)
        if len(points) < LEAST_POINTS and not by_view:
            checked, said = camera_check.by_matches(
                checked, lambda c: len(triangulate(c, placed.paths)[0]), len(points), given.source, axes
            )
            points, tracks = triangulate(checked, placed.paths) if said else (points, tracks)
    for warning in (*given.warnings, *said):
        log.warning(warning)
    return replace(placed, cameras=checked, points=points, tracks=tracks, warnings=(*given.warnings, *said))


def place(frames: Frames, given: Given, workdir: Path) -> Poses:
    """The cameras, points and undistorted photos of the frames that have a camera, as the file has them."""
    out = workdir / "undistorted"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    place_of = {name: i for i, name in enumerate(given.names)}
    view = [v for v, name in enumerate(frames.names) if name in place_of]
    records = given.records.subset([place_of[frames.names[v]] for v in view])
    if len(view) < 2:
        raise InputError(f"only {len(view)} of the {len(given.names)} photos with cameras can be read, 2 are needed")
    sizes, K, paths = frames.sizes[view], records.K.copy(), []
    K[:, :2] *= (sizes / records.sizes)[:, :, None]
    for v, k, lens in zip(view, K, records.lenses, strict=True):
        paths.append(frames.paths[v] if lens is None else _undistorted(frames.paths[v], k, lens, out))
    cameras = Cameras(tuple(frames.names[v] for v in view), K, records.cam_from_world, sizes)
    missing = tuple(n for n in frames.names if n not in place_of)
    return Poses(cameras, tuple(paths), records.points, records.tracks, missing, given.warnings, records.lenses)


def _undistorted(path: Path, K: np.ndarray, lens: Lens, out: Path) -> Path:
    photo = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if photo is None:
        raise InputError(f"the working copy {path} is gone; run again with --force")
    write_picture(out / path.name, undistorted(photo, K, lens), cv2.IMWRITE_JPEG_QUALITY, 95)
    return out / path.name


def _missing(
    source: Path, records: CameraRecords, paths: list[Path | None], have: list[int], photos: Path
) -> list[str]:
    """A warning when images of the file are missing or of another shape; raises InputError when too many are."""
    total = len(records.names)
    gone = [n for n, p in zip(records.names, paths, strict=True) if p is None]
    other = [n for i, n in enumerate(records.names) if paths[i] is not None and i not in have]
    parts = [f"{len(gone)} of {total} images named in {source} are missing ({_listed(gone)})"] if gone else []
    if other:
        parts.append(f"{len(other)} of {total} have another shape than their cameras ({_listed(other)})")
    if len(have) >= 2:
        return ["; ".join(parts) + "; the others are used"] if parts else []
    if not parts:
        raise InputError(f"{source}: it has {total} cameras, at least 2 are needed")
    kind = "a COLMAP model of other images" if source.is_dir() else "of other images"
    what = "give the folder that holds its images, with --cameras"
    raise InputError(f"{source} is {kind} than those in {photos}: {'; '.join(parts)}; {what} {source}")


def _listed(names: list[str]) -> str:
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
