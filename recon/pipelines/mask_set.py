"""A handful of masks of one object from unknown, unordered views: shape from the first, then a camera for each.

The first mask is taken as a single image. The camera of each other mask is searched with that shape held; then shape
and cameras move together until the outlines of all views agree. World frame: the canonical frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procmodels import Model
from procmodels.space import Params
from recon import scene
from recon.cameras import intrinsics
from recon.files import frames
from recon.files.frames import FramesOptions
from recon.files.mask_images import BadMask, read_mask
from recon.files.photo_folder import choose
from recon.fitting import one_view, quality, uncertainty
from recon.fitting.camera_search import find_all
from recon.fitting.one_view import OneView
from recon.fitting.refine import Refined
from recon.fitting.uncertainty import Certainty
from recon.geometry.view_geometry import guessed_K
from recon.masks import single_mask
from recon.outputs import write
from recon.outputs.result import Result
from recon.outputs.versions import versions
from recon.outputs.write import OutputPaths
from recon.pipelines import checks, class_selection, out_folder, single_view
from recon.pipelines.single_view import ImageOptions
from recon.pipelines.stages import LAST, Stages
from recon.scene import Cameras, Canonical, Frames, InputError, Poses, Silhouettes
from recon.store import dataclasses_of
from recon.system.folders import digest_of

STAGES = ("masks", "search", LAST)
FEWEST, MOST = 2, 8


@dataclass(frozen=True)
class MaskSet:
    """The masks with what is known of their lenses, and warnings."""

    shot: Frames
    views: tuple[OneView, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class JointAnswer:
    """Parameters of the class that explains the first mask best, and a camera about the shape for every mask.

    mean_iou over the views; alternatives and certainty as in Refined; classes as in single_view.Searched
    """

    class_name: str
    params: Params
    cameras: Cameras
    mean_iou: float
    alternatives: tuple[tuple[str, float], ...]
    certainty: Certainty
    classes: tuple[tuple[str, float], ...]


def run(folder: Path, out: Path, options: ImageOptions = ImageOptions()) -> OutputPaths:
    """Reconstruct the object in a folder of 2 to 8 masks (white = object) into the folder `out`. Raises InputError."""
    options.redo.check(STAGES)
    checks.check(options.height, out)
    models = checks.models(options.class_name)
    with out_folder.claimed(out, {"INPUT": folder}) as work:
        return _run(folder, out, work, models, options)


def _run(folder: Path, out: Path, work: Path, models: list[Model], options: ImageOptions) -> OutputPaths:
    """The stages, one after the other."""
    inputs = [digest_of(choose(folder).files, folder), options.intrinsics, options.focal_mm, options.seed]
    stages = Stages(work, STAGES, KNOWN, inputs, options.redo)
    masks = stages.run("masks", [], lambda: _read(folder, work, options))
    key = [options.search, *map(class_selection.key, models)]
    answer = stages.run("search", key, lambda: _searched(models, masks, options))
    model = next(m for m in models if m.name == answer.class_name)
    stages.last()
    return write.run(_result(model, masks, answer, stages.seconds, options), out, options.outputs, model)


def _read(folder: Path, work: Path, options: ImageOptions) -> MaskSet:
    """The masks of a folder. Raises InputError."""
    shot = frames.run(folder, work, FramesOptions(allow_single=True))
    if not FEWEST <= len(shot.names) <= MOST:
        raise InputError(
            f"{folder} holds {len(shot.names)} masks; {FEWEST} to {MOST} are taken without photos or cameras "
            "(one mask: give the file; more: photos with --masks)"
        )
    views, warnings = _views(folder, shot, options)
    return MaskSet(shot, tuple(views), tuple(warnings))


def _searched(models: list[Model], masks: MaskSet, options: ImageOptions) -> JointAnswer:
    """Class and shape from the first mask, then shape and cameras from all."""
    searched = single_view.search(models, masks.views[0], options)
    model = next(m for m in models if m.name == searched.class_name)
    found = find_all(model, masks.views, searched.found.refined.params, options.search)
    cameras = Cameras(masks.shot.names, found.K, found.cam_from_canonical, masks.shot.sizes)
    sure = found.alternatives, found.certainty
    return JointAnswer(model.name, found.params, cameras, found.mean_iou, *sure, searched.classes)


def _views(folder: Path, shot: Frames, options: ImageOptions) -> tuple[list[OneView], list[str]]:
    """The masks with what is known of their lenses, and warnings."""
    held = intrinsics.held(shot, options.intrinsics, options.focal_mm)
    views: list[OneView] = []
    warnings: list[str] = []
    for i, (name, size) in enumerate(zip(shot.names, shot.sizes, strict=True)):
        try:
            whole = int(size[0]), int(size[1])
            mask, known = read_mask(folder / name, whole), single_mask.told(folder / name, whole)
            mask, notes = single_mask.checked(mask, name, known)
        except BadMask as error:
            raise InputError(f"a mask cannot be used: {error}") from error
        warnings += notes
        K = guessed_K(int(size[0]), int(size[1]))
        if held is not None:
            K[(0, 1), (0, 1)], K[:2, 2] = held[i, :2], held[i, 2:]
        views.append(OneView(mask, K, held is not None, known=known))
    return views, warnings


def _result(
    model: Model, masks: MaskSet, answer: JointAnswer, seconds: dict[str, float], options: ImageOptions
) -> Result:
    """What the outputs need; the world is the canonical frame."""
    shot, views, n = masks.shot, masks.views, len(masks.views)
    poses = Poses(answer.cameras, shot.paths, np.zeros((0, 3)), np.zeros((0, n), bool))
    unknown = tuple(None if v.known is None else ~v.known for v in views)
    drawn = tuple(v.mask for v in views)
    silhouettes = Silhouettes(shot.names, drawn, ("user",) * n, np.ones(n, bool), unknown=unknown)
    place = Canonical(np.eye(4))
    refined = Refined(answer.params, place, answer.mean_iou, answer.mean_iou, answer.alternatives, answer.certainty)
    verdict = quality.run(model, poses, silhouettes, refined, n, "image")
    return Result(
        class_name=model.name,
        params=answer.params,
        frames=shot,
        poses=poses,
        silhouettes=silhouettes,
        canonical=refined.canonical,
        view_iou=verdict.view_iou,
        confidence=verdict.confidence,
        explanation=f"{n} outlines, mean agreement {verdict.mean_iou:.2f} (IoU), their cameras found with the shape",
        alternatives=answer.alternatives,
        seconds=seconds,
        warnings=(*masks.warnings, *verdict.warnings),
        seed=options.seed,
        height_m=options.height,
        versions=versions(),
        classes=answer.classes,
        certainty=verdict.certainty,
        belongs=verdict.belongs,
        views="masks",
        placed="estimated",
    )


KNOWN = (*dataclasses_of(scene, one_view, uncertainty), MaskSet, JointAnswer)  # what results are made of
