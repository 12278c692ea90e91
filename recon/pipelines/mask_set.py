"""A handful of masks of one object from unknown, unordered views: shape from the first, then a camera for each.

The first mask is taken as a single image. The camera of each other mask is searched with that shape held; then shape
and cameras take turns until the outlines of all views agree. World frame: the canonical frame.
"""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from procmodels import Model
from procmodels.space import Params
from recon.cameras import intrinsics
from recon.files import frames
from recon.files.frames import FramesOptions
from recon.files.mask_images import BadMask, read_mask
from recon.fitting import quality
from recon.fitting.refine import Refined
from recon.fitting.silhouette_bank import shape_bank
from recon.fitting.view_search import CameraSearchOptions, OneView, View, ViewSearch
from recon.geometry.view_geometry import guessed_K
from recon.masks import single_mask
from recon.outputs import write
from recon.outputs.result import Result
from recon.outputs.versions import versions
from recon.outputs.write import OutputPaths
from recon.pipelines import checks, out_folder, single_view
from recon.pipelines.single_view import ImageOptions
from recon.scene import Cameras, Canonical, Frames, InputError, Poses, Silhouettes
from recon.system import scratch

log = logging.getLogger("recon")
FEWEST, MOST = 2, 8
ROUNDS = 2  # of shape, then cameras
EVALUATIONS = 60  # of the mean IoU, a round


def run(folder: Path, out: Path, options: ImageOptions = ImageOptions()) -> OutputPaths:
    """Reconstruct the object in a folder of 2 to 8 masks (white = object) into the folder `out`. Raises InputError."""
    checks.check(options.height, out)
    models = checks.models(options.class_name)
    with out_folder.claimed(out, {"INPUT": folder}) as work, scratch.folder(work) as own:
        return _run(folder, out, own, models, options)


def _run(folder: Path, out: Path, work: Path, models: list[Model], options: ImageOptions) -> OutputPaths:
    """The stages, one after the other."""
    started = time.monotonic()
    shot = frames.run(folder, work, FramesOptions(allow_single=True))
    if not FEWEST <= len(shot.names) <= MOST:
        raise InputError(
            f"{folder} holds {len(shot.names)} masks; {FEWEST} to {MOST} are taken without photos or cameras "
            "(one mask: give the file; more: photos with --masks)"
        )
    views, warnings = _views(folder, shot, options)
    seconds = {"masks": round(time.monotonic() - started, 2)}
    started = time.monotonic()
    searched = single_view.search(models, views[0], options)
    joint = Joint(searched.model, views, searched.found.refined.params, options.search)
    for _ in range(ROUNDS):
        joint.improve_shape()
        joint.improve_cameras()
    seconds["search"] = round(time.monotonic() - started, 2)
    result = _result(joint, shot, warnings, seconds, options)
    result = replace(result, classes=searched.classes)
    return write.run(result, out, options.outputs, searched.model)


class Joint:
    """One shape, a camera for each mask."""

    def __init__(self, model: Model, views: list[OneView], params: Params, options: CameraSearchOptions) -> None:
        self.model, self.params = model, params
        self.jobs = [ViewSearch(model, v, options) for v in views]
        self.states: list[View] = []
        bank = shape_bank(model, params, options.bank)
        for job in self.jobs:
            job.free[: len(model.space.scalars)] = 0  # the shape is held
            polished = [job.climbed(job.polish(s)) for s in job.starts(bank, options.starts // 2)]
            self.states.append(max(polished, key=job.iou))

    def with_params(self, params: Params) -> list[View]:
        """The states with another shape in the same places."""
        scalars, discrete = self.model.space.scalars, self.model.space.discrete
        units = np.array([s.unit_from_value(float(params[s.name])) for s in scalars])
        return [replace(s, units=units, discrete={p.name: params[p.name] for p in discrete}) for s in self.states]

    def iou(self, params: Params) -> float:
        """Mean IoU over the views."""
        pairs = zip(self.jobs, self.with_params(params), strict=True)
        return float(np.mean([job.agreement(state) for job, state in pairs]))

    def improve_shape(self) -> None:
        """One discrete change at a time while it helps, then the scalars, with the cameras held."""
        for p in self.model.space.discrete:
            options = [{**self.params, p.name: p.grid_value(i)} for i in range(p.grid_steps)]
            self.params = max([self.params, *options], key=self.iou)
        scalars = self.model.space.scalars
        start = np.array([s.unit_from_value(float(self.params[s.name])) for s in scalars])

        def params(units: np.ndarray) -> Params:
            values = {s.name: s.value_from_unit(float(u)) for s, u in zip(scalars, np.clip(units, 0, 1), strict=True)}
            return self.model.space.validate({**self.params, **values})

        if len(scalars):
            simplex = np.vstack([start, start + np.diag(np.where(start > 0.8, -0.1, 0.1))])
            settings = {"maxfev": EVALUATIONS, "initial_simplex": simplex}
            found = minimize(lambda x: -self.iou(params(x)), start, method="Nelder-Mead", options=settings)
            self.params = max((params(found.x), self.params), key=self.iou)
        self.states = self.with_params(self.params)

    def improve_cameras(self) -> None:
        """Each camera by itself, with the shape held."""
        self.states = [j.climbed(j.polish(s)) for j, s in zip(self.jobs, self.states, strict=True)]

    def cameras(self, shot: Frames) -> Cameras:
        """The cameras about the canonical frame."""
        pairs = list(zip(self.jobs, self.states, strict=True))
        K = np.stack([job.view.K for job, _ in pairs])
        K[:, (0, 1), (0, 1)] *= np.array([s.zoom for s in self.states])[:, None]
        return Cameras(shot.names, K, np.stack([job.pose(state) for job, state in pairs]), shot.sizes)


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
    joint: Joint, shot: Frames, warnings: list[str], seconds: dict[str, float], options: ImageOptions
) -> Result:
    cameras, n = joint.cameras(shot), len(shot.names)
    poses = Poses(cameras, shot.paths, np.zeros((0, 3)), np.zeros((0, n), bool))
    masks = tuple(job.view.mask for job in joint.jobs)
    unknown = tuple(None if job.view.known is None else ~job.view.known for job in joint.jobs)
    silhouettes = Silhouettes(shot.names, masks, ("user",) * n, np.ones(n, bool), unknown=unknown)
    score = joint.iou(joint.params)
    refined = Refined(joint.params, Canonical(np.eye(4)), score, score, ())
    verdict = quality.run(joint.model, poses, silhouettes, refined, n)
    return Result(
        class_name=joint.model.name,
        params=joint.params,
        frames=shot,
        poses=poses,
        silhouettes=silhouettes,
        canonical=refined.canonical,
        view_iou=verdict.view_iou,
        confidence=verdict.confidence * 0.8,
        explanation=f"{n} outlines, mean agreement {verdict.mean_iou:.2f} (IoU), their cameras found with the shape",
        alternatives=(),
        seconds=seconds,
        warnings=(*warnings, *verdict.warnings),
        seed=options.seed,
        height_m=options.height,
        versions=versions(),
        views="masks",
        placed="estimated",
    )
