"""Stage 2: where every photo was taken from, by structure from motion, and the undistorted photos that go with it.

pycolmap runs in a child process, `python -m recon.poses REQUEST.json`: imported before cv2 or PIL it breaks their PNG
writing (double free in zlib), and a crash of its native code must not take the command down. The child's answer is
RESULT.json and RESULT.npz; its chatter goes to a log file beside them.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
import subprocess
import sys
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from recon import pose_diagnosis
from recon.matching_plan import camera_groups, image_pairs
from recon.scene import Cameras, Frames, InputError, Poses, ReconstructionError
from recon.undistort import undistorted

log = logging.getLogger("recon.poses")


@dataclass(frozen=True)
class PosesOptions:
    """How photos are placed."""

    seed: int = 0  # same seed, same photos, same machine: same result
    threads: int = 0  # for features and matching; 0 = one a core. Mapping uses one, so that it repeats exactly
    matching: str = "auto"  # "exhaustive", "sequential" (ordered photos), or "auto": by the number of photos
    exhaustive_up_to: int = 60  # photos; "auto" compares every pair up to here
    overlap: int = 10  # neighbours on either side that sequential matching compares
    good_fraction: float = 0.9  # of the photos: once so many are placed, no further attempt is made
    min_registered: int = 6  # photos; fewer placed is an error (of 3 to 5 photos all must be placed)
    min_fraction: float = 0.25  # of the photos; fewer placed is an error
    attempts: int = 4  # at most so many rungs of LADDER
    attempt_seconds: float = 1800.0  # an attempt that takes longer is given up


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


LADDER = (
    Rung("usual settings"),
    Rung("another first pair, lower thresholds", True, pose_inliers=15, start_inliers=40, start_angle=6.0),
    Rung("more and fainter features", False, 8192, -1, 0.0033, False, True, True, 12, 15, 40, 6.0),
    Rung("affine features at several scales", False, 16384, -1, 0.002, True, True, True, 10, 12, 30, 4.0),
)


def run(frames: Frames, workdir: Path, options: PosesOptions = PosesOptions()) -> Poses:
    """Place the photos; undistorted photos go to `workdir`/undistorted, logs to `workdir`/poses.

    Climbs LADDER until enough photos are placed and keeps the best attempt. Raises ReconstructionError, which says how
    many were placed, the likely cause and what to do, when fewer than the options ask for could be placed.
    """
    if options.matching not in ("auto", "exhaustive", "sequential"):
        raise InputError(f"matching must be auto, exhaustive or sequential, not {options.matching!r}")
    total = len(frames.names)
    if total < 3:
        raise ReconstructionError(f"{total} photos are too few to place cameras; {pose_diagnosis.REMEDY}")
    folder = workdir / "poses"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    best, rung, failures = _climb(frames, folder, options)
    if best is None:
        raise ReconstructionError("structure from motion stopped with an error: " + "; ".join(failures))
    diagnosis = pose_diagnosis.explain(frames, best.registered, best.keypoints, best.pairs, best.models)
    if len(best.view) < _needed(total, options):
        raise ReconstructionError(
            f"only {len(best.view)} of {total} photos could be placed, at least {_needed(total, options)} are needed. "
            f"{diagnosis} {pose_diagnosis.REMEDY}"
        )
    warnings = [diagnosis] if len(best.view) < total else []
    if rung != LADDER[0].name:
        warnings.append(f'the photos were hard to place: {len(best.view)} of {total} with "{rung}"')
    warnings += pose_diagnosis.focal_warnings(frames, best.view, best.K)
    for warning in warnings:
        log.warning(warning)
    return _poses(frames, best, workdir / "undistorted", tuple(warnings))


@dataclass(frozen=True)
class _Attempt:
    """What the child found; v of V photos were placed.

    view (v,) int ascending indices into the frames; K (v, 3, 3); distortion (v,); cam_from_world (v, 4, 4);
    points (n, 3); tracks (n, v) bool; keypoints, pairs (V,) int: features, and photos that verifiably overlap;
    models: sizes of all partial models, largest first.
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

    @property
    def registered(self) -> np.ndarray:
        """(V,) bool."""
        return np.isin(np.arange(len(self.keypoints)), self.view)


def _needed(total: int, options: PosesOptions) -> int:
    return max(3, min(options.min_registered, total), int(np.ceil(options.min_fraction * total)))


def _climb(frames: Frames, folder: Path, options: PosesOptions) -> tuple[_Attempt | None, str, list[str]]:
    """The attempt that placed the most photos, its rung's name, and what went wrong in crashed attempts."""
    best, best_name, failures = None, "", []
    for i, rung in enumerate(LADDER[: options.attempts]):
        log.info("attempt %d, %s", i + 1, rung.name)
        started = time.monotonic()
        try:
            attempt = _in_child(_request(frames, folder, i, rung, options), options.attempt_seconds)
        except _ChildError as error:
            log.warning("attempt %d (%s) failed: %s", i + 1, rung.name, error)
            failures.append(f"{rung.name}: {error}")
            continue
        seconds = time.monotonic() - started
        log.info("placed %d of %d photos in %.0f s", len(attempt.view), len(frames.names), seconds)
        if best is None or len(attempt.view) > len(best.view):
            best, best_name = attempt, rung.name
        if len(attempt.view) >= options.good_fraction * len(frames.names):
            break
        if not rung.reuse and rung.first_octave < 0 and np.median(attempt.keypoints) < 100:
            break  # there is nothing to find in these photos
    return best, best_name, failures


