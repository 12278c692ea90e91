"""One image of one object, or its mask alone, to a result; the camera is known or found with the shape."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from procmodels import Model
from procmodels import look as looks
from procmodels.look import Look
from recon import scene
from recon.appearance import photos as appearance
from recon.cameras import intrinsics
from recon.files.pix3d_camera import read_camera
from recon.fitting import camera_search, quality, refine, uncertainty
from recon.fitting.camera_search import FoundView
from recon.fitting.one_view import OneView
from recon.fitting.quality import Verdict
from recon.geometry.view_geometry import guessed_K
from recon.masks import single_mask
from recon.masks.single_mask import Masked
from recon.outputs import write as outputs
from recon.outputs.result import Result
from recon.outputs.write import OutputPaths
from recon.pipelines import checks, class_selection, out_folder, results, single_view
from recon.pipelines.results import About
from recon.pipelines.single_view import ImageOptions, Searched
from recon.pipelines.stages import LAST, Stages
from recon.scene import Cameras, Poses, Scene, Silhouettes
from recon.store import dataclasses_of
from recon.system.digests import digest_of_input

log = logging.getLogger("recon")
STAGES = ("mask", "search", "colours", LAST)
KNOWN = (
    scene,
    single_mask,
    camera_search,
    refine,
    uncertainty,
    single_view,
    appearance,
    looks,
)  # whose dataclasses are results
NEARLY = 0.02  # IoU: another camera this near explains the outline as well


def run(path: Path, out: Path, options: ImageOptions = ImageOptions()) -> OutputPaths:
    """Reconstruct the object in an image file, or from a mask file alone, into the folder `out`.

    Raises InputError (the user's input or options) or ReconstructionError (no result possible).
    """
    options.redo.check(STAGES)
    checks.check(options.height, out)
    models = checks.models(options.class_name)
    reads = {"INPUT": path, "--mask": options.mask, "--pix3d": options.pix3d}
    with out_folder.claimed(out, reads) as work:
        return _run(path, out, work, models, options)


def _run(path: Path, out: Path, work: Path, models: list[Model], options: ImageOptions) -> OutputPaths:
    """The stages, one after the other."""
    inputs = [digest_of_input(f) for f in (path, options.mask, options.pix3d)]
    stages = Stages(work, STAGES, dataclasses_of(*KNOWN), [inputs, options.seed], options.redo)
    masked = stages.run(
        "mask", [options.box], lambda: single_mask.run(path, work, options.mask, options.box, options.seed)
    )
    view = _view(path, masked, options)
    searched = stages.run(
        "search",
        [options.search, options.intrinsics, options.focal_mm, options.doubt, *map(class_selection.key, models)],
        lambda: single_view.search(models, view, options),
    )
    model = next(m for m in models if m.name == searched.class_name)
    seen = _scene(masked, searched)
    look = None
    if not _mask_alone(masked, options):  # there is nothing to take colours from
        shape = model.build(searched.found.refined.params)
        look = stages.run("colours", options.look, lambda: appearance.run(shape, seen, options.look)).look
    result = _result(model, masked, seen, view, searched, look, stages.seconds, options)
    stages.last()
    return outputs.run(result, out, options.outputs, model)


def _view(path: Path, masked: Masked, options: ImageOptions) -> OneView:
    """The mask with what is known of its camera: a record, intrinsics, EXIF's focal length, or nothing."""
    width, height = (int(v) for v in masked.frames.sizes[0])
    seen = OneView(masked.mask, guessed_K(width, height), known=masked.known)
    if options.pix3d is not None:
        original = masked.frames.original
        size = (width, height) if original is None else (int(original[0, 0]), int(original[0, 1]))
        camera = read_camera(options.pix3d, str(path), size)
        log.info("camera: from %s", options.pix3d.name)
        K, pose = camera.K_for(width, height), camera.cam_from_model
        return replace(seen, K=K, focal_known=True, cam_from_model=pose, doubt=options.doubt)
    held = intrinsics.held(masked.frames, options.intrinsics, options.focal_mm)
    if held is not None:
        fx, fy, cx, cy = held[0]
        log.info("camera: intrinsics known, place unknown")
        return replace(seen, K=np.array([(fx, 0, cx), (0, fy, cy), (0, 0, 1)], float), focal_known=True)
    focal = float(masked.frames.focal_px[0])
    if np.isfinite(focal):
        seen.K[(0, 1), (0, 1)] = focal
        log.info("camera: focal length from EXIF, place unknown")
        return replace(seen, focal_known=True)
    log.info("camera: unknown")
    return seen


def _mask_alone(masked: Masked, options: ImageOptions) -> bool:
    """Whether the input is a mask without its picture."""
    return masked.source == "user" and options.mask is None


def _scene(masked: Masked, searched: Searched) -> Scene:
    """The object before its one camera; the world is the camera's frame, or a record's."""
    found, name = searched.found, masked.frames.names
    cameras = Cameras(name, found.K[None], found.cam_from_world[None], masked.frames.sizes)
    poses = Poses(cameras, masked.frames.paths, np.zeros((0, 3)), np.zeros((0, 1), bool))
    unknown = () if masked.known is None else (~masked.known,)
    silhouettes = Silhouettes(name, (masked.mask,), (masked.source,), np.ones(1, bool), unknown=unknown)
    return Scene(poses, silhouettes, found.refined.canonical)


def _result(
    model: Model,
    masked: Masked,
    seen: Scene,
    view: OneView,
    searched: Searched,
    look: Look | None,
    seconds: dict[str, float],
    options: ImageOptions,
) -> Result:
    """What the outputs need."""
    found = searched.found
    verdict = _judged(quality.run(model, seen, found.refined, 1, "image"), view, found)
    about = About(
        seconds,
        options.seed,
        options.height,
        warnings=masked.warnings,
        classes=searched.classes,
        views="masks" if _mask_alone(masked, options) else "images",
        placed="estimated" if view.cam_from_model is None else "given",
        look=look,
    )
    return results.of_views(model, masked.frames, seen, found.refined, verdict, about)


def _judged(verdict: Verdict, view: OneView, found: FoundView) -> Verdict:
    """The verdict in the words of one image."""
    where = f"azimuth {found.azimuth:.0f}, elevation {found.elevation:.0f} degrees"
    if view.cam_from_model is not None:
        return replace(verdict, explanation=f"one outline, agreement {verdict.mean_iou:.2f} (IoU), camera given")
    fov = np.degrees(2 * np.arctan(max(view.mask.shape) / 2 / found.K[0, 0]))
    lens = "focal length given" if view.focal_known else f"field of view {fov:.0f} degrees, a guess"
    rivals = [n for n, s in found.refined.alternatives if "turned by" in n and s > found.refined.mean_iou - NEARLY]
    text = f"one outline, agreement {verdict.mean_iou:.2f} (IoU), camera found with the shape: {where}, {lens}"
    if rivals:
        text += f"; {len(rivals)} other cameras explain the outline nearly as well"
    return replace(verdict, explanation=text)
