"""A bank of exact silhouettes of one class, seen from all around, and which of them look like a given mask.

Silhouettes are cut to their bounding box and resized, so that where the object stands in the image, how far away it is
and the focal length drop out; the box's proportions are compared beside the pixels. What remains of the camera is the
direction it looks from and the distance in object sizes, which sets the perspective.
"""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nnproc.rays import look_at_cameras
from procmodels import Model
from procmodels.shape import Shape
from procmodels.space import Params
from recon.geometry.raster import silhouettes
from recon.geometry.view_geometry import Box, cut_to, mask_box, rolled, touching
from recon.store import Store
from recon.system.digests import code_version, digest

_BITS = np.array([bin(i).count("1") for i in range(1 << 16)], np.uint8)


@dataclass(frozen=True)
class BankOptions:
    """What the bank holds."""

    shapes: int = 720  # parameter sets; a rich class is better seen from few sides each than seldom
    azimuth_step: float = 60.0  # degrees, from a random first one
    few: int = 160  # parameter sets of a class that takes long to build; these, and one shape alone, are seen
    fine_step: float = 15.0  # from so many sides
    elevations: tuple[float, ...] = (3.0, 16.0, 28.0, 42.0)  # degrees; each shape varies them by up to `jitter`
    jitter: float = 6.0  # degrees
    distances: tuple[float, ...] = (1.6, 2.4, 4.5)  # object sizes, one a shape in turn
    render: int = 72  # px, side of the pictures that are drawn
    side: int = 48  # px, side of a silhouette cut to its box
    rolls: tuple[float, ...] = (-20.0, -10.0, 0.0, 10.0, 20.0)  # degrees, tried of the given mask
    cut_off: tuple[float, ...] = (0.15, 0.4)  # how much may be missing where a mask is cut by the photo's edge
    roll_cost: float = 0.01  # IoU that a roll of 10 degrees must win


@dataclass(frozen=True)
class Bank:
    """N views.

    params    the shapes' parameters
    bits      (N, side * side / 8) uint8, silhouettes cut to their boxes
    box       (N, 4) float, left, top, width, height of those boxes on the plane z = 1 of the camera frame
    shape     (N,) int, index into params
    azimuth, elevation  (N,) float, degrees (nnproc.rays.look_at_cameras); distance (N,) in canonical units
    """

    params: tuple[Params, ...]
    bits: np.ndarray
    box: np.ndarray
    shape: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    distance: np.ndarray


@dataclass(frozen=True)
class Hit:
    """A view of the bank that looks like the mask: entry, IoU of the normalised silhouettes, the mask's roll (degrees,
    clockwise in the image) and its box (left, top, width, height) in pixels of the rolled mask about `middle`."""

    entry: int
    score: float
    roll: float
    box: Box


def load_bank(model: Model, options: BankOptions = BankOptions(), seed: int = 0, cache: Path | None = None) -> Bank:
    """The class's bank, from the cache (default: nnproc-recon in the user's cache folder) or made now, in seconds."""
    folder = cache or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "nnproc-recon"
    key = digest(model.space.hash, model.code, options, seed, code_version())
    store, name = Store(folder, [Bank]), f"views-{Path(model.name).name}-{key}"
    if (stored := store.load(name, key)) is not None:
        return stored.result
    bank = make_bank(model, options, seed)
    with contextlib.suppress(OSError):  # a cache that cannot be written costs time, not the result
        store.save(name, key, bank, 0.0)
    return bank


def make_bank(model: Model, options: BankOptions = BankOptions(), seed: int = 0) -> Bank:
    """Draw the bank: every shape in a ring of azimuths at each elevation."""
    rng = np.random.default_rng(seed)
    slow = model.live_object is not None  # Blender's nodes build it
    count, step = (options.few, options.fine_step) if slow else (options.shapes, options.azimuth_step)
    params, rows = [], []
    for i in range(count):
        params.append(_plain(_spread_sample(model, i, count, rng)))
        tilt = np.array(options.elevations) + rng.uniform(-options.jitter, options.jitter, len(options.elevations))
        distance = options.distances[i % len(options.distances)]
        azimuths = np.arange(rng.uniform(0, step), 360, step)
        rows += _ring(model.build(params[i]), azimuths, tilt, i, distance, options)
    return _bank(params, rows)


