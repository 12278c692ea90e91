"""How good a result is: outline agreement per photo on the exact model, confidence, and words for people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels import Model
from recon.fitting.refine import Refined
from recon.geometry.raster import iou, silhouettes
from recon.scene import Poses, Silhouettes, cam_from_canonical

EXPLAINED = 0.85  # mean IoU below which something about the outlines is not of this class, or the masks are wrong
GOOD, POOR = 0.9, 0.6  # mean IoU of a right result, and of a shape that merely stands in the same place
CLEAR = 0.02  # how much IoU the best front should be ahead of the next


@dataclass(frozen=True)
class Verdict:
    """view_iou (V,) with the masks of the photos; mean_iou over the used ones; confidence 0..1 and why."""

    view_iou: np.ndarray
    mean_iou: float
    confidence: float
    explanation: str
    warnings: tuple[str, ...]


def run(model: Model, poses: Poses, masks: Silhouettes, refined: Refined, photos: int) -> Verdict:
    """Judge a refined result; `photos` is how many were given."""
    drawn = silhouettes(
        model.build(refined.params),
        poses.cameras.K,
        cam_from_canonical(poses.cameras, refined.canonical),
        poses.cameras.sizes,
    )
    view_iou = np.array([iou(d & masks.known(v), masks.masks[v]) for v, d in enumerate(drawn)])
    mean = float(view_iou[masks.used].mean())
    agreement = float(np.clip((mean - POOR) / (GOOD - POOR), 0, 1))
    coverage = float(masks.used.sum() / max(photos, 1))
    lead = refined.mean_iou - refined.next_front
    decided = float(np.clip(0.5 + 0.5 * lead / CLEAR, 0.5, 1))
    explanation = (
        f"outlines agree by {mean:.2f} (IoU), {int(masks.used.sum())} of {photos} photos used, "
        f"the front is ahead of the next best by {lead:.3f}"
    )
    return Verdict(
        view_iou, mean, agreement * coverage**0.5 * decided, explanation, _warnings(model, mean, lead, view_iou, masks)
    )


def _warnings(model: Model, mean: float, lead: float, view_iou: np.ndarray, masks: Silhouettes) -> tuple[str, ...]:
    out = []
    if mean < EXPLAINED:
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
