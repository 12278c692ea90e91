"""What parts are made of the same, and the base colour of each part."""

from __future__ import annotations

import numpy as np

from procmodels.shape import Part
from recon.appearance.agreement import weighted_median

HUE = 0.4  # log ratios of channels: parts that differ by less may be of one material
FEWEST = 4  # places that a part must be seen in to have a colour of its own
OWN = 0.4  # share of its difference from its material's colour that a part keeps: the rest is light that was not found


def alike(part: np.ndarray, count: int, colour: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(count,) int, a number for parts of about one hue; those seen most begin.

    part    (m,) int, of every place
    colour  (m, 3) float linear, NaN where not seen
    weight  (m,) float
    """
    told = np.isfinite(colour[:, 0]) & (weight > 0)
    part, colour, weight = part[told], np.maximum(colour[told], 1e-4), weight[told]
    size = np.bincount(part, weight, count)
    total = np.stack([np.bincount(part, weight * colour[:, k], count) for k in range(3)], 1)
    total[size == 0] = 1.0
    hue = np.log(total[:, [0, 2]] / total[:, [1]])
    out, number = np.full(count, -1), 0
    for p in np.argsort(-size, kind="stable"):
        if out[p] < 0:
            out[(out < 0) & (np.abs(hue - hue[p]).max(1) < HUE)] = number
            number += 1
    return out


def base_colours(
    parts: tuple[Part, ...],
    part: np.ndarray,
    colour: np.ndarray,
    weight: np.ndarray,
    material: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) float linear, the base colour of every part; and (P, 3), what to multiply its places' colours by for it.

    A part's colour is the median over its places, whose part (m,), colour (m, 3), weight (m,) these are, drawn towards
    the median of its material. A part that is not seen takes the colour of those with the same first word in their
    names, else of all. Raises ValueError when no place has a colour.
    """
    known = np.isfinite(colour[:, 0]) & (weight > 0)
    if not known.any():
        raise ValueError("no place has a colour")
    groups = [p.name.split(" ")[0] for p in parts]
    kin = np.array([[a == b for b in groups] for a in groups])
    out, factor = np.empty((len(parts), 3)), np.ones((len(parts), 3))
    for i in range(len(parts)):
        mine, kindred = known & (part == i), known & kin[i][part]
        if mine.sum() >= FEWEST:
            own = _median(colour, weight, mine)
            usual = own if material is None else _median(colour, weight, known & (material[part] == material[i]))
            factor[i] = (np.maximum(own, 1e-4) / np.maximum(usual, 1e-4)) ** (OWN - 1)
            out[i] = own * factor[i]
        else:
            out[i] = _median(colour, weight, kindred if kindred.any() else known)
    return out, factor


def _median(colour: np.ndarray, weight: np.ndarray, some: np.ndarray) -> np.ndarray:
    return weighted_median(colour[some][:, None], weight[some][:, None])[0]
