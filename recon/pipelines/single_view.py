"""One outline to a shape and a camera: of the class asked for, or of the best of several."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from procmodels import Model
from recon.appearance.photos import LookOptions
from recon.fitting.camera_search import FoundView, find, first_look
from recon.fitting.one_view import CameraSearchOptions, OneView
from recon.fitting.silhouette_bank import load_bank
from recon.outputs.write import OutputsOptions
from recon.pipelines.stages import Redo

FINALISTS = 2  # classes that are searched in full when none was named


@dataclass(frozen=True)
class ImageOptions:
    """What the user asked for."""

    class_name: str = "chair"  # a model of procmodels, the path of a model's .py file, or "auto"
    mask: Path | None = None  # white = object
    box: tuple[float, float, float, float] | None = None  # x, y, w, h in pixels of the upright image
    pix3d: Path | None = None  # Pix3D's pix3d.json: the camera is in the image's record
    doubt: float = 0.0  # degrees by which that camera may be turned; it is then found with the shape
    intrinsics: tuple[float, float, float, float] | None = None  # fx, fy, cx, cy in pixels of the original
    focal_mm: tuple[float, float] | None = None  # focal length and sensor width in mm
    height: float | None = None  # real height of the object in metres
    seed: int = 0
    redo: Redo = field(default_factory=Redo)
    search: CameraSearchOptions = field(default_factory=CameraSearchOptions)
    look: LookOptions = field(default_factory=LookOptions)
    outputs: OutputsOptions = field(default_factory=OutputsOptions)


@dataclass(frozen=True)
class Searched:
    """The class that explains the image best, its answer, and every class with its IoU when all were tried."""

    class_name: str
    found: FoundView
    classes: tuple[tuple[str, float], ...] = ()


def search(models: list[Model], view: OneView, options: ImageOptions = ImageOptions()) -> Searched:
    """The answer of the one model, or of the best of several: a short search of each, a full one of the best few."""
    banks = {m.name: load_bank(m, options.search.bank, options.seed) for m in models}
    if len(models) == 1:
        return Searched(models[0].name, find(models[0], view, banks[models[0].name], options.search))
    scores = {m.name: first_look(m, view, banks[m.name], options.search) for m in models}
    finalists = sorted(models, key=lambda m: -scores[m.name])[:FINALISTS]
    answers = [(m, find(m, view, banks[m.name], options.search)) for m in finalists]
    scores |= {m.name: f.refined.mean_iou for m, f in answers}
    model, found = max(answers, key=lambda a: a[1].refined.mean_iou)
    return Searched(model.name, found, tuple(sorted(scores.items(), key=lambda s: -s[1])))
