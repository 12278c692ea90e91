"""All that a run found out, as the outputs need it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from procmodels.look import Look
from procmodels.space import Params
from recon.fitting.uncertainty import Certainty
from recon.scene import Frames, Scene


@dataclass(frozen=True)
class ShapeEvidence:
    """What a result was fitted to when the input was a shape instead of views.

    kind, what    of the input ("mesh", "a mesh of 372 faces")
    stands        which of the file's axes point up and to the front, in words
    distance      D_chamfer between the result where it stands and the input's points, canonical units squared
    points        (n, 3) float, the input's surface points in the result's canonical frame
    alternatives  (words, distance) of runners-up, best first
    """

    kind: str
    what: str
    stands: str
    distance: float
    points: np.ndarray
    alternatives: tuple[tuple[str, float], ...] = ()


REGISTERED = "registered"  # by structure from motion


@dataclass(frozen=True)
class Result:
    """Everything that the last stage writes down.

    class_name    the procedural model's name, params its values
    scene         the views, their silhouettes, and where the result stands; no views when the input was a shape
    view_iou      (V,) float, agreement of the re-rendered outline with the mask in every registered view
    confidence    0..1, with its explanation in words
    alternatives  (description, mean IoU) of runners-up, best first
    seconds       per stage
    height_m      real height of the object in metres, None when it is not known
    versions      of the packages that made it
    classes       (name, mean IoU) of every class tried, best first; empty when the class was named
    certainty     how sure each parameter is, None where that is not measured
    shape         what was met when the input was a shape; there are no views then
    views         what the views are, in the plural: "photos", "images", "masks", "views of the splat"
    placed        how they got their cameras: REGISTERED, "given" or "estimated"
    size_from     what the height is known from: "--height", "printed sheet", or "" where that goes without saying
    belongs       False when the object is taken to be none of the class; the result is then the nearest one
    look          colours and texture of the result's parts, None when there are none
    """

    class_name: str
    params: Params
    frames: Frames
    scene: Scene
    view_iou: np.ndarray
    confidence: float
    explanation: str
    alternatives: tuple[tuple[str, float], ...]
    seconds: dict[str, float]
    warnings: tuple[str, ...]
    seed: int
    height_m: float | None
    versions: dict[str, str]
    classes: tuple[tuple[str, float], ...] = ()
    certainty: Certainty | None = None
    shape: ShapeEvidence | None = None
    views: str = "photos"
    placed: str = REGISTERED
    belongs: bool = True
    size_from: str = ""
    look: Look | None = None

    def __post_init__(self) -> None:
        n = len(self.scene.cameras)
        if self.view_iou.shape != (n,):
            raise ValueError(f"view_iou must be ({n},), got {self.view_iou.shape}")


def seen(result: Result) -> str:
    """The views and their cameras in words, as in "26 of 28 photos registered" or "one image, camera estimated"."""
    n, of = in_place(result), len(result.frames.names)
    if result.placed == REGISTERED:
        return f"{n} of {counted(result)} {REGISTERED}"
    some = "" if n == of else f"{n} of "
    return f"{some}{counted(result)}, camera{'s' * (of > 1)} {result.placed}"


def in_place(result: Result) -> int:
    """How many views have a camera, those left out that were found to stand in the wrong place."""
    return len(result.scene.cameras) - len(result.scene.silhouettes.misplaced)


def counted(result: Result) -> str:
    """How many views were given, in words: "one image", "28 photos"."""
    of = len(result.frames.names)
    return f"one {result.views.removesuffix('s')}" if of == 1 else f"{of} {result.views}"


def tried(classes: tuple[tuple[str, float], ...]) -> str:
    """The classes in words, as in "tried 2 classes: chair 0.91, table 0.62"."""
    noun = "class" if len(classes) == 1 else "classes"
    return f"tried {len(classes)} {noun}: " + ", ".join(f"{name} {iou:.2f}" for name, iou in classes)


def about_size(result: Result) -> dict[str, Any]:
    """For report.json: the real height with what it is known from, and the printed sheets that were found."""
    sheets = [
        {
            "name": s.name,
            "views": list(s.names),
            "error_px": round(s.error, 3),
            "metres_per_sfm_unit": s.metres_per_unit,
        }
        for s in result.scene.poses.sheets
    ]
    return {"height_metres": result.height_m, "from": result.size_from, "sheets": sheets}
