"""Silhouettes of things of known kinds: shapes of the rich classes' priors, and labelled real objects, seen all round.

    python -m datasets.outlines --out DIR --data ikea_dev --data pix3d_dev

The file says of every picture whose it is, so that a network can be tried on objects that it has not seen.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from tqdm import tqdm

from datasets import part_labels
from datasets.camera_rings import look_at
from datasets.catalogue_object import DataError
from datasets.hulls import silhouette
from datasets.outline_frame import KINDS, framed
from procmodels import load
from procmodels.registry import HERE

log = logging.getLogger(__name__)
WORDS = {"table": "table", "desk": "table", "workbench": "table", "bed": "bed", "shelf": "shelf", "cabinet": "shelf"}
PIXELS = 128  # along each side of the window that an object fills
Draw = Callable[[np.ndarray], np.ndarray]  # (3, 4) pixels from canonical -> (PIXELS, PIXELS) mask


@dataclass(frozen=True)
class OutlineOptions:
    """How many pictures, and from where."""

    shapes: int = 2000  # of each rich class
    views: int = 3  # of each of them
    real: tuple[int, int, int] = (80, 60, 30)  # of each real object: of the class with labels, of others, of the rest
    elevations: tuple[float, float] = (-8.0, 50.0)  # degrees
    distances: tuple[float, float] = (1.2, 4.0)  # canonical units, from the middle
    roll: float = 2.0  # degrees, spread
    stretch: tuple[float, float] = (0.85, 1.18)  # of a real object's sides
    fringe: int = 2  # px by which outlines are too fat or too thin at most
    torn: float = 0.1  # share of the outlines that lack a piece
    seed: int = 0


@dataclass(frozen=True)
class Outlines:
    """bits (n, 512) uint8 packed pictures of 64 x 64; kinds (n,) of KINDS; owners (n,) places in `names`, -1: made."""

    bits: np.ndarray
    kinds: np.ndarray
    owners: np.ndarray
    names: tuple[str, ...]

    def pictures(self, index: np.ndarray) -> np.ndarray:
        """(m, 64, 64) bool."""
        return np.unpackbits(self.bits[index], axis=1).reshape(-1, 64, 64).astype(bool)


def camera(points: np.ndarray, rng: np.random.Generator, options: OutlineOptions) -> np.ndarray:
    """(3, 4) pixels of a window that points (n, 3), an object's, fill, from a random place round it."""
    middle = (points.min(0) + points.max(0)) / 2
    azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(*options.elevations))
    way = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    pose = look_at(middle + rng.uniform(*options.distances) * np.ptp(points, 0).max() * way, middle)[:3]
    roll = np.radians(rng.normal(0, options.roll))
    turn = np.array([(np.cos(roll), -np.sin(roll), 0), (np.sin(roll), np.cos(roll), 0), (0, 0, 1)])
    pose = turn @ pose
    local = points @ pose[:, :3].T + pose[:, 3]
    seen = local[:, :2] / np.maximum(local[:, 2:], 1e-3)
    low, high = seen.min(0), seen.max(0)
    focal = 0.94 * PIXELS / max((high - low).max(), 1e-9)
    place = PIXELS / 2 - focal * (low + high) / 2
    return np.array([(focal, 0, place[0]), (0, focal, place[1]), (0, 0, 1)]) @ pose


def seen_by_rays(mesh: trimesh.Trimesh) -> Draw:
    """Pictures of any mesh, also of an open one."""
    import open3d as o3d

    tensor: Any = o3d.core.Tensor
    scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(tensor(mesh.vertices.astype(np.float32)), tensor(mesh.faces.astype(np.uint32)))
    u, v = np.meshgrid(np.arange(PIXELS) + 0.5, np.arange(PIXELS) + 0.5)
    pixels = np.stack([u, v, np.ones_like(u)], -1)

    def draw(matrix: np.ndarray) -> np.ndarray:
        inverse = np.linalg.inv(matrix[:, :3])
        ways = pixels @ inverse.T
        origins = np.broadcast_to(-inverse @ matrix[:, 3], ways.shape)
        rays = np.concatenate([origins, ways], -1).astype(np.float32)
        return scene.test_occlusions(tensor(np.ascontiguousarray(rays)), nthreads=1).numpy()

    return draw


