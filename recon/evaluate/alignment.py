"""Up, yaw, front and size of photo sets that make it hard: few photos, part of a circle, tilted cameras, mixed formats.

    python -m recon.evaluate alignment --sets 2

The sets are those of `evaluate chair` (own chairs in a rendered room), spoilt in one way at a time. A picture turned
about its middle is exactly what a camera tilted sideways takes.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from tqdm import tqdm

from datasets.photosets import Photoset
from procmodels import load
from recon.evaluate.chair import read_result, reconstruct, rendered_sets
from recon.evaluate.rows import Row
from recon.evaluate.scenes import Misaligned, misaligned
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


def part_of_a_circle(truth: Photoset, folder: Path) -> None:
    """Those taken from within 60 degrees of the front."""
    canonical_from_world = np.linalg.inv(truth.world_from_canonical)
    for photo, pose in zip(truth.photos, truth.cam_from_world, strict=True):
        x, y, _ = canonical_from_world[:3, :3] @ (-pose[:3, :3].T @ pose[:3, 3]) + canonical_from_world[:3, 3]
        if abs(np.degrees(np.arctan2(x, -y))) <= 60:
            shutil.copy(photo, folder)


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


WAYS: dict[str, Chosen] = {
    "all photos": all_photos,
    "eight photos": eight_photos,
    "120 degrees of a circle": part_of_a_circle,
    "tilted up to 20 degrees": tilted,
    "portrait and landscape": mixed_formats,
}


def run(work: Path, sets: int) -> Iterator[Row]:
    """Four rows a way: the worst of up, yaw and size, and the share of fronts that are right."""
    model = load("chair")
    truths = [truth for _, truth in rendered_sets(model, work)][:sets]
    for name, choose in WAYS.items():
        found = []
        for i, truth in enumerate(tqdm(truths, desc=name, disable=None)):
            folder = work / "alignment" / f"{name.replace(' ', '_')}_{i}"
            shutil.rmtree(folder, ignore_errors=True)
            (folder / "photos").mkdir(parents=True)
            choose(truth, folder / "photos")
            try:
                reconstruct(folder / "photos", folder / "out")
                _, cameras, canonical = read_result(model, folder / "out")
                found.append(misaligned(truth, cameras, canonical))
            except ReconError as error:
                tqdm.write(f"{name}, set {i}: {error}")
                found.append(Misaligned(np.inf, np.inf, np.inf))
        right = [abs(m.yaw) < 45 for m in found]
        yaw = [abs((m.yaw + 45) % 90 - 45) for m in found]  # which of the four sides is the front, is another row
        yield Row(f"{name}: up, degrees off, worst of {len(found)}", max(m.up for m in found), "<= 1")
        yield Row(f"{name}: yaw, degrees off, worst", max(yaw), "<= 2")
        yield Row(f"{name}: front right, share", float(np.mean(right)), ">= 1")
        yield Row(f"{name}: size off, share, worst", max(m.size for m in found), "<= 0.02")
