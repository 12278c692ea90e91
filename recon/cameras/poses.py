"""Stage 2: where every photo was taken from, by structure from motion, and the undistorted photos that go with it.

pycolmap runs in a child process, `python -m recon.cameras.poses REQUEST.json`: imported before cv2 or PIL it breaks
their PNG writing (double free in zlib), and a crash of its native code must not take the command down. The child's
answer is REQUEST.npz.
"""

from __future__ import annotations

import json
import logging
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from recon.cameras import sfm_diagnosis, sheet_matches, sheet_start
from recon.cameras.intrinsics import held
from recon.cameras.sfm_attempts import climb
from recon.cameras.sfm_options import BY_SHEET, LADDER, Attempt, PosesOptions
from recon.geometry.undistort import undistorted
from recon.scene import Cameras, Frames, InputError, Lens, Observations, Poses, ReconstructionError
from recon.system import scratch
from recon.system.whole_files import write_picture

log = logging.getLogger("recon.cameras.poses")

# As working copies are written: without loss of colour's resolution.
JPEG = (cv2.IMWRITE_JPEG_QUALITY, 95, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)


def run(frames: Frames, workdir: Path, options: PosesOptions = PosesOptions(), searched: Frames | None = None) -> Poses:
    """Place the photos; undistorted photos go to `workdir`/undistorted, logs to `workdir`/poses.

    searched  the same photos as they are searched for features, when not as they are (recon.cameras.turntable)
    Climbs LADDER until enough photos are placed and keeps the best attempt. Raises ReconstructionError, which says how
    many were placed, the likely cause and what to do, when fewer than the options ask for could be placed.
    """
    if options.matching not in ("auto", "exhaustive", "sequential"):
        raise InputError(f"matching must be auto, exhaustive or sequential, not {options.matching!r}")
    total = len(frames.names)
    if total < 3:
        raise ReconstructionError(f"{total} photos are too few to place cameras; {sfm_diagnosis.REMEDY}")
    if searched is not None:  # what the photos show beside the object does not turn with it
        searched = replace(searched, sheets=None)
    if (given := held(frames, options.intrinsics, options.focal_mm)) is not None:
        frames = replace(frames, focal_px=given[:, 0])
        searched = replace(searched, focal_px=given[:, 0]) if searched else None
    logs = scratch.fresh(workdir / "poses")
    with scratch.folder(workdir) as folder:
        best, rung, tried, failures = climb(searched or frames, folder, logs, options)
    if best is None:
        raise ReconstructionError("structure from motion stopped with an error: " + "; ".join(failures))
    diagnosis = sfm_diagnosis.explain(frames, best.registered, best.keypoints, best.pairs, best.models)
    if len(best.view) < _needed(total, options):
        raise ReconstructionError(
            f"only {len(best.view)} of {total} photos could be placed, at least {_needed(total, options)} are needed. "
            f"{diagnosis} {sfm_diagnosis.REMEDY}"
        )
    warnings = [diagnosis] if len(best.view) < total else []
    if rung not in (LADDER[0].name, BY_SHEET.name):
        warnings.append(f'the photos were hard to place: {len(best.view)} of {total} with "{rung}"')
    warnings += sfm_diagnosis.focal_warnings(frames, best.view, best.K)
    if rung != BY_SHEET.name:  # which is certain
        warnings += sfm_diagnosis.other_ways(best, tried)
    for warning in warnings:
        log.warning(warning)
    return _poses(frames, best, workdir / "undistorted", tuple(warnings))


def _needed(total: int, options: PosesOptions) -> int:
    return max(3, min(options.min_registered, total), int(np.ceil(options.min_fraction * total)))


