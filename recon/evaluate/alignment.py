"""Up, yaw, front and size of eleven photo sets that make it hard, each in its own way: see KINDS.

    python -m recon.evaluate alignment

The sets are those of `evaluate chair` (own chairs in a rendered room), spoilt in one way at a time, or the same chairs
rendered in a harder room. A picture turned about its middle is exactly what a camera tilted sideways takes.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image
from tqdm import tqdm

from datasets.photosets import Photoset, read_photoset, render_photoset
from procmodels import Model, load
from recon.evaluate.chair import SET_OPTIONS, hidden_params, read_result, reconstruct, rendered_sets
from recon.evaluate.data.scenes import Misaligned, misaligned
from recon.evaluate.rows import Row
from recon.scene import ReconError

Chosen = Callable[[Photoset, Path], None]


def all_photos(truth: Photoset, folder: Path) -> None:
    """As they are."""
    for photo in truth.photos:
        shutil.copy(photo, folder)


def eight_photos(truth: Photoset, folder: Path) -> None:
    """Eight, spread evenly over the two rings."""
    for i in np.linspace(0, len(truth.photos) - 1, 8).round().astype(int):
        shutil.copy(truth.photos[i], folder)


def tilted(truth: Photoset, folder: Path) -> None:
    """Each camera tilted sideways by up to 20 degrees; what was outside the picture repeats its border."""
    rng = np.random.default_rng(3)
    for photo in truth.photos:
        picture = Image.open(photo)
        pixels = np.asarray(picture.convert("RGB"))
        height, width = pixels.shape[:2]
        turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), float(rng.uniform(-20, 20)), 1)
        turned = cv2.warpAffine(pixels, turn, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        Image.fromarray(turned).save(folder / photo.name, quality=95, exif=picture.getexif())


def mixed_formats(truth: Photoset, folder: Path) -> None:
    """Every other photo cut to portrait, which takes its EXIF away."""
    for i, photo in enumerate(truth.photos):
        if i % 2 == 0:
            shutil.copy(photo, folder)
            continue
        picture = Image.open(photo)
        width, height = picture.size
        side = round(0.82 * height)
        left = (width - side) // 2
        picture.crop((left, 0, left + side, height)).save(folder / photo.name, quality=95)


@dataclass(frozen=True)
class Kind:
    """Photo sets of one kind: chairs of `evaluate chair`, rendered as there or with `room` changed, then spoilt."""

    name: str
    chairs: tuple[int, ...]
    spoil: Chosen = all_photos
    room: dict[str, Any] = field(default_factory=dict)  # of PhotosetOptions; empty: the set of `evaluate chair`


PART = {"arc": 120.0, "views": 18}
KINDS = (
    Kind("all photos", (0,)),
    Kind("eight photos", (0, 1), eight_photos),
    Kind("tilted up to 20 degrees", (0, 1), tilted),
    Kind("portrait and landscape", (0,), mixed_formats),
    Kind("120 degrees of a circle", (0, 1), room=PART),
    Kind("rug, 1 cm thick", (2,), room={"rug": True}),
    Kind("wall close behind", (3,), room={**PART, "arc": 150.0, "wall": 0.15}),
    Kind("plain floor", (4,), room={"floor": "plain"}),
)


def run(work: Path, only: Sequence[str] = ()) -> Iterator[Row]:
    """Four rows a kind: the worst of up, yaw and size, and the share of fronts that are right.

    only  names of kinds; empty: all
    """
    model = load("chair")
    for kind in KINDS:
        if only and kind.name not in only:
            continue
        found = [_measured(model, work, kind, i) for i in tqdm(kind.chairs, desc=kind.name, disable=None)]
        right = [abs(m.yaw) < 45 for m in found]
        yaw = [abs((m.yaw + 45) % 90 - 45) for m in found]  # which of the four sides is the front, is another row
        sets = f"{len(found)} set{'s' if len(found) > 1 else ''}"
        yield Row(f"{kind.name}, {sets}: up, degrees off, worst", max(m.up for m in found), "<= 1")
        yield Row(f"{kind.name}: yaw, degrees off, worst", max(yaw), "<= 2")
        yield Row(f"{kind.name}: front right, share", float(np.mean(right)), ">= 1")
        yield Row(f"{kind.name}: size off, share, worst", max(m.size for m in found), "<= 0.02")


def _measured(model: Model, work: Path, kind: Kind, chair: int) -> Misaligned:
    """Reconstruct one set; infinitely far off when the command gives no result."""
    truth, name = rendered(model, work, kind, chair), f"{kind.name.replace(' ', '_')}_{chair}"
    folder = work / "alignment" / name
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "photos").mkdir(parents=True)
    kind.spoil(truth, folder / "photos")
    try:
        reconstruct(folder / "photos", folder / "out")
    except ReconError as error:
        tqdm.write(f"{kind.name}, chair {chair}: {error}")
        return Misaligned(np.inf, np.inf, np.inf)
    _, cameras, canonical = read_result(model, folder / "out")
    found = misaligned(truth, cameras, canonical)
    tqdm.write(f"{kind.name}, chair {chair}: up {found.up:.2f}, yaw {found.yaw:.2f}, size {found.size:.4f}")
    return found


def rendered(model: Model, work: Path, kind: Kind, chair: int) -> Photoset:
    """The photo set with its truth, rendered once (two to four minutes) and kept below `work`."""
    if not kind.room:
        return rendered_sets(model, work)[chair][1]
    folder = work / f"{kind.name.replace(' ', '_')}_{chair}"
    if not (folder / "truth" / "cameras.json").is_file():
        work.mkdir(parents=True, exist_ok=True)
        mesh = work / f"{folder.name}.ply"
        model.build(hidden_params(model)[chair]).to_trimesh().export(mesh)
        render_photoset(mesh, folder, replace(SET_OPTIONS, seed=chair, **kind.room))
    return read_photoset(folder)