def worn(mask: np.ndarray, rng: np.random.Generator, options: OutlineOptions) -> np.ndarray:
    """A silhouette as masks of photos are: a little fat or thin, sometimes with a piece missing."""
    out = mask.astype(np.uint8)
    grown = int(rng.integers(-options.fringe, options.fringe + 1))
    if grown:
        kernel = np.ones((abs(grown) + 1,) * 2, np.uint8)
        out = np.asarray(cv2.dilate(out, kernel) if grown > 0 else cv2.erode(out, kernel), np.uint8)
    if rng.random() < options.torn:
        side, row, column = (int(x * PIXELS) for x in (rng.uniform(0.05, 0.25), *rng.random(2)))
        out[row : row + side, column : column + side] = 0
    return out > 0


def run(data: list[Path], options: OutlineOptions = OutlineOptions()) -> Outlines:
    """Made and real things, in an order of their own. Raises DataError when no real one is there."""
    bits: list[np.ndarray] = []
    kinds: list[int] = []
    owners: list[int] = []

    def add(kind: str, owner: int, points: np.ndarray, draw: Draw, rng: np.random.Generator) -> None:
        picture = framed(worn(draw(camera(points, rng, options)), rng, options))
        if picture.any():
            bits.append(np.packbits(picture))
            kinds.append(KINDS.index(kind))
            owners.append(owner)

    for number, kind in enumerate(KINDS[:-1]):
        model = load(str(HERE / "classes" / f"{kind}.py"))  # whether its network is trained or not
        for i in tqdm(range(options.shapes), f"outlines: {kind}", disable=None):
            rng = np.random.default_rng([options.seed, 1, number, i])
            shape = model.build(model.space.sample(rng))
            points = shape.vertices()
            for _ in range(options.views):
                add(kind, -1, points, lambda P, s=shape: silhouette(s, P, PIXELS), rng)  # type: ignore[misc]
    names = _real(data, options, add)
    return Outlines(np.stack(bits), np.array(kinds), np.array(owners), names)


def _real(data: list[Path], options: OutlineOptions, add: Callable[..., None]) -> tuple[str, ...]:
    """The labelled objects that are there, stretched and mirrored."""
    there = part_labels.objects(data)
    words = {name: "chair" for name in part_labels.parts("chair")}
    words |= {name: WORDS.get(word, "other") for name, word in part_labels.others("chair").items()}
    names = tuple(sorted(set(words) & set(there)))
    if not names:
        raise DataError("none of the labelled objects is in the data; see datasets/part_labels.py for where they are")
    for owner, name in enumerate(tqdm(names, "outlines: real objects", disable=None)):
        try:
            mesh = there[name].load()
        except DataError as error:  # a mask alone, or a damaged one
            log.warning("%s is left out: %s", name, error)
            continue
        rng = np.random.default_rng([options.seed, 2, owner])
        kind, (mine, near, rest) = words[name], options.real
        count = mine if kind == "chair" else rest if kind == "other" else near
        for turn in range(0, count, 10):  # a scene of triangles is made for every ten pictures
            sides = rng.uniform(*options.stretch, 3) * (rng.choice([-1, 1]), 1, 1)
            some = trimesh.Trimesh(mesh.vertices * sides, mesh.faces, process=False)
            draw = seen_by_rays(some)
            for _ in range(min(10, count - turn)):
                add(kind, owner, np.asarray(some.vertices), draw, rng)
    return names


def save(file: Path, outlines: Outlines) -> None:
    """Write them; whole or not at all."""
    partial = file.with_suffix(".partial.npz")
    np.savez(
        partial,
        bits=outlines.bits,
        kinds=outlines.kinds.astype(np.uint8),
        owners=outlines.owners.astype(np.int32),
        names=np.array(outlines.names),
    )
    partial.replace(file)


def read(file: Path) -> Outlines:
    """As `save` wrote them."""
    with np.load(file, allow_pickle=False) as held:
        return Outlines(held["bits"], held["kinds"].astype(int), held["owners"], tuple(str(n) for n in held["names"]))


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m datasets.outlines", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder")
    parser.add_argument("--data", type=Path, action="append", default=[], help="beside Debian's catalogues; repeated")
    parser.add_argument("--shapes", type=int, default=OutlineOptions.shapes, help="of each class")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    log.setLevel(logging.INFO)
    args.out.mkdir(parents=True, exist_ok=True)
    try:
        found = run([*args.data, part_labels.DEBIAN], OutlineOptions(shapes=args.shapes))
    except DataError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    save(args.out / "outlines.npz", found)
    log.info("%d outlines, %d of %d real objects", len(found.bits), (found.owners >= 0).sum(), len(found.names))
    return 0


if __name__ == "__main__":
    sys.exit(main())
