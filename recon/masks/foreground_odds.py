"""Log-odds that a pixel shows the object rather than the room: votes of other photos, colours, and a hull as prior."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import scipy.ndimage

from recon.masks.photo_consistency import Agreement, Window


@dataclass(frozen=True)
class OddsOptions:
    quorum: tuple[float, float] = (0.35, 0.5)  # share of the neighbours that must agree; without and with a hull
    blocked: float = 0.4  # how often a free cell's view is blocked by the object
    chance: float = 0.03  # how often the object looks like the room by chance, beside its colour
    nearby: int = 40  # px, how far round a pixel the colours of the backdrop are gathered
    prior: float = 0.25  # log-odds a px of depth inside the hull or distance outside it
    prior_px: tuple[float, float] = (12.0, 4.0)  # px outside and inside the hull from where on the prior stays the same
    filter_radius: int = 3  # px, of the guided filter; edges move up to about this far
    filter_edge: float = 60.0  # squared grey levels: weaker edges than this are not followed
    undecided: float = 0.5  # log-odds: GrabCut decides pixels that are less certain than this


class Colours:
    """How common a colour is on the object: a 32^3 histogram, summed over the 5^3 bins round each."""

    def __init__(self, images: list[np.ndarray], masks: list[np.ndarray]) -> None:
        table = np.zeros(32**3)
        for image, mask in zip(images, masks, strict=True):
            table += np.bincount(_bins(image[mask]), minlength=32**3)
        table /= max(table.sum(), 1)
        smooth = scipy.ndimage.uniform_filter(table.reshape(32, 32, 32), 5, mode="constant") * 125
        self._table = smooth.ravel().astype(np.float32)

    def share(self, image: np.ndarray) -> np.ndarray:
        """(...) float32, 0..1, share of the object's pixels whose colour is near those of an image (..., 3) uint8."""
        return self._table.take(_bins(image))


def _bins(image: np.ndarray) -> np.ndarray:
    q = (image >> 3).astype(np.int32)
    return (q[..., 0] * 32 + q[..., 1]) * 32 + q[..., 2]


def votes(
    agreement: Agreement, like: np.ndarray | float, quorum: float, blocked: float, options: OddsOptions
) -> np.ndarray:
    """(h, w) float32 log-odds; 0 where fewer than two photos could judge.

    like     share of the object's colours near the pixel's own: where the room has a colour of the object, agreement
             with the room says little
    blocked  how often the room is hidden although the place in question is free; 0 for pixels themselves
    """
    chance = np.clip(options.chance + like, 0, 0.9)
    agrees = 0.95 * (1 - blocked) + blocked * chance
    odds = np.where(agreement.share >= quorum, np.log(chance / agrees), np.log((1 - chance) / (1 - agrees)))
    return np.where(agreement.count >= 2, odds, 0).astype(np.float32)


def backdrop_odds(image: np.ndarray, outside: np.ndarray, like: np.ndarray, options: OddsOptions) -> np.ndarray:
    """(h, w) float32 log-odds by colour alone: the object's colours against the backdrop's mean and spread nearby.

    outside  (h, w) bool, pixels that surely show the backdrop
    """
    size = (2 * options.nearby + 1,) * 2
    pixels, weight = image.astype(np.float32), outside.astype(np.float32)
    count = cv2.boxFilter(weight, -1, size, normalize=False)
    share = np.maximum(count, 1)[..., None]
    mean = cv2.boxFilter(pixels * weight[..., None], -1, size, normalize=False) / share
    square = cv2.boxFilter(pixels**2 * weight[..., None], -1, size, normalize=False) / share
    spread = np.maximum(square - mean**2, 0) + 6.0**2  # nothing is plainer than a photo's noise and shading
    room = -0.5 * ((pixels - mean) ** 2 / spread + np.log(2 * np.pi * spread)).sum(-1)
    own = np.log(like / 40.0**3 + 1e-8)  # 5 bins are 40 grey levels
    return np.where(count > 50, np.clip(own - room, -2, 2), 0).astype(np.float32)


def smooth(image: np.ndarray, odds: np.ndarray, hull: np.ndarray, options: OddsOptions) -> np.ndarray:
    """(h, w) float32: the odds and the hull's prior, averaged along the photo's own edges."""
    inner = hull.astype(np.uint8)
    inside = cv2.distanceTransform(inner, cv2.DIST_L2, 5)
    outside = cv2.distanceTransform(1 - inner, cv2.DIST_L2, 5)
    far, deep = options.prior_px
    prior = options.prior * (np.minimum(inside, deep) - np.minimum(outside, far))
    return cv2.ximgproc.guidedFilter(image, odds + prior, options.filter_radius, options.filter_edge)


def decide(image: np.ndarray, odds: np.ndarray, options: OddsOptions, seed: int) -> np.ndarray:
    """(h, w) bool: the sign of the odds; what is undecided is left to GrabCut, if it has enough to learn from."""
    labels = np.where(odds > 0, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[odds > options.undecided] = cv2.GC_FGD
    labels[odds < -options.undecided] = cv2.GC_BGD
    # Colours are learnt from every second row and column, and only the box of what is open is cut: half the time.
    some = np.ascontiguousarray(labels[::2, ::2])
    around = crop(np.abs(odds) <= options.undecided, 2)
    if min((some == cv2.GC_FGD).sum(), (some == cv2.GC_BGD).sum()) < 25:
        return odds > 0
    cv2.setRNGSeed(seed)  # GrabCut's k-means; the generator is the thread's own
    model = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(np.ascontiguousarray(image[::2, ::2]), some, None, *model, 1, cv2.GC_INIT_WITH_MASK)  # type: ignore[call-overload]
    part = np.ascontiguousarray(labels[around])
    cv2.grabCut(np.ascontiguousarray(image[around]), part, None, *model, 1, cv2.GC_EVAL_FREEZE_MODEL)  # type: ignore[call-overload]
    labels[around] = part
    return (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)


def without_speckles(mask: np.ndarray, hull: np.ndarray, least: float = 0.001) -> np.ndarray:
    """The mask without parts off the hull or smaller than `least` of it; pinholes below 8 px are filled."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    touching = np.bincount(labels[hull], minlength=count) > 0
    keep = touching & (stats[:, cv2.CC_STAT_AREA] >= least * mask.sum())
    keep[0] = False
    out = keep[labels]
    count, labels, stats, _ = cv2.connectedComponentsWithStats((~out).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < 8
    small[0] = False
    return out | small[labels]


def crop(hull: np.ndarray, margin: int) -> Window:
    """The rows and columns of a mask's box with a margin; the whole picture when the mask is empty."""
    if not hull.any():
        return slice(0, hull.shape[0]), slice(0, hull.shape[1])
    rows, columns = np.flatnonzero(hull.any(1)), np.flatnonzero(hull.any(0))
    return (
        slice(max(0, int(rows[0]) - margin), min(hull.shape[0], int(rows[-1]) + 1 + margin)),
        slice(max(0, int(columns[0]) - margin), min(hull.shape[1], int(columns[-1]) + 1 + margin)),
    )