def _request(frames: Frames, folder: Path, number: int, rung: Rung, options: PosesOptions) -> Path:
    """Write the child's orders; a rung that reuses features keeps the database of the attempt before."""
    count = len(frames.names)
    order = {
        "images": [p.name for p in frames.paths],
        "image_dir": str(frames.paths[0].parent.resolve()),
        "groups": camera_groups(frames),
        "pairs": image_pairs(
            count,
            "exhaustive" if rung.every_pair else options.matching,
            options.exhaustive_up_to,
            options.overlap,
        ),
        "database": str((folder / f"features_{number - rung.reuse}.db").resolve()),
        "rung": asdict(rung),
        "seed": options.seed + number,
        "threads": options.threads or os.cpu_count() or 1,
    }
    path = folder / f"attempt_{number}.json"
    path.write_text(json.dumps(order, indent=1))
    return path


class _ChildError(Exception):
    """The child crashed or took too long."""


def _in_child(request: Path, seconds: float) -> _Attempt:
    """Run one request in a process of its own and read its answer. Raises _ChildError."""
    chatter = request.with_suffix(".log")
    with chatter.open("w") as file:
        child = subprocess.Popen(
            [sys.executable, "-m", "recon.poses", str(request.resolve())],
            stdout=subprocess.PIPE,
            stderr=file,
            text=True,
            cwd=Path(__file__).resolve().parents[1],  # where this package is found, installed or not
            env={**os.environ, "OMP_WAIT_POLICY": "PASSIVE"},
        )
        timer = threading.Timer(seconds, child.kill)
        timer.start()
        late = False
        try:
            for line in child.stdout or ():
                log.info("  %s", line.strip())
            code = child.wait()
            late = not timer.is_alive()
        finally:
            timer.cancel()
            child.kill()
            child.wait()
    if code != 0:
        tail = " | ".join(chatter.read_text(errors="replace").strip().splitlines()[-5:])
        reason = f"took longer than {seconds:.0f} s" if late else f"ended with code {code}"
        raise _ChildError(f"{reason}; the end of {chatter}: {tail or '(empty)'}")
    with np.load(request.with_suffix(".npz"), allow_pickle=False) as arrays:
        return _Attempt(**{name: arrays[name] for name in arrays.files})


