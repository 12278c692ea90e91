"""How structure from motion is tried: options, the ladder of attempts, and what an attempt finds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from recon.scene import camera_centres


@dataclass(frozen=True)
class PosesOptions:
    """How photos are placed."""

    seed: int = 0  # same seed, same photos, same machine: same result
    threads: int = 0  # for features and matching; 0 = one a core, or one for few photos. Mapping uses one: it repeats
    matching: str = "auto"  # "exhaustive", "sequential" (ordered photos), or "auto": by the number of photos
    exhaustive_up_to: int = 60  # photos; "auto" compares every pair up to here
    enlarge_below: int = 700  # px, longest side: smaller photos are searched for features enlarged twice at once
    few_photos: int = 16  # up to here photos are enlarged too, pairs checked more strictly, and more starts are tried
    overlap: int = 10  # neighbours on either side that sequential matching compares
    good_fraction: float = 0.9  # of the photos: once so many are placed, no further attempt is made
    min_registered: int = 6  # photos; fewer placed is an error (of 3 to 5 photos all must be placed)
    min_fraction: float = 0.25  # of the photos; fewer placed is an error
    attempts: int = 5  # at most so many rungs of LADDER
    attempt_seconds: float = 1800.0  # an attempt that takes longer is given up
    intrinsics: tuple[float, float, float, float] | None = None  # fx, fy, cx, cy in px of the originals, held
    focal_mm: tuple[float, float] | None = None  # focal length and sensor width in mm, held; instead of `intrinsics`
    turntable: bool = False  # the object turns before a still camera: nothing but the object is looked at


@dataclass(frozen=True)
class Rung:
    """One attempt: SIFT, matching and mapping settings (COLMAP's units)."""

    name: str
    reuse: bool = False  # take features and matches of the attempt before
    max_features: int = 8192  # a photo
    first_octave: int = 0  # -1: search the photo enlarged twice; finds small detail, takes 3 to 4 times as long
    peak_threshold: float = 0.0067  # lower finds fainter features
    affine: bool = False  # affine shape and domain-size pooling: steeper views of a surface match
    guided: bool = False  # search again along epipolar lines
    every_pair: bool = False  # match exhaustively whatever the options say
    pair_inliers: int = 15  # matches that must fit one geometry for a pair to count
    pose_inliers: int = 30  # points that must fit for a photo to be placed
    start_inliers: int = 100  # matches of the first pair
    start_angle: float = 16.0  # degrees between the rays of the first pair
    keep_focal: bool = False  # hold the focal length that EXIF tells
    sheet: bool = False  # begin with the photos of printed sheets, whose corners are matches


LADDER = (
    Rung("usual settings"),
    Rung("focal length held at EXIF's", True, keep_focal=True),
    Rung("another first pair, lower thresholds", True, pose_inliers=15, start_inliers=40, start_angle=6.0),
    Rung("more and fainter features", False, 8192, -1, 0.0033, False, True, True, 12, 15, 40, 6.0),
    Rung("affine features at several scales", False, 16384, -1, 0.002, True, True, True, 10, 12, 30, 4.0),
)


BY_SHEET = Rung("the printed sheet", True, pair_inliers=12, sheet=True)


def ladder(attempts: int, sheets: bool) -> tuple[Rung, ...]:
    """At most so many rungs of LADDER; with printed sheets one more after each whose features are new."""
    return tuple(r for rung in LADDER[:attempts] for r in ((rung, BY_SHEET) if sheets and not rung.reuse else (rung,)))


@dataclass(frozen=True)
class Attempt:
    """What the child found; v of V photos were placed.

    view (v,) int ascending indices into the frames; K (v, 3, 3); distortion (v,); cam_from_world (v, 4, 4);
    points (n, 3); tracks (n, v) bool; keypoints, pairs (V,) int: features, and photos that verifiably overlap;
    models: sizes of all partial models, largest first; seen (m, 2) int, view (of the v) and point of every measurement,
    at pixels (m, 2) of the undistorted photos.
    """

    view: np.ndarray
    K: np.ndarray
    distortion: np.ndarray
    cam_from_world: np.ndarray
    points: np.ndarray
    tracks: np.ndarray
    keypoints: np.ndarray
    pairs: np.ndarray
    models: np.ndarray
    seen: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), int))
    pixels: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))

    def centres(self) -> np.ndarray:
        """(v, 3) float, where the photos were taken from."""
        return camera_centres(self.cam_from_world)

    @property
    def registered(self) -> np.ndarray:
        """(V,) bool."""
        return np.isin(np.arange(len(self.keypoints)), self.view)
