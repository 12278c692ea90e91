"""SOG splats: a zip archive of pictures, a pixel a Gaussian, and meta.json, which says what the pixels mean."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from recon.files.head import Head
from recon.files.quaternions import from_smallest_three
from recon.files.shape import Gaussians, Kind, Recognised, splat_of
from recon.scene import InputError
from recon.system import limits


def is_sog(head: Head) -> bool:
    """Whether an archive holds meta.json and WebP pictures."""
    names = [name.rsplit("/", 1)[-1].lower() for name in head.members]
    return "meta.json" in names and any(name.endswith(".webp") for name in names)


def describe(path: Path) -> Recognised:
    """From meta.json. Raises InputError when it claims too much."""
    with zipfile.ZipFile(path) as archive:
        count = _count(_meta(archive))
    if count > limits.FACES:
        raise InputError(
            f"{path} claims {count:,} Gaussians, more than the {limits.FACES:,} that are read here; thin it out"
        )
    return Recognised(Kind.SPLAT, splat_of(count, "SOG"))


def read(path: Path) -> Gaussians:
    """All Gaussians, of versions 1 and 2. Raises ValueError for pictures that are too small."""
    with zipfile.ZipFile(path) as archive:
        meta = _meta(archive)
        count = _count(meta)
        low, high = (_pixels(archive, name, count) for name in meta["means"]["files"][:2])
        turn, sigma, colour = (_pixels(archive, meta[key]["files"][0], count) for key in ("quats", "scales", "sh0"))
    if meta.get("version") == 2:
        logs, opacity = np.array(meta["scales"]["codebook"], float)[sigma[:, :3]], colour[:, 3] / 255
    else:
        logs = _between(meta["scales"], sigma[:, :3] / 255)
        opacity = 1 / (1 + np.exp(-np.clip(_between(meta["sh0"], colour / 255)[:, 3], -50, 50)))
    place = _between(meta["means"], (low[:, :3] + 256.0 * high[:, :3]) / 65535)
    return Gaussians(
        np.sign(place) * np.expm1(np.minimum(np.abs(place), 700)),
        opacity,
        np.exp(np.clip(logs, -50, 50)),
        from_smallest_three((turn[:, :3] / 127.5 - 1) / np.sqrt(2), np.clip(turn[:, 3].astype(int) - 252, 0, 3)),
    )


def _meta(archive: zipfile.ZipFile) -> dict[str, Any]:
    name = next(n for n in archive.namelist() if n.rsplit("/", 1)[-1].lower() == "meta.json")
    with archive.open(name) as file:
        return json.loads(file.read(1 << 24))


def _count(meta: dict[str, Any]) -> int:
    return int(meta["count"] if "count" in meta else meta["means"]["shape"][0])


def _pixels(archive: zipfile.ZipFile, name: str, count: int) -> np.ndarray:
    """(count, 4) uint8: the first pixels of a picture, row by row."""
    inside = next(n for n in archive.namelist() if n == name or n.endswith(f"/{name}"))
    with archive.open(inside) as file:
        picture = Image.open(io.BytesIO(file.read(limits.SCENE)))
    if not count <= picture.width * picture.height <= 4 * max(count, 1 << 20):
        raise ValueError(f"{name} has {picture.width} x {picture.height} pixels for {count:,} Gaussians")
    return np.asarray(picture.convert("RGBA")).reshape(-1, 4)[:count]


def _between(part: dict[str, Any], share: np.ndarray) -> np.ndarray:
    """Values at shares (n, k) 0..1 of their ranges."""
    low, high = (np.array(part[key], float)[: share.shape[1]] for key in ("mins", "maxs"))
    return low + (high - low) * share