def _poses(frames: Frames, found: _Attempt, out: Path, warnings: tuple[str, ...]) -> Poses:
    """Write undistorted photos of the same size and the same K, and put the stage's result together."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    paths = []
    for i, k, distortion in zip(found.view, found.K, found.distortion, strict=True):
        photo = cv2.imread(str(frames.paths[i]), cv2.IMREAD_COLOR)
        if photo is None:
            raise InputError(f"the working copy {frames.paths[i]} is gone; run again with --force")
        path = out / frames.paths[i].name
        quality = [cv2.IMWRITE_JPEG_QUALITY, 95, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        cv2.imwrite(str(path), undistorted(photo, k, float(distortion)), quality)
        paths.append(path)
    cameras = Cameras(
        tuple(frames.names[i] for i in found.view), found.K, found.cam_from_world, frames.sizes[found.view]
    )
    missing = tuple(name for name, ok in zip(frames.names, found.registered, strict=True) if not ok)
    return Poses(cameras, tuple(paths), found.points, found.tracks, missing, warnings, found.distortion)


# ---- the child process: the only place that knows pycolmap ----


def _child(request: Path) -> None:
    """Carry out a request and write its answer as .npz beside it."""
    import pycolmap

    order = json.loads(request.read_text())
    pycolmap.logging.logtostderr = True
    pycolmap.set_random_seed(order["seed"])
    database = Path(order["database"])
    if not order["rung"]["reuse"] or not database.exists():
        database.unlink(missing_ok=True)
        partial = database.with_suffix(".partial")
        partial.unlink(missing_ok=True)
        _say("looking for features")
        _extract(pycolmap, partial, order)
        _say(f"comparing {len(order['pairs'])} pairs of photos")
        _match(pycolmap, partial, order, request.with_suffix(".pairs.txt"))
        partial.rename(database)
    _say("placing the photos")
    models = _map(pycolmap, database, order, request.with_suffix(""))
    answer = {**_counts(pycolmap, database, order["images"]), **_arrays(models, order["images"])}
    np.savez(request.with_suffix(".npz"), **answer)


def _say(message: str) -> None:
    sys.stdout.write(message + "\n")
    sys.stdout.flush()


def _extract(pycolmap: Any, database: Path, order: dict[str, Any]) -> None:
    rung = order["rung"]
    pycolmap.Database.open(str(database)).close()
    for group in order["groups"]:
        reader = pycolmap.ImageReaderOptions()
        reader.camera_model = "SIMPLE_RADIAL"
        if group["params"]:
            reader.camera_params = ",".join(str(p) for p in group["params"])  # also marks the focal length as known
        # Images are entered in order first: extraction threads would number them as they finish, differently each run.
        pycolmap.import_images(database, order["image_dir"], pycolmap.CameraMode.SINGLE, group["images"], reader)
    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu = False
    options.num_threads = order["threads"]
    options.sift.max_num_features = rung["max_features"]
    options.sift.first_octave = rung["first_octave"]
    options.sift.peak_threshold = rung["peak_threshold"]
    options.sift.estimate_affine_shape = rung["affine"]
    options.sift.domain_size_pooling = rung["affine"]
    pycolmap.extract_features(
        database, order["image_dir"], order["images"], extraction_options=options, device=pycolmap.Device.cpu
    )


def _match(pycolmap: Any, database: Path, order: dict[str, Any], pair_list: Path) -> None:
    images, rung = order["images"], order["rung"]
    pair_list.write_text("".join(f"{images[i]} {images[j]}\n" for i, j in order["pairs"]))
    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    matching.num_threads = order["threads"]
    matching.guided_matching = rung["guided"]
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = str(pair_list)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.min_num_inliers = rung["pair_inliers"]
    verification.ransac.random_seed = order["seed"]
    # Pairs without overlap use up every trial: 10,000 (the default) takes twice the time and gains no pair.
    verification.ransac.max_num_trials = 1000
    pycolmap.match_image_pairs(database, matching, pairing, verification, pycolmap.Device.cpu)


def _map(pycolmap: Any, database: Path, order: dict[str, Any], out: Path) -> list[Any]:
    """Reconstructions, the one with most photos first."""
    rung = order["rung"]
    out.mkdir(exist_ok=True)
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = 1  # threads add up bundle adjustment's sums in varying order: not the same result twice
    options.mapper.num_threads = 1
    options.random_seed = options.mapper.random_seed = options.triangulation.random_seed = order["seed"]
    options.extract_colors = False
    options.min_model_size = 3
    options.min_num_matches = rung["pair_inliers"]
    options.mapper.abs_pose_min_num_inliers = rung["pose_inliers"]
    options.mapper.init_min_num_inliers = rung["start_inliers"]
    options.mapper.init_min_tri_angle = rung["start_angle"]
    models = pycolmap.incremental_mapping(database, order["image_dir"], out, options)
    return sorted(models.values(), key=lambda m: -m.num_reg_images())


def _counts(pycolmap: Any, database: Path, images: list[str]) -> dict[str, np.ndarray]:
    """keypoints and pairs (V,) int."""
    opened = pycolmap.Database.open(str(database))
    ids = {image.name: image.image_id for image in opened.read_all_images()}
    keypoints = np.array([opened.num_keypoints_for_image(ids[n]) if n in ids else 0 for n in images])
    pairs = np.zeros(len(images), int)
    place = {image_id: images.index(name) for name, image_id in ids.items()}
    for pair, inliers in zip(*opened.read_two_view_geometry_num_inliers(), strict=True):
        if inliers > 0:
            for image_id in pycolmap.pair_id_to_image_pair(pair):
                pairs[place[image_id]] += 1
    opened.close()
    return {"keypoints": keypoints, "pairs": pairs}


def _arrays(models: list[Any], images: list[str]) -> dict[str, np.ndarray]:
    """The largest model as the arrays of _Attempt; empty arrays when there is none."""
    placed = {}
    if models:
        named = {models[0].image(i).name: models[0].image(i) for i in models[0].reg_image_ids()}
        placed = {images.index(name): image for name, image in sorted(named.items())}
    view = sorted(placed)
    column = {placed[v].image_id: c for c, v in enumerate(view)}
    K, distortion, cam_from_world = np.zeros((len(view), 3, 3)), np.zeros(len(view)), np.zeros((len(view), 4, 4))
    for c, v in enumerate(view):
        focal, cx, cy, distortion[c] = models[0].cameras[placed[v].camera_id].params
        K[c] = [[focal, 0, cx], [0, focal, cy], [0, 0, 1]]
        cam_from_world[c] = np.vstack([placed[v].cam_from_world().matrix(), [0, 0, 0, 1]])
    points = sorted(models[0].points3D.items()) if models else []
    tracks = np.zeros((len(points), len(view)), bool)
    for row, (_, point) in enumerate(points):
        tracks[row, [column[e.image_id] for e in point.track.elements if e.image_id in column]] = True
    return {
        "view": np.array(view, int),
        "K": K,
        "distortion": distortion,
        "cam_from_world": cam_from_world,
        "points": np.array([p.xyz for _, p in points]).reshape(-1, 3),
        "tracks": tracks,
        "models": np.array([m.num_reg_images() for m in models], int),
    }


if __name__ == "__main__":
    _child(Path(sys.argv[1]))
