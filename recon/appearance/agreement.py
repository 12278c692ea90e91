"""What the photos agree on: the exposure of each, and colours that no highlight and no slip of a pose can move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recon.appearance.atlas import Atlas
from recon.appearance.texels import CELL, Texels, seen
from recon.appearance.views import View

DARKEST = 1e-3  # linear light: below, a photo's noise decides
SWEEPS = 4  # of gains and colours in turn
SOME = 4_000  # places that decide the gains
FEWEST = 30  # places that a photo must share with others to be told its gain
OTHER_HUE = 0.3  # log ratios of channels: photos that differ by more from a part's hue show something else
STRANGE = 0.02  # what such a photo counts, beside the others
FARTHEST = np.log(2.0)  # one stop: the most that a photo's exposure is taken to be off


@dataclass(frozen=True)
class Agreement:
    """At m places, from V photos.

    gain     (V, 3) float, by which a photo's linear light is multiplied to be as bright as the others
    colour   (m, 3) float linear, NaN where no photo sees the place
    weight   (m,) float, how much the photos say about it
    usual    (V, m) float, 0..1: near 1 where a photo shows what the others do, small in highlights and slips, and
             smallest where it shows a hue that the part has nowhere else
    """

    gain: np.ndarray
    colour: np.ndarray
    weight: np.ndarray
    usual: np.ndarray


def agreed(cells: Texels, atlas: Atlas, shots: list[View], spread: float = 0.12) -> Agreement:
    """Compare the photos place by place.

    spread  of log colours between photos that is nothing unusual
    """
    n, m = len(shots), len(cells.flat)
    logs, weights = np.full((n, m, 3), np.nan, np.float32), np.zeros((n, m), np.float32)
    for i, view in enumerate(shots):
        found = seen(cells, atlas, view, blur=CELL / atlas.scale * _fineness(view))
        logs[i, found.which] = np.log(np.maximum(found.colour, DARKEST))
        weights[i, found.which] = found.trust * found.cosine
    gain = _gains(logs, weights)
    logs += gain[:, None]
    colour = weighted_median(logs, weights)
    strange = np.where(_strange(logs, colour, atlas.part[cells.triangle]), np.float32(STRANGE), np.float32(1))
    weights *= strange
    colour = weighted_median(logs, weights)
    apart = np.abs(logs - colour).max(2)
    usual = 1 / (1 + (np.nan_to_num(apart, nan=np.inf) / (2 * spread)) ** 4)
    usual[weights == 0] = 0.5
    return Agreement(np.exp(gain), np.exp(colour), weights.sum(0), (usual * strange).astype(np.float32))


def _strange(logs: np.ndarray, colour: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(V, m) bool, where a photo shows another hue than the part (m,) has: of what stands beside or behind it.

    A part of many hues has no strange ones; and what all photos show stays, because only weights among photos change.
    """
    hue = colour[:, [0, 2]] - colour[:, [1]]
    usual, spread = np.zeros((part.max() + 1, 2)), np.full(part.max() + 1, np.inf)
    for p in np.unique(part[np.isfinite(colour[:, 0])]):
        mine = hue[(part == p) & np.isfinite(colour[:, 0])]
        usual[p] = np.median(mine, axis=0)
        spread[p] = np.median(np.abs(mine - usual[p]).max(1))
    off = np.abs(logs[..., [0, 2]] - logs[..., [1]] - usual[part]).max(2)
    return np.nan_to_num(off) > np.maximum(OTHER_HUE, 4 * spread[part])


def _fineness(view: View) -> float:
    """Pixels per canonical unit at the object's usual depth."""
    depth = view.depth[np.isfinite(view.depth)]
    return float(view.K[0, 0] / np.median(depth)) if len(depth) else 0.0


def _gains(logs: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(V, 3) to add to the logs (V, m, 3), so that photos agree where they see the same; their median is 0."""
    several = np.flatnonzero((weights > 0).sum(0) > 1)
    some = several[:: max(1, len(several) // SOME)]
    logs, weights = logs[:, some], weights[:, some]
    gain = np.zeros((len(logs), 3), np.float32)
    for _ in range(SWEEPS):
        off = weighted_median(logs + gain[:, None], weights) - logs
        told = (weights > 0).sum(1) >= FEWEST
        if not told.any():
            return np.zeros_like(gain)
        gain[told] = weighted_median(np.swapaxes(off[told], 0, 1), weights[told].T)
        gain -= np.median(gain[told], axis=0)
    return np.clip(gain, -FARTHEST, FARTHEST)


def weighted_median(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(m, c) medians over the first axis of values (k, m, c) with weights (k, m); NaN where all weights are 0.

    Values of no weight may be NaN.
    """
    values = np.where(weights[..., None] > 0, values, np.inf)
    order = np.argsort(values, axis=0)
    ranked = np.take_along_axis(np.broadcast_to(weights[..., None], values.shape), order, 0).cumsum(0)
    half = (ranked < ranked[-1] / 2).sum(0)
    picked = np.take_along_axis(order, half[None], 0)
    out = np.take_along_axis(values, picked, 0)[0]
    return np.where(weights.sum(0)[:, None] > 0, out, np.nan)
