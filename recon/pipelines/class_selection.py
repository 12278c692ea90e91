"""--class auto: fit every class that has weights, carry the best through, and say what each class can explain.

Every class gets a short fit and one short polish; the best few then get what they would get had they been named: the
full fit and the full refinement. The class whose outlines agree best with the masks (mean IoU) wins.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from nnproc import infer
from procmodels import Model
from recon.fitting import refine, view_starts
from recon.fitting.refine import Refined, RefineOptions
from recon.fitting.view_starts import FitOptions, FitResult
from recon.geometry.visual_hull import Hull
from recon.pipelines import checks
from recon.scene import Canonical, InputError, Poses, Silhouettes
from recon.system.digests import file_digest

log = logging.getLogger("recon")

RunStage = Callable[[str, Any, Callable[[], Any]], Any]  # (stage's name, its options, what computes it) -> its result


@dataclass(frozen=True)
class AutoOptions:
    """How much the first round may cost, and what counts as a tie."""

    random: int = 48  # of the short fit, see recon.fitting.view_starts.FitOptions
    kept: int = 1
    finalists: int = 2  # classes that get the full fit and refinement
    tie: float = 0.01  # IoU: a smaller lead decides nothing


@dataclass(frozen=True)
class FirstRound:
    """Mean IoU of every class after its short fit, best first, and the full fits of the best few in that order."""

    scores: tuple[tuple[str, float], ...]
    fits: tuple[FitResult, ...]


@dataclass(frozen=True)
class Finals:
    """The finalists' refined results, in the order of the first round."""

    refined: tuple[Refined, ...]


@dataclass(frozen=True)
class Chosen:
    """The model that explains the photos and its refined result.

    classes   (name, mean IoU) of every class tried, best first; empty when the class was named
    warnings  for the report
    """

    model: Model
    refined: Refined
    classes: tuple[tuple[str, float], ...] = ()
    warnings: tuple[str, ...] = ()


def known_models() -> list[Model]:
    """The models whose weights can be used. Raises InputError when there are none."""
    models = []
    for model in checks.models(checks.AUTO):
        try:
            infer.load_network(model.space, model.weights)
            models.append(model)
        except infer.WeightsError as error:
            log.warning("%s is not tried: %s", model.name, error)
    if not models:
        raise InputError("--class auto: no class has usable weights; train some with python -m nnproc.train CLASS")
    return models


def key(model: Model) -> list[str]:
    """What a fit of this class depends on beside photos and options: the space, the source of `build`, the weights."""
    weights = file_digest(model.weights) if model.weights.is_file() else "none"
    return [model.name, model.space.hash, model.code, weights]


def run(
    stage: RunStage,
    models: list[Model],
    scene: tuple[Poses, Silhouettes, Canonical],
    hull: Hull,
    fit_options: FitOptions,
    refine_options: RefineOptions,
    options: AutoOptions = AutoOptions(),
) -> Chosen:
    """The class that explains the silhouettes best, through the stages "fit" and "refine"."""
    by_name = {m.name: m for m in models}
    first: FirstRound = stage(
        "fit",
        [fit_options, refine_options, options, *map(key, models)],
        lambda: first_round(models, scene, hull, fit_options, refine_options, options),
    )
    finalists = [by_name[name] for name, _ in first.scores[: len(first.fits)]]

    def finals() -> Finals:
        pairs = zip(finalists, first.fits, strict=True)
        return Finals(tuple(refine.run(model, *scene, fitted, refine_options) for model, fitted in pairs))

    final: Finals = stage("refine", [refine_options, options], finals)
    return choose(finalists, final, first, options)


def first_round(
    models: list[Model],
    scene: tuple[Poses, Silhouettes, Canonical],
    hull: Hull,
    fit_options: FitOptions,
    refine_options: RefineOptions,
    options: AutoOptions,
) -> FirstRound:
    """Short fits of all models, full fits of the best few."""
    short = replace(fit_options, random=options.random, kept=options.kept, latent=None)
    scored = []
    for model in models:
        fitted = view_starts.run(model, *scene, hull, short)
        score = refine.quick_iou(model, *scene, fitted, refine_options)
        log.info("  %s: outlines agree by %.2f after a short fit", model.name, score)
        scored.append((score, model))
    scored.sort(key=lambda pair: -pair[0])
    fits = [view_starts.run(model, *scene, hull, fit_options) for _, model in scored[: options.finalists]]
    return FirstRound(tuple((model.name, score) for score, model in scored), tuple(fits))


def choose(finalists: list[Model], final: Finals, first: FirstRound, options: AutoOptions) -> Chosen:
    """The finalist of the highest IoU; the classes that went no further follow with that of their short fit."""
    ranked = sorted(zip(finalists, final.refined, strict=True), key=lambda pair: -pair[1].evidence)
    model, refined = ranked[0]
    others = [(m.name, r.evidence) for m, r in ranked[1:]] + list(first.scores[len(finalists) :])
    classes = [(model.name, refined.evidence), *sorted(others, key=lambda pair: -pair[1])]
    tied = [name for name, iou in classes[1:] if iou > classes[0][1] - options.tie]
    warnings = []
    if tied:
        warnings.append(
            f"{' and '.join([model.name, *tied])} explain the outlines almost equally well: "
            "look at the result, and name the right one with --class"
        )
    return Chosen(model, refined, tuple(classes), tuple(warnings))