def _poses(frames: Frames, found: Attempt, out: Path, warnings: tuple[str, ...]) -> Poses:
    """Write undistorted photos of the same size and the same K, and put the stage's result together."""
    scratch.fresh(out)
    paths, lenses = [], []
    for i, k, distortion in zip(found.view, found.K, found.distortion, strict=True):
        params = np.array([k[0, 0], k[0, 2], k[1, 2], distortion])
        lenses.append(Lens("SIMPLE_RADIAL", params, frames.sizes[i]) if distortion else None)
        photo = cv2.imread(str(frames.paths[i]), cv2.IMREAD_COLOR)
        if photo is None:
            raise InputError(f"the working copy {frames.paths[i]} is gone; run again with --force")
        path = out / frames.paths[i].name
        write_picture(path, undistorted(photo, k, lenses[-1]), *JPEG)
        paths.append(path)
    cameras = Cameras(
        tuple(frames.names[i] for i in found.view), found.K, found.cam_from_world, frames.sizes[found.view]
    )
    missing = tuple(name for name, ok in zip(frames.names, found.registered, strict=True) if not ok)
    measured = Observations(found.seen[:, 0], found.seen[:, 1], found.pixels)
    return Poses(cameras, tuple(paths), found.points, found.tracks, missing, warnings, tuple(lenses), measured)


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
    if order["rung"]["sheet"]:
        _say("adding the corners of printed sheets")
        verification = _verification(pycolmap, order)
        database = sheet_matches.joined(pycolmap, database, order, request.with_suffix(".pairs.txt"), verification)
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
        reader.camera_model = group["model"]
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
    verification = _verification(pycolmap, order)
    pycolmap.match_image_pairs(database, matching, pairing, verification, pycolmap.Device.cpu)


def _verification(pycolmap: Any, order: dict[str, Any]) -> Any:
    """How matches of a pair are told to be of one geometry."""
    verification = pycolmap.TwoViewGeometryOptions()
    verification.min_num_inliers = order["rung"]["pair_inliers"]
    verification.ransac.random_seed = order["seed"]
    verification.ransac.max_error = order["pair_error"]
    # Pairs without overlap use up every trial: 10,000 (the default) takes twice the time and gains no pair.
    verification.ransac.max_num_trials = 1000
    return verification


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
    # All cameras are adjusted together when the model has grown by so much; 1.1, the default, takes half as long again
    # and moves none of them by a ten thousandth.
    options.ba_global_frames_ratio = options.ba_global_points_ratio = 1.3
    options.ba_refine_focal_length = not (rung["keep_focal"] or order.get("sheet_hold", False))
    begun = out.with_suffix(".begun")
    if rung["sheet"] and not sheet_start.model(pycolmap, database, order, options, begun):
        return []
    begin = str(begun) if rung["sheet"] else ""
    models = pycolmap.incremental_mapping(database, order["image_dir"], out, options, input_path=begin)
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
    """The largest model as the arrays of Attempt; empty arrays when there is none."""
    placed = {}
    if models:
        named = {models[0].image(i).name: models[0].image(i) for i in models[0].reg_image_ids()}
        placed = {images.index(name): image for name, image in sorted(named.items())}
    view = sorted(placed)
    column = {placed[v].image_id: c for c, v in enumerate(view)}
    K, distortion, cam_from_world = np.zeros((len(view), 3, 3)), np.zeros(len(view)), np.zeros((len(view), 4, 4))
    for c, v in enumerate(view):
        camera = models[0].cameras[placed[v].camera_id]
        K[c] = camera.calibration_matrix()
        distortion[c] = camera.params[3] if camera.model.name == "SIMPLE_RADIAL" else 0.0
        cam_from_world[c] = np.vstack([placed[v].cam_from_world().matrix(), [0, 0, 0, 1]])
    points = sorted(models[0].points3D.items()) if models else []
    tracks = np.zeros((len(points), len(view)), bool)
    for row, (_, point) in enumerate(points):
        tracks[row, [column[e.image_id] for e in point.track.elements if e.image_id in column]] = True
    row_of = {number: row for row, (number, _) in enumerate(points)}
    seen, pixels = [np.zeros((0, 2), int)], [np.zeros((0, 2))]
    for c, v in enumerate(view):
        measured = [p for p in placed[v].points2D if p.has_point3D()]
        seen.append(np.array([(c, row_of[p.point3D_id]) for p in measured], int).reshape(-1, 2))
        raw = np.array([p.xy for p in measured], float).reshape(-1, 2)
        rays = np.asarray(models[0].cameras[placed[v].camera_id].cam_from_img(raw), float).reshape(-1, 2)
        pixels.append(np.column_stack([rays, np.ones(len(rays))]) @ K[c, :2].T)
    return {
        "view": np.array(view, int),
        "K": K,
        "distortion": distortion,
        "cam_from_world": cam_from_world,
        "points": np.array([p.xyz for _, p in points]).reshape(-1, 3),
        "tracks": tracks,
        "models": np.array([m.num_reg_images() for m in models], int),
        "seen": np.concatenate(seen),
        "pixels": np.concatenate(pixels),
    }


if __name__ == "__main__":
    _child(Path(sys.argv[1]))
