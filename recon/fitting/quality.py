"""How good a result is: outline agreement per photo on the exact model, confidence, and words for people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels import Model
from procmodels.space import Params
from recon.fitting import beliefs, evidence
from recon.fitting.evidence import Evidence
from recon.fitting.refine import Refined
from recon.fitting.shape_fit import ShapeFit
from recon.fitting.uncertainty import Certainty
from recon.geometry.object_windows import object_crops
from recon.geometry.raster import iou, silhouettes
from recon.scene import Scene, Silhouettes, cam_from_canonical

EXPLAINED = 0.85  # mean IoU below which something about the outlines is not of this class, or the masks are wrong
FEW = 4  # views; what fewer of them show is believed like a single one
CLEAR = 0.02  # how much IoU the best front should be ahead of the next


@dataclass(frozen=True)
class Verdict:
    """view_iou (V,) with the masks of the photos; mean_iou over the used ones; confidence 0..1 and why.

    belongs    whether the object is taken for one of the class
    certainty  the result's, with the chances that may be stated; None where it has none
    evidence   what speaks for the result and against it
    """

    view_iou: np.ndarray
    mean_iou: float
    confidence: float
    explanation: str
    warnings: tuple[str, ...]
    belongs: bool
    certainty: Certainty | None
    evidence: Evidence


def run(model: Model, scene: Scene, refined: Refined, photos: int, kind: str = "masks") -> Verdict:
    """Judge a refined result; `photos` is how many were given, `kind` one of beliefs.KINDS."""
    scene, masks = scene.standing(refined.canonical), scene.silhouettes
    drawn = silhouettes(
        model.build(refined.params),
        scene.cameras.K,
        cam_from_canonical(scene.cameras, scene.canonical),
        scene.cameras.sizes,
    )
    view_iou = np.array([iou(d & masks.known(v), masks.masks[v]) for v, d in enumerate(drawn)])
    mean = float(view_iou[masks.used].mean())
    lead = refined.mean_iou - refined.next_front
    found = evidence_in(model, refined.params, scene)
    if masks.used.sum() < FEW:
        kind = "image"
    stated = beliefs.stated(refined.certainty, found, beliefs.table(model.space, kind))
    explanation = (
        f"outlines agree by {mean:.2f} (IoU), {int(masks.used.sum())} of {photos} photos used, "
        f"the front is ahead of the next best by {lead:.3f}"
    )
    said = beliefs.words(model.space.name, stated.confidence, found)
    return Verdict(
        view_iou,
        mean,
        stated.confidence,
        explanation,
        said + _warnings(model, mean, lead, view_iou, masks, bool(said)),
        stated.confidence >= beliefs.DENIED,
        stated.certainty,
        found,
    )


def of_shape(model: Model, found: ShapeFit, kind: str) -> Verdict:
    """Judge a fit to a shape; `kind` is one of beliefs.KINDS. There are no views."""
    stated = beliefs.stated(found.certainty, found.evidence, beliefs.table(model.space, kind))
    said = beliefs.words(model.space.name, stated.confidence, found.evidence)
    warnings = list(said)
    if said:
        warnings.append("a shape that lies on its side or faces another way is not recognised, either: --up, --front")
    if not found.network:
        warnings.append(f"there are no weights for {model.name}: the search began at random shapes alone")
    return Verdict(
        np.zeros(0),
        float("nan"),
        stated.confidence,
        f"the surfaces are {100 * np.sqrt(found.distance / 2):.1f} % of the longest side apart on average",
        tuple(warnings),
        stated.confidence >= beliefs.DENIED,
        stated.certainty,
        found.evidence,
    )


def evidence_in(model: Model, params: Params, scene: Scene) -> Evidence:
    """What some of the used views say of the shape that stands in the scene."""
    crops = object_crops(scene, evidence.WINDOW, evidence.VIEWS)
    return evidence.of_outlines(model.space, params, model.build(params), crops, scene.canonical)


def _warnings(
    model: Model, mean: float, lead: float, view_iou: np.ndarray, masks: Silhouettes, doubted: bool
) -> tuple[str, ...]:
    """`doubted`: it was said already that the class may be another."""
    out = []
    if mean < EXPLAINED and not doubted:
        out.append(
            f"the best {model.name} explains the outlines only to {mean:.2f}: the object has parts that the class "
            "lacks, or is of another class, or the masks are wrong (look at contact_sheet.png; give better masks with "
            "--masks). Parameters and their chances are those of the nearest shape that can be made"
        )
    if lead < CLEAR / 2:
        out.append("two sides of the object fit almost equally well: check which way it faces")
    low = [n for n, v, u in zip(masks.names, view_iou, masks.used, strict=True) if u and v < mean - 0.2]
    if low:
        out.append(f"these photos agree much less than the others: {', '.join(low)}")
    return tuple(out)
