"""What a shape's file can hold, and what a format is: one row of the table in recon/files/formats.py."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from recon.files.head import Head
from recon.scene import InputError
from recon.system import limits


class Kind(StrEnum):
    """Every kind of input; the values are what --input takes."""

    PHOTOS = "photos"
    VIDEO = "video"
    CAMERAS = "cameras"
    IMAGE = "image"
    MASKS = "masks"
    MESH = "mesh"
    CLOUD = "cloud"
    SPLAT = "splat"
    VOXELS = "voxels"


SHAPES = (Kind.MESH, Kind.CLOUD, Kind.SPLAT, Kind.VOXELS)


@dataclass(frozen=True)
class Recognised:
    """An input's kind, and in words what was seen ("a point cloud of 500 points")."""

    kind: Kind
    what: str


@dataclass(frozen=True)
class Surface:
    """Triangles: vertices (n, 3) float and triangles (m, 3) int, in the file's axes and units."""

    vertices: np.ndarray
    triangles: np.ndarray


@dataclass(frozen=True)
class Cloud:
    """points (n, 3) float, in the file's axes and units, with whatever is wrong with single points."""

    points: np.ndarray


@dataclass(frozen=True)
class Gaussians:
    """n Gaussians of a splat, in the file's axes and units. What the file lacks is None.

    centres  (n, 3) float
    opacity  (n,) float, 0..1
    sigma    (n, 3) float, standard deviations along the Gaussian's own axes
    turns    (n, 4) float, quaternions (w, x, y, z) of any length: world from the Gaussian's own axes
    """

    centres: np.ndarray
    opacity: np.ndarray | None
    sigma: np.ndarray | None
    turns: np.ndarray | None


@dataclass(frozen=True)
class Grid:
    """filled (X, Y, Z) bool."""

    filled: np.ndarray


Shape = Surface | Cloud | Gaussians | Grid


@dataclass(frozen=True)
class Format:
    """One way of keeping shapes in files.

    matches   whether a file is of this format, by its content
    describe  what it holds, from as little of it as possible; raises InputError for damage
    read      all of it; anything raised but InputError means damage
    ups       axes that may point up, the format's convention first
    """

    name: str
    matches: Callable[[Head], bool]
    describe: Callable[[Path], Recognised]
    read: Callable[[Path], Shape]
    ups: tuple[str, ...] = field(default=("z", "y"))


def counted(count: int, one: str, many: str = "") -> str:
    """ "1 part", "4 parts", "1,204 faces"."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"


def cloud_of(count: int, most: int = limits.POINTS) -> str:
    """A point cloud in words, and how much of a large one is used."""
    return f"a point cloud of {count:,} points" + (f", {most:,} of them used" if count > most else "")


def splat_of(count: int, name: str = "") -> str:
    """A splat in words, and how much of a large one is used."""
    used = f", {limits.GAUSSIANS:,} of them used" if count > limits.GAUSSIANS else ""
    return f"a Gaussian splat of {count:,} Gaussians" + used + (f" ({name})" if name else "")


def not_too_many(path: Path, faces: int) -> None:
    """Raises InputError when a mesh has more faces than memory holds."""
    if faces > limits.FACES:
        raise InputError(
            f"{path} has {faces:,} faces or vertices, more than the {limits.FACES:,} that are read here; decimate it, "
            "or save its points alone"
        )