def shape_bank(model: Model, params: Params, options: BankOptions = BankOptions()) -> Bank:
    """A bank of one shape alone, for when only the camera is sought."""
    tilt, middle = np.array(options.elevations), options.distances[len(options.distances) // 2]
    azimuths = np.arange(0, 360, options.fine_step)
    return _bank([params], _ring(model.build(params), azimuths, tilt, 0, middle, options))


_Row = tuple[np.ndarray, np.ndarray, tuple[float, ...]]  # bits, box, (shape, azimuth, elevation, distance)


def _ring(
    shape: Shape, azimuths: np.ndarray, tilt: np.ndarray, index: int, distance: float, options: BankOptions
) -> list[_Row]:
    """A shape's views from the azimuths at each elevation of `tilt`."""
    mirrored = _mirrored(shape.vertices())
    ring = azimuths[azimuths <= 180] if mirrored else azimuths
    azimuth, elevation = (a.ravel() for a in np.meshgrid(ring, tilt))
    fov = np.degrees(2 * np.arctan(0.85 / (distance - 0.35)))
    K, poses = (t.numpy() for t in look_at_cameras(azimuth.tolist(), elevation.tolist(), distance, fov, options.render))
    rows = []
    drawn = silhouettes(shape, K, poses, np.full((len(K), 2), options.render))
    for mask, k, az, el in zip(drawn, K, azimuth, elevation, strict=True):
        rows += _entries(mask, k, options.side, mirrored and 0 < az < 180, (index, az, el, distance))
    return rows


def _bank(params: list[Params], rows: list[_Row]) -> Bank:
    bits, boxes, facts = (np.array(c) for c in zip(*rows, strict=True))
    return Bank(tuple(params), bits, boxes, facts[:, 0].astype(int), facts[:, 1], facts[:, 2], facts[:, 3])


def _plain(params: Params) -> Params:
    """Without numpy's scalars, which JSON does not know."""
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in params.items()}


def _spread_sample(model: Model, index: int, count: int, rng: np.random.Generator) -> Params:
    """A random parameter set; discrete values are taken in turn, so that a small bank holds each combination."""
    params = model.space.sample(rng)
    total = int(np.prod([p.grid_steps for p in model.space.discrete], dtype=float))
    if total <= count:
        for p in model.space.discrete:
            index, digit = divmod(index, p.grid_steps)
            params[p.name] = p.grid_value(digit)
    return params


def _mirrored(vertices: np.ndarray) -> bool:
    """Whether the left half is the right half's mirror image."""
    flipped = np.round(vertices * (-1, 1, 1), 4) + 0.0
    here = np.round(vertices, 4) + 0.0
    return bool(np.allclose(here[np.lexsort(here.T)], flipped[np.lexsort(flipped.T)], atol=1e-3))


def _entries(mask: np.ndarray, K: np.ndarray, side: int, mirror: bool, facts: tuple[float, ...]) -> list[_Row]:
    """(bits, box, facts) of a drawn mask, and of its mirror image, which shows the shape from the other side."""
    found = mask_box(mask)
    if found is None:
        return []
    x, y, w, h = found
    cut = cut_to(mask, found, side)
    box = np.array([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], w / K[0, 0], h / K[1, 1]])
    out = [(np.packbits(cut), box, facts)]
    if mirror:
        i, azimuth, elevation, distance = facts
        other = np.array([-box[0] - box[2], *box[1:]])
        out.append((np.packbits(cut[:, ::-1]), other, (i, 360 - azimuth, elevation, distance)))
    return out


def search(bank: Bank, mask: np.ndarray, inside: np.ndarray, options: BankOptions, keep: np.ndarray) -> list[Hit]:
    """The best hit of each view of the bank that `keep` (N,) bool allows, best first.

    mask    (H, W) bool, with a free border round the object
    inside  (H, W) bool, where the photo is: an object that reaches its edge may be cut off there
    """
    best: dict[int, Hit] = {}
    index = np.flatnonzero(keep)
    for roll in options.rolls:
        turned, _ = rolled(mask, roll)
        seen, _ = rolled(inside, roll)
        for box in _boxes(turned, mask, inside, options):
            scores = _scores(bank, index, cut_to(turned, box, options.side), cut_to(seen, box, options.side))
            ratio = np.log(bank.box[index, 2] / bank.box[index, 3]) - np.log(box[2] / box[3])
            scores = scores * np.exp(-np.abs(ratio)) - options.roll_cost * (roll / 10) ** 2
            for i in np.argsort(-scores)[:400]:
                hit = Hit(int(index[i]), float(scores[i]), roll, box)
                if hit.entry not in best or best[hit.entry].score < hit.score:
                    best[hit.entry] = hit
    return sorted(best.values(), key=lambda h: (-h.score, h.entry))


def _boxes(turned: np.ndarray, mask: np.ndarray, inside: np.ndarray, options: BankOptions) -> list[Box]:
    """The rolled mask's box, and larger ones where the photo's edge cuts the object off."""
    box = mask_box(turned)
    if box is None:
        return []
    x, y, w, h = box
    touches = touching(mask, inside)
    out = [box]
    for share in options.cut_off if any(touches) else ():
        left, top, right, bottom = (share * t for t in touches)
        out.append((x - left * w, y - top * h, w * (1 + left + right), h * (1 + top + bottom)))
    return out


def _scores(bank: Bank, index: np.ndarray, target: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """(len(index),) IoU of bank silhouettes with a target (side, side), where it is valid."""
    target_bits, valid_bits = (np.packbits(a)[None].view(np.uint16) for a in (target & valid, valid))
    bits = bank.bits[index].view(np.uint16) & valid_bits
    both = _BITS[bits & target_bits].sum(1, dtype=np.int32)
    either = _BITS[bits | target_bits].sum(1, dtype=np.int32)
    return both / np.maximum(either, 1)
