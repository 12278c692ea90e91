"""What the last stage writes down, put together in one place from what the stages found."""

from __future__ import annotations

from dataclasses import dataclass

from procmodels import Model
from procmodels.look import Look
from procmodels.space import Params
from recon.fitting.quality import Verdict
from recon.fitting.refine import Refined
from recon.fitting.shape_fit import ShapeFit
from recon.outputs.result import REGISTERED, Result, ShapeEvidence
from recon.outputs.versions import versions
from recon.scene import NO_FRAMES, Frames, Scene, unseen


@dataclass(frozen=True)
class About:
    """What a pipeline knows of a run beside the answer; the fields are those of Result.

    warnings  of all stages before the verdict
    """

    seconds: dict[str, float]
    seed: int
    height_m: float | None
    warnings: tuple[str, ...] = ()
    classes: tuple[tuple[str, float], ...] = ()
    views: str = "photos"
    placed: str = REGISTERED
    size_from: str = ""
    look: Look | None = None


def of_views(model: Model, frames: Frames, scene: Scene, refined: Refined, verdict: Verdict, about: About) -> Result:
    """The result of a refinement against the outlines of a scene."""
    where = scene.standing(refined.canonical)
    return _result(model, refined.params, frames, where, refined.alternatives, verdict, about, None)


def of_shape(model: Model, found: ShapeFit, met: ShapeEvidence, verdict: Verdict, about: About) -> Result:
    """The result of a fit to a shape, which no camera saw."""
    return _result(model, found.params, NO_FRAMES, unseen(found.canonical), (), verdict, about, met)


def _result(
    model: Model,
    params: Params,
    frames: Frames,
    scene: Scene,
    alternatives: tuple[tuple[str, float], ...],
    verdict: Verdict,
    about: About,
    met: ShapeEvidence | None,
) -> Result:
    return Result(
        class_name=model.name,
        params=params,
        frames=frames,
        scene=scene,
        view_iou=verdict.view_iou,
        confidence=verdict.confidence,
        explanation=verdict.explanation,
        alternatives=alternatives,
        seconds=about.seconds,
        warnings=(*about.warnings, *verdict.warnings),
        seed=about.seed,
        height_m=about.height_m,
        versions=versions(),
        classes=about.classes,
        certainty=verdict.certainty,
        shape=met,
        views=about.views,
        placed=about.placed,
        belongs=verdict.belongs,
        size_from=about.size_from,
        look=about.look,
    )
