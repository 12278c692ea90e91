"""From a mesh, point cloud, splat or voxel grid to the same outputs as from photos."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from procmodels import Model
from procmodels import look as looks
from procmodels.look import Look
from recon import scene
from recon.appearance import photos as appearance
from recon.appearance import shapes as colours
from recon.appearance.photos import LookOptions
from recon.files.recognise import Recognised
from recon.fitting import evidence, quality, shape_fit, uncertainty
from recon.outputs import write as outputs
from recon.outputs.result import Result, ShapeEvidence
from recon.outputs.write import OutputPaths
from recon.pipelines import checks, class_selection, out_folder, results
from recon.pipelines.results import About
from recon.pipelines.stages import LAST, Redo, Stages
from recon.scene import InputError
from recon.shapes import shape_target
from recon.shapes.shape_target import ShapeOptions
from recon.store import dataclasses_of
from recon.system.digests import digest_of_input

log = logging.getLogger("recon")
STAGES = ("shape", "fit", "colours", LAST)
KNOWN = (scene, shape_target, shape_fit, evidence, uncertainty, appearance, looks)  # whose dataclasses are results


@dataclass(frozen=True)
class ShapeRunOptions:
    """What the user asked for, and the options of the stages."""

    class_name: str = "chair"  # a model of procmodels, the path of a model's .py file, or "auto"
    height: float | None = None  # real height of the object in metres
    seed: int = 0
    redo: Redo = field(default_factory=Redo)
    shape: ShapeOptions = field(default_factory=ShapeOptions)
    fit: shape_fit.ShapeFitOptions = field(default_factory=shape_fit.ShapeFitOptions)
    look: LookOptions = field(default_factory=LookOptions)
    outputs: outputs.OutputsOptions = field(default_factory=outputs.OutputsOptions)


def run(path: Path, out: Path, seen: Recognised, options: ShapeRunOptions = ShapeRunOptions()) -> OutputPaths:
    """Fit the procedural model to a shape. Raises InputError."""
    if path.is_dir():
        raise InputError(f"{path} is a folder; give the file of the shape itself")
    options.redo.check(STAGES)
    checks.check(options.height, out)
    models = checks.models(options.class_name)
    options = replace(
        options, shape=replace(options.shape, seed=options.seed), fit=replace(options.fit, seed=options.seed)
    )
    with out_folder.claimed(out, {"INPUT": path}) as work:
        return _run(path, out, work, seen, models, options)


def _run(
    path: Path, out: Path, work: Path, seen: Recognised, models: list[Model], options: ShapeRunOptions
) -> OutputPaths:
    """The stages, one after the other."""
    inputs = [digest_of_input(path), seen.kind, options.seed]
    stages = Stages(work, STAGES, dataclasses_of(*KNOWN), inputs, options.redo)
    target = stages.run("shape", options.shape, lambda: shape_target.run(path, seen.kind, seen.what, options.shape))
    fits = stages.run(
        "fit",
        [options.fit, *map(class_selection.key, models)],
        lambda: {model.name: shape_fit.run(model, target, options.fit) for model in models},
    )
    best = min(models, key=lambda m: fits[m.name].distance)
    found, shape = fits[best.name], best.build(fits[best.name].params)
    coloured = stages.run(
        "colours", options.look, lambda: colours.run(path, target.points, shape, found.canonical, options.look)
    )
    result = _result(target, best, fits, coloured.look, stages.seconds, options)
    stages.last()
    return outputs.run(result, out, options.outputs, best)


def _result(
    target: shape_target.Target,
    model: Model,
    fits: dict[str, shape_fit.ShapeFit],
    look: Look | None,
    seconds: dict[str, float],
    options: ShapeRunOptions,
) -> Result:
    """The outputs' result, without any views."""
    found = fits[model.name]
    forward = np.linalg.inv(found.canonical.world_from_canonical)
    points = target.points @ forward[:3, :3].T + forward[:3, 3]
    met = ShapeEvidence(target.kind, target.what, found.hypothesis, found.distance, points, found.alternatives)
    verdict = quality.of_shape(model, found, shape_fit.kind_of(target))
    if len(fits) > 1:
        ranked = sorted(fits.items(), key=lambda pair: pair[1].distance)
        tried = ", ".join(f"{name} {fit.distance:.4f}" for name, fit in ranked)
        verdict = replace(verdict, explanation=f"{verdict.explanation}; tried {tried}")
    about = About(seconds, options.seed, options.height, target.warnings, look=look)
    return results.of_shape(model, found, met, verdict, about)
