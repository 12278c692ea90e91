"""Taking the photos of a planned set: the room, the shots, and JPEGs as a camera writes them."""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image
from tqdm import tqdm

from datasets import floor_textures
from datasets.staging import PhotosetOptions, Plan
from procmodels.studio import render
from procmodels.studio.room import NearWall, Room, Rug

PLAIN = (150, 141, 128)  # RGB of a plain floor


def photograph(folder: Path, plan: Plan, options: PhotosetOptions) -> None:
    """Take the photos that are not there yet; the mesh is in the studio already."""
    todo = [(n, s) for n, s in zip(plan.names, plan.shots, strict=True) if not (folder / n).is_file()]
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        room = _room(scratch, plan, options)
        settings = render.RenderSettings(
            options.width, options.height, options.lens_mm, options.samples, options.threads
        )
        render.furnish(plan.world_from_canonical @ plan.canonical_from_file, room, settings, options.seed)
        for photo, shot in tqdm(todo, desc="photos", unit="photo"):
            render.shoot(shot, scratch / "frame.png")
            _develop(scratch / "frame.png", folder / photo, options)


def _room(scratch: Path, plan: Plan, options: PhotosetOptions) -> Room:
    """Paint the pictures for floor and walls; the walls stand well behind the cameras."""
    rng = np.random.default_rng([options.seed, 2])
    detail = min(4096, max(512, 5 * options.width))  # about one picture pixel a photo pixel
    floor = floor_textures.mosaic(detail, detail, detail // 12, rng)
    wall = floor_textures.mosaic(detail, detail // 8, detail // 24, rng, mute=0.45)
    half, light = 1.7 * plan.reach, rng.uniform(0, 2 * np.pi)
    if options.floor == "plain":
        floor = np.full((8, 8, 3), PLAIN, np.uint8)
    room = Room(half, 0.95 * half, _saved(floor, scratch / "floor.png"), _saved(wall, scratch / "wall.png"), light)
    turn = plan.world_from_canonical[:2, :2]
    back = float(np.arctan2(turn[1, 1], turn[0, 1]))  # the object faces -Y
    if options.rug:
        picture = floor_textures.mosaic(detail // 2, detail // 3, detail // 24, rng, tone=0.6)
        width = 1.9 * float(np.ptp(plan.vertices[:, :2], axis=0).max() * np.linalg.norm(turn[:, 0]))
        size = (width, width * picture.shape[0] / picture.shape[1])
        room = replace(room, rug=Rug(size, _saved(picture, scratch / "rug.png"), back + rng.uniform(-0.3, 0.3)))
    room = replace(room, papers=options.papers)
    if options.wall:
        picture = floor_textures.mosaic(detail, detail // 2, detail // 12, rng, mute=0.45)
        distance = float(plan.vertices[:, 1].max() * np.linalg.norm(turn[:, 1])) + options.wall
        near = NearWall(distance, back, _saved(picture, scratch / "near.png"))
        # The main lamp and the one 2.4 radians further on both hang on the free side.
        room = replace(room, near_wall=near, light_angle=back + np.pi - 1.2)
    return room


def _saved(picture: np.ndarray, path: Path) -> Path:
    Image.fromarray(picture).save(path, compress_level=1)
    return path


def _develop(frame: Path, target: Path, options: PhotosetOptions) -> None:
    """PNG to JPEG with the EXIF tags that a phone writes; renamed into place, so that a photo is whole or absent."""
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112] = "Studio", "Pinhole 1", 1  # make, model, upright
    tags = exif.get_ifd(0x8769)
    # The 35 mm equivalent is defined on the picture's diagonal (43.27 mm) and is a whole number of millimetres.
    tags[0xA405] = max(1, round(options.focal / float(np.hypot(options.width, options.height)) * 43.2666))
    tags[0x920A] = round(options.focal / options.width * 6.17, 3)  # millimetres, for a phone's 6.17 mm wide sensor
    tags[0xA002], tags[0xA003] = options.width, options.height
    partial = target.with_suffix(".tmp")
    with Image.open(frame) as picture:
        picture.convert("RGB").save(partial, format="JPEG", quality=options.quality, optimize=True, exif=exif)
    os.replace(partial, target)
