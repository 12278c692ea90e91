"""All photos on one surface: broad, even colours from all of them, fine detail from the best few."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recon.appearance.agreement import Agreement
from recon.appearance.atlas import Atlas
from recon.appearance.cell_images import CellImages
from recon.appearance.texels import Texels, seen
from recon.appearance.views import View

SHARP = 4  # power of the weights by which fine detail is taken: larger follows fewer photos
ENOUGH = 0.02  # weight at which photos decide alone


@dataclass(frozen=True)
class Blend:
    """colour (n, 3) float32 linear at texels; known (n,) float32: 1 where photos decide alone, 0 where none sees."""

    colour: np.ndarray
    known: np.ndarray


def blended(
    texels: Texels, atlas: Atlas, shots: list[View], agreement: Agreement, images: CellImages, sharp: int = SHARP
) -> Blend:
    """Weights grow with trust, with how squarely and finely a photo sees a place, and with how usual its colour is."""
    n = len(texels.flat)
    broad, fine = np.zeros((n, 4), np.float32), np.zeros((n, 4), np.float32)
    finest = _finest(atlas, shots)
    for i, view in enumerate(shots):
        found = seen(texels, atlas, view)
        colour = found.colour * agreement.gain[i].astype(np.float32)
        usual = images.spread(agreement.usual[i][:, None])[found.which, 0]
        weight = found.trust * found.cosine * usual
        best = (weight * np.minimum(found.fineness / finest, 1)) ** sharp
        for total, share in ((broad, weight), (fine, best)):
            total[found.which, :3] += colour * share[:, None]
            total[found.which, 3] += share
    smooth = broad[:, :3] / np.maximum(broad[:, 3:], 1e-12)
    detail = fine[:, :3] / np.maximum(fine[:, 3:], 1e-30)
    both = (broad[:, 3] > 0) & (fine[:, 3] > 0)
    # The two agree up to what differs between photos over wide areas, and that is taken from all of them.
    off = images.means(np.where(both[:, None], smooth - detail, 0), both.astype(np.float32))
    colour = np.where(both[:, None], detail + images.spread(off), smooth)
    return Blend(np.maximum(colour, 0), np.minimum(broad[:, 3] / ENOUGH, 1))


def _finest(atlas: Atlas, shots: list[View]) -> float:
    """Pixels per canonical unit where the photos see the object squarely."""
    middle = atlas.corners.mean((0, 1))
    depths = [float(np.linalg.norm(v.eye - middle)) for v in shots]
    return float(np.median([v.K[0, 0] / d for v, d in zip(shots, depths, strict=True)]))
