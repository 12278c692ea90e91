"""How much wrong masks and wrong cameras cost: own shapes from 24 masks with known cameras, the masks spoilt in one way
at a time; and from one mask whose given camera is off.

python -m recon.evaluate robust --class chair --shapes 6
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
import trimesh
from tqdm import tqdm

from procmodels import Model, load
from recon.evaluate.chair import from_silhouettes
from recon.evaluate.data.held_out import Case, cases
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.evaluate.data.true_views import one_view
from recon.evaluate.metrics import chamfer
from recon.evaluate.rows import Row
from recon.fitting.camera_search import find
from recon.fitting.one_view import CameraSearchOptions, OneView
from recon.fitting.silhouette_bank import load_bank
from recon.masks.silhouettes import SilhouetteOptions, judge
from recon.scene import Poses, ReconError, Scene, Silhouettes

VIEWS = 24
DOUBT = 10.0  # degrees, what is said of a camera that is off
LOST = 0.05  # D_chamfer that counts for a set without an answer: a quite different shape

Spoilt = Callable[[Silhouettes, np.random.Generator], Silhouettes]


@dataclass(frozen=True)
class RobustOptions:
    """What is measured."""

    classes: tuple[str, ...] = ("chair",)
    shapes: int = 6  # held-out, off the grid
    radius: int = 2  # px of erosion and dilation, in pictures of 800 x 600
    share: float = 0.2  # of the masks that are replaced


def exact(masks: Silhouettes, rng: np.random.Generator) -> Silhouettes:
    """Nothing is spoilt."""
    return masks


def grown(radius: int) -> Spoilt:
    """All masks wider by so many pixels, or narrower where it is negative."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * abs(radius) + 1,) * 2)
    change = cv2.dilate if radius > 0 else cv2.erode

    def spoil(masks: Silhouettes, rng: np.random.Generator) -> Silhouettes:
        return replace(masks, masks=tuple(change(m.astype(np.uint8), kernel) > 0 for m in masks.masks))

    return spoil


def replaced(share: float) -> Spoilt:
    """This share of the masks is noise: blobs anywhere, or another view's mask shifted."""

    def spoil(masks: Silhouettes, rng: np.random.Generator) -> Silhouettes:
        out = list(masks.masks)
        for i, v in enumerate(rng.permutation(len(out))[: round(share * len(out))]):
            if i % 2:
                shift = tuple(rng.integers(60, 160, 2) * rng.choice([-1, 1], 2))
                out[v] = np.roll(masks.masks[rng.integers(len(out))], shift, (0, 1))
            else:
                noise = cv2.GaussianBlur(rng.normal(size=out[v].shape), (0, 0), 25)
                out[v] = noise > np.quantile(noise, 1 - max(0.05, float(masks.masks[v].mean())))
        return replace(masks, masks=tuple(out))

    return spoil


def cut_off(masks: Silhouettes, rng: np.random.Generator) -> Silhouettes:
    """A third of the masks lose what lies beyond a straight edge through the object, as behind a table; it is marked
    as unknown."""
    out, unknown = list(masks.masks), [None] * len(masks.masks)  # type: tuple[list, list]
    for v in rng.permutation(len(out))[: len(out) // 3]:
        rows, columns = np.nonzero(out[v])
        hidden = np.zeros(out[v].shape, bool)
        if rng.random() < 0.5:
            hidden[int(np.quantile(rows, 0.75)) :] = True
        else:
            hidden[:, int(np.quantile(columns, 0.75)) :] = True
        out[v], unknown[v] = out[v] & ~hidden, hidden
    return replace(masks, masks=tuple(out), unknown=tuple(unknown))


def ways(options: RobustOptions) -> dict[str, Spoilt]:
    """Name -> what is done to the masks; "exact" first."""
    r = options.radius
    return {
        "exact": exact,
        f"eroded by {r} px": grown(-r),
        f"dilated by {r} px": grown(r),
        f"{100 * options.share:.0f} % replaced": replaced(options.share),
        "a third partly hidden, marked so": cut_off,
    }


def run(options: RobustOptions) -> Iterator[Row]:
    """A row a class and way: mean D_chamfer, for the spoilt ones what they cost over the exact masks."""
    for name in options.classes:
        model = load(name)
        held_out = cases(model, "off", options.shapes)
        base = 0.0
        for way, spoil in ways(options).items():
            found = []
            for i, case in enumerate(tqdm(held_out, desc=f"{name}, {way}", disable=None)):
                cameras, place = orbit(VIEWS, seed=i)
                scene = drawn_scene(case.shape, cameras, place)
                spoilt = judged(scene.poses, spoil(scene.silhouettes, np.random.default_rng([11, i])))
                found.append(distance(model, replace(scene, silhouettes=spoilt), case.mesh))
            mean = float(np.mean(found))
            if way == "exact":
                base = mean
                yield Row(f"{name}, {VIEWS} masks, exact: D_chamfer", mean)
            else:
                yield Row(f"{name}, {way}: D_chamfer more than exact", mean - base, "<= 0.0003")
        yield from one_mask_rows(model, held_out)


def one_mask_rows(model: Model, held_out: list[Case]) -> Iterator[Row]:
    """One mask of each shape: its camera known, given wrongly and held, given wrongly and found with the shape."""
    options = CameraSearchOptions()
    bank = load_bank(model, options.bank)
    ways = {"camera known": (False, 0.0), "camera off, held": (True, 0.0), "camera off, refined": (True, DOUBT)}
    for way, (off, doubt) in ways.items():
        found = []
        for i, case in enumerate(tqdm(held_out, desc=f"{model.name}, one mask, {way}", disable=None)):
            mask, K, pose, _ = one_view(case.mesh, i)
            view = OneView(mask, K, True, knocked(pose) if off else pose, doubt)
            shape = model.build(find(model, view, bank, options).refined.params)
            found.append(chamfer(shape.to_trimesh(), case.mesh))
        bound = "<= 0.0006" if doubt else None
        yield Row(f"{model.name}, one mask, {way}: D_chamfer", float(np.mean(found)), bound)
        yield Row(f"{model.name}, one mask, {way}: D_chamfer, median", float(np.median(found)))


def knocked(pose: np.ndarray) -> np.ndarray:
    """cam_from_canonical (4, 4) 5 degrees higher, 8 degrees farther round and 5 % farther away than the true one."""
    out = pose.copy()
    up, side = (cv2.Rodrigues(np.radians(v))[0] for v in (np.array([5.0, 0, 0]), np.array([0, 0, 8.0])))
    out[:3, :3] = up @ pose[:3, :3] @ side
    out[:3, 3] *= 1.05
    return out


def judged(poses: Poses, masks: Silhouettes) -> Silhouettes:
    """The masks that contradict the others put aside, as the silhouette stage does."""
    found = judge(poses.cameras, list(masks.masks), masks.used, None, SilhouetteOptions())
    return replace(masks, used=found.used, reasons=found.reasons, misplaced=found.misplaced)


def distance(model: Model, scene: Scene, mesh: trimesh.Trimesh) -> float:
    """D_chamfer of the result in its own canonical frame; LOST without a result."""
    try:
        refined = from_silhouettes(model, scene)
    except ReconError:
        return LOST
    return chamfer(model.build(refined.params).to_trimesh(), mesh)
