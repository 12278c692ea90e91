"""What the stages hand to each other, and every convention of the project, stated once.

Canonical frame: right-handed, X right, the object faces -Y, Z up; its bounding box is centred on the origin
    and its longest side is 1. Voxel (i, j, k) of a 64^3 grid is centred at ((i, j, k) + 0.5) / 64 - 0.5, axes in
    x, y, z order.
World frame: whatever structure from motion chose, in "SfM units"; right-handed, no preferred up.
Cameras: OpenCV axes (x right, y down, z forward), undistorted pinhole, pixel centres at +0.5: a pixel in column c and
    row r covers [c, c+1) x [r, r+1), so u = K (cam_from_world X) gives (c + 0.5, r + 0.5) for its middle.
Transforms are named target_from_source and compose by reading:
    cam_from_canonical = cam_from_world @ world_from_canonical.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np


class ReconError(Exception):
    """A failure that the user can act on; the message says what was wrong, with which file, and what to do."""

    exit_code = 1


class InputError(ReconError):
    """The input or an option is not usable (exit code 2)."""

    exit_code = 2


class ReconstructionError(ReconError):
    """The input is fine but no reconstruction could be made from it (exit code 3)."""

    exit_code = 3


def _check(ok: bool, message: str) -> None:
    if not ok:
        raise ValueError(message)


@dataclass(frozen=True)
class Sightings:
    """Corners of printed sheets (recon.sheet) in photos, m of them.

    view    (m,) int, of the frames
    board   (m,) int, the sheet's number
    copy    (m,) int, from 0: which one in this photo, where several of one number lie about
    corner  (m,) int, of the board
    pixels  (m, 2) float, in the working copies, as their lens shows it
    """

    view: np.ndarray
    board: np.ndarray
    copy: np.ndarray
    corner: np.ndarray
    pixels: np.ndarray

    def __post_init__(self) -> None:
        m = len(self.view)
        _check(all(len(a) == m for a in (self.board, self.copy, self.corner)), "one board, copy and corner each")
        _check(self.pixels.shape == (m, 2), f"pixels must be ({m}, 2), got {self.pixels.shape}")


@dataclass(frozen=True)
class PrintedSheet:
    """A printed sheet where it lies.

    name    as people know it, "sheet 2"
    world_from_sheet  (4, 4) float, a similarity from its own frame: metres as they should have been printed, x to the
            right, y up the page, z out of it, the origin in the board's middle
    names   the photos that show it there
    error   px, by which its corners miss in the median of these
    """

    name: str
    world_from_sheet: np.ndarray
    names: tuple[str, ...]
    error: float

    @property
    def metres_per_unit(self) -> float:
        """Metres of an SfM unit."""
        return 1 / float(np.linalg.norm(self.world_from_sheet[:3, 0]))

    @property
    def plane(self) -> np.ndarray:
        """(4,) plane that it lies in, n away from the side that is printed on."""
        normal = self.world_from_sheet[:3, 2] * self.metres_per_unit
        return np.array([*normal, -normal @ self.world_from_sheet[:3, 3]])


@dataclass(frozen=True)
class Frames:
    """Upright photographs at working size, as PNG/JPEG files that every later stage reads.

    names      V file names of the user's photos, unique, in a fixed (sorted) order
    paths      V paths of the working copies (RGB, orientation applied, resized)
    sizes      (V, 2) int, (width, height) in pixels of the working copies
    focal_px   (V,) float, focal length from EXIF in pixels of the working copy, NaN where unknown
    sharpness  (V,) float, variance of the Laplacian: larger is sharper
    alpha      V paths of a mask taken from the photo's own alpha channel, or None
    skipped    (name, reason) of files that could not be used
    original   (V, 2) int or None, (width, height) in pixels of the upright originals
    sheets     corners of printed sheets in them, None where none was found
    """

    names: tuple[str, ...]
    paths: tuple[Path, ...]
    sizes: np.ndarray
    focal_px: np.ndarray
    sharpness: np.ndarray
    alpha: tuple[Path | None, ...]
    skipped: tuple[tuple[str, str], ...] = ()
    original: np.ndarray | None = None
    sheets: Sightings | None = None

    def __post_init__(self) -> None:
        n = len(self.names)
        _check(len(set(self.names)) == n, "frame names are not unique")
        _check(self.sizes.shape == (n, 2), f"sizes must be ({n}, 2), got {self.sizes.shape}")
        _check(self.focal_px.shape == (n,), f"focal_px must be ({n},), got {self.focal_px.shape}")
        _check(self.original is None or self.original.shape == (n, 2), f"original must be ({n}, 2)")


@dataclass(frozen=True)
class Cameras:
    """Undistorted pinhole cameras of the registered photos.

    names           V names, a subset of Frames.names, same order
    K               (V, 3, 3) float, pixels
    cam_from_world  (V, 4, 4) float, rigid
    sizes           (V, 2) int, (width, height) in pixels
    """

    names: tuple[str, ...]
    K: np.ndarray
    cam_from_world: np.ndarray
    sizes: np.ndarray

    def __post_init__(self) -> None:
        n = len(self.names)
        _check(self.K.shape == (n, 3, 3), f"K must be ({n}, 3, 3), got {self.K.shape}")
        _check(
            self.cam_from_world.shape == (n, 4, 4),
            f"cam_from_world must be ({n}, 4, 4), got {self.cam_from_world.shape}",
        )
        _check(self.sizes.shape == (n, 2), f"sizes must be ({n}, 2), got {self.sizes.shape}")

    def __len__(self) -> int:
        return len(self.names)

    def centres(self) -> np.ndarray:
        """(V, 3) camera centres in the world frame."""
        return camera_centres(self.cam_from_world)

    def subset(self, keep: list[int] | np.ndarray) -> Cameras:
        """The cameras at these indices, in that order."""
        keep = [int(i) for i in keep]
        return Cameras(tuple(self.names[i] for i in keep), self.K[keep], self.cam_from_world[keep], self.sizes[keep])

    def scaled(self, factor: float) -> Cameras:
        """The same cameras for images resized by `factor` (sizes rounded; K follows the rounded sizes exactly)."""
        sizes = np.maximum(1, np.rint(self.sizes * factor)).astype(int)
        K = self.K.copy()
        K[:, :2] *= (sizes / self.sizes)[:, :, None]
        return Cameras(self.names, K, self.cam_from_world, sizes)


@dataclass(frozen=True)
class Lens:
    """How a photo was bent before it was undistorted: a camera model of COLMAP.

    model   its name
    params  (p,) float in COLMAP's order, in pixels of a photo of `size` (2,) int (width, height) as it was taken
    turns   clockwise quarter turns that brought the photo, and its pinhole camera, upright
    """

    model: str
    params: np.ndarray
    size: np.ndarray
    turns: int = 0


@dataclass(frozen=True)
class Observations:
    """Where sparse points were measured in photos, m times.

    view, point  (m,) int, of the cameras and points beside it
    pixels       (m, 2) float, in the undistorted photo
    """

    view: np.ndarray
    point: np.ndarray
    pixels: np.ndarray

    def __post_init__(self) -> None:
        m = len(self.view)
        _check(self.point.shape == (m,) and self.pixels.shape == (m, 2), "one point and one pixel a view are needed")

    def subset(self, keep: np.ndarray) -> Observations:
        """Those at these indices, in that order."""
        return Observations(self.view[keep], self.point[keep], self.pixels[keep])


@dataclass(frozen=True)
class Poses:
    """Result of structure from motion.

    cameras   the registered views, undistorted
    paths     V paths of the undistorted images that belong to the cameras
    points    (n, 3) float, sparse points in the world frame, SfM units
    tracks    (n, V) bool, which camera saw which point
    unregistered  names of photos that could not be placed
    lenses    V lenses that were taken out of the photos, None where nothing was; () when nothing was anywhere
    observations  where the points were measured, None when that is not known
    sheets    printed sheets that lie there
    """

    cameras: Cameras
    paths: tuple[Path, ...]
    points: np.ndarray
    tracks: np.ndarray
    unregistered: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    lenses: tuple[Lens | None, ...] = ()
    observations: Observations | None = None
    sheets: tuple[PrintedSheet, ...] = ()

    def __post_init__(self) -> None:
        _check(len(self.lenses) in (0, len(self.cameras)), "one lens a camera is needed, or none at all")
        _check(len(self.paths) == len(self.cameras), "one undistorted image a camera is needed")
        _check(
            self.points.ndim == 2 and self.points.shape[1] == 3,
            f"points must be (n, 3), got {self.points.shape}",
        )
        _check(self.tracks.shape == (len(self.points), len(self.cameras)), f"tracks: got {self.tracks.shape}")


@dataclass(frozen=True)
class Silhouettes:
    """Where the object is in every registered, undistorted photo.

    names   V names, as in Cameras
    masks   V arrays (H, W) bool, True = object, at the camera's size
    source  V of "user", "alpha", "grabcut" or "backdrop"
    used    (V,) bool: False for views that disagree with the others; they are kept for the report only
    floor   (4,) float or None: plane (n, d) in the world frame with n . X + d = 0, |n| = 1, n towards the cameras
    reasons why a view is not used: (name, reason)
    unknown V of (H, W) bool or None: pixels that may be object or not, such as behind a plant; () when there are none.
            They count neither for nor against a shape. A mask is False there.
    warnings what the user should know
    misplaced  names of views that contradict the others because their cameras stand elsewhere
    """

    names: tuple[str, ...]
    masks: tuple[np.ndarray, ...]
    source: tuple[str, ...]
    used: np.ndarray
    floor: np.ndarray | None = None
    reasons: tuple[tuple[str, str], ...] = ()
    unknown: tuple[np.ndarray | None, ...] = ()
    warnings: tuple[str, ...] = ()
    misplaced: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.names)
        _check(len(self.unknown) in (0, n), "unknown must be empty or of one length with the masks")
        _check(len(self.masks) == n and len(self.source) == n, "names, masks and source must have one length")
        _check(all(m.dtype == bool and m.ndim == 2 for m in self.masks), "masks must be (H, W) bool")
        _check(self.used.shape == (n,) and self.used.dtype == bool, "used must be (V,) bool")

    def known(self, view: int) -> np.ndarray:
        """(H, W) bool: where the mask of a view says something."""
        hidden = self.unknown[view] if self.unknown else None
        return np.ones(self.masks[view].shape, bool) if hidden is None else ~hidden

    def possible(self, view: int) -> np.ndarray:
        """(H, W) bool: where the object is or may be; carving must not cut there."""
        return self.masks[view] | ~self.known(view)


@dataclass(frozen=True)
class Canonical:
    """Where the object stands: world_from_canonical (4, 4) float, a similarity (scale x rotation, translation)."""

    world_from_canonical: np.ndarray

    def __post_init__(self) -> None:
        m = self.world_from_canonical
        _check(m.shape == (4, 4), f"world_from_canonical must be (4, 4), got {m.shape}")
        gram = m[:3, :3].T @ m[:3, :3]
        _check(
            bool(np.allclose(gram, np.eye(3) * gram[0, 0], atol=1e-6 * gram[0, 0])),
            "world_from_canonical is not a similarity",
        )

    @property
    def scale(self) -> float:
        """SfM units per canonical unit (the object's longest side in SfM units)."""
        return float(np.linalg.norm(self.world_from_canonical[:3, 0]))


@dataclass(frozen=True)
class Scene:
    """One object before cameras: the views, its outlines in them, and where it stands.

    Poses and silhouettes name the same views in the same order.
    """

    poses: Poses
    silhouettes: Silhouettes
    canonical: Canonical

    def __post_init__(self) -> None:
        _check(self.poses.cameras.names == self.silhouettes.names, "poses and silhouettes must name the same views")

    @property
    def cameras(self) -> Cameras:
        """Of all views."""
        return self.poses.cameras

    @property
    def used(self) -> Cameras:
        """Of the views whose silhouettes count."""
        return self.cameras.subset(np.flatnonzero(self.silhouettes.used))

    def standing(self, canonical: Canonical) -> Scene:
        """The object somewhere else before the same cameras."""
        return replace(self, canonical=canonical)


NO_FRAMES = Frames((), (), np.zeros((0, 2), int), np.zeros(0), np.zeros(0), ())


def unseen(canonical: Canonical) -> Scene:
    """An object that no camera saw: its shape alone was given."""
    cameras = Cameras((), np.zeros((0, 3, 3)), np.zeros((0, 4, 4)), np.zeros((0, 2), int))
    poses = Poses(cameras, (), np.zeros((0, 3)), np.zeros((0, 0), bool))
    return Scene(poses, Silhouettes((), (), (), np.zeros(0, bool)), canonical)


def camera_centres(cam_from_world: np.ndarray) -> np.ndarray:
    """(V, 3) centres of rigid cam_from_world (V, 4, 4)."""
    return -np.einsum("vji,vj->vi", cam_from_world[:, :3, :3], cam_from_world[:, :3, 3])


def cam_from_canonical(cameras: Cameras, canonical: Canonical) -> np.ndarray:
    """(V, 4, 4) rigid: camera frame scaled to canonical units, so that pinhole projection is unchanged.

    The similarity's scale is divided out of the camera frame; depths come out in canonical units.
    """
    both = cameras.cam_from_world @ canonical.world_from_canonical
    out = both.copy()
    out[:, :3] /= canonical.scale
    return out
