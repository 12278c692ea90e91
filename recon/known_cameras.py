"""Photos whose cameras are known: a COLMAP model or a transforms.json takes the place of structure from motion."""

from __future__ import annotations

import logging
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from recon import colmap_model, transforms_file
from recon.camera_photos import Library, flat_names, link, upright
from recon.camera_records import CameraRecords
from recon.scene import Cameras, Frames, InputError, Poses
from recon.triangulated import triangulate
from recon.undistort import undistorted
from recon.whole_files import write_picture

log = logging.getLogger("recon.cameras")

TRANSFORMS = ("transforms.json", "transforms_train.json")
MODEL_FOLDERS = (".", "sparse/0", "sparse", "colmap/sparse/0", "cameras")
MOST = 120  # photos; of more, evenly spread ones are used: the result gains nothing and every stage takes longer
LEAST_POINTS = 100  # fewer do not carry a floor; matching the photos gives more
LENS_TOLERANCE = 1.5  # px of the working copy that a lens may be missed by before it is said


@dataclass(frozen=True)
class Given:
    """Cameras matched with photos.

    source   the file or folder that the cameras come from
    folder   holds the photos under flat names
    names    V names in `folder`
    records  their V cameras, for the upright photos at the sizes in the records
    warnings what the user should know
    masks    folder of the masks that the file names, called like the photos with another ending added; None: none
    others   names in `folder` of photos without a camera, which structure from motion may place (recon.filling)
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
    """The COLMAP model's folder or the transforms.json that `path` (a folder or a file) is or holds; None if none."""
    if path.is_file():
        if path.name.startswith(("cameras.", "images.")) and colmap_model.is_model(path.parent):
            return path.parent
        return path if transforms_file.is_transforms(path) else None
    # A model first: it brings points.
    folders = (path / f for f in MODEL_FOLDERS)
    files = (path / name for name in TRANSFORMS)
    return next((f for f in folders if colmap_model.is_model(f)), next((f for f in files if f.is_file()), None))


def required(path: Path) -> Path:
    """As `find`; raises InputError when there are no cameras."""
    if (source := find(path)) is None:
        raise InputError(
            f"{path} holds no cameras; --cameras wants the folder of a COLMAP model (cameras and images, .bin or .txt) "
            "or a transforms.json"
        )
    return source


def camera_files(source: Path) -> list[Path]:
    """The files that decide the cameras, for telling whether they changed."""
    if source.is_dir():
        return colmap_model.files(source)
    return [p for p in (source, transforms_file.points_file(source)) if p is not None]


def read(source: Path, library: Library) -> CameraRecords:
    """The cameras of a COLMAP model's folder or a transforms.json. Raises InputError when they are damaged."""
    return colmap_model.read(source) if source.is_dir() else transforms_file.read(source, library.upright_size)


def gather(photos: Path, cameras: Path, folder: Path) -> Given:
    """Read cameras, find their photos at and around `photos`, and link these into `folder` (made anew).

    Raises InputError when the file is damaged, or fewer than two of its images are found.
    """
    source = required(cameras)
    library = Library(photos, source)
    records = read(source, library)
    paths = [library.find(name) for name in records.names]
    placed = [None if p is None else upright(records, i, p) for i, p in enumerate(paths)]
    have = [i for i, u in enumerate(placed) if u is not None]
    warnings = _missing(source, records, paths, have, photos)
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
    kept = records.subset(have)
    sizes, K, poses = (np.array(part) for part in zip(*(placed[i] for i in have), strict=True))
    turned = replace(kept, sizes=sizes, K=K, cam_from_world=poses)
    masks = folder.with_name(f"{folder.name}-masks") if kept.masks else None
    if masks is not None:
        _link_masks(source, kept, names, masks)
    return Given(source, folder, names, turned, tuple(warnings), masks, others)


def _link_masks(source: Path, records: CameraRecords, names: tuple[str, ...], folder: Path) -> None:
    """Masks called like the photos, PHOTO.jpg.png; raises InputError when one is missing."""
    for name, mask in zip(records.names, records.masks, strict=True):
        if mask is not None and not mask.is_file():
            raise InputError(
                f"{source}, frame {name}: its mask {mask} is missing; put it there, or remove mask_path from the frame "
                "to have the object found in the photo"
            )
    link(
        list(records.masks),
        tuple(f"{n}{(m and m.suffix) or '.png'}" for n, m in zip(names, records.masks, strict=True)),
        folder,
    )


def place(frames: Frames, given: Given, workdir: Path) -> Poses:
    """The given cameras at the size of the working copies; undistorted photos go to `workdir`/undistorted.

    Where the file has too few points for floor and walls, and masks are not given by alpha channels, the photos are
    searched for more.
    """
    log.info("cameras given: %d photos, from %s", len(given.names), given.source)
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
    for v, k, k1 in zip(view, K, records.k1, strict=True):
        paths.append(frames.paths[v] if k1 == 0 else _undistorted(frames.paths[v], k, float(k1), out))
    cameras = Cameras(tuple(frames.names[v] for v in view), K, records.cam_from_world, sizes)
    points, tracks = records.points, records.tracks
    masked = given.masked or all(frames.alpha[v] is not None for v in view)
    if not masked and len(points) < LEAST_POINTS:
        log.info("looking for points of the room, which the file has too few of")
        points, tracks = triangulate(cameras, tuple(paths))
    missing = tuple(n for n in frames.names if n not in place_of)
    warnings = (*given.warnings, *_lens_warnings(records, sizes))
    for warning in warnings:
        log.warning(warning)
    return Poses(cameras, tuple(paths), points, tracks, missing, warnings, records.k1)


def _undistorted(path: Path, K: np.ndarray, k1: float, out: Path) -> Path:
    photo = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if photo is None:
        raise InputError(f"the working copy {path} is gone; run again with --force")
    write_picture(out / path.name, undistorted(photo, K, k1), cv2.IMWRITE_JPEG_QUALITY, 95)
    return out / path.name


def _lens_warnings(records: CameraRecords, sizes: np.ndarray) -> list[str]:
    off = float((records.left_over * sizes[:, 0] / records.sizes[:, 0]).max())
    if off <= LENS_TOLERANCE:
        return []
    return [
        f"the lens is taken out by one radial term only, which misses the given one by up to {off:.1f} px in the "
        "photos' corners; undistort the photos first if that matters"
    ]


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
