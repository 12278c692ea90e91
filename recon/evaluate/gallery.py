"""One picture a class: random shapes, and held-out shapes beside what the network and the searches make of them.

    python -m recon.evaluate gallery --class chair --out docs/gallery

As in the paper's Figures 3, 5 and 6. The same class and weights give the same picture.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from nnproc.infer import grids_from_params, load_network
from procmodels import Model, load
from procmodels.shape import Part, Shape
from recon.evaluate.data.held_out import Case, bank_path, cases
from recon.evaluate.metrics import chamfer, d_voxel
from recon.evaluate.tables.methods import METHODS, Bench
from recon.outputs.previews import render_previews

CAMERAS = "spread"  # the four cameras of the pictures' Task 4
MARGIN, GAP, CAPTION = 10, 8, 24  # pixels
PAPER, INK = (250, 249, 246), (38, 36, 33)  # RGB
CUBE = 0.9  # side of a drawn voxel, share of the voxel: the gaps show the grid
LARGEST = 250_000  # bytes of a file; the quality gives way
# Corners of a cube, number 4 x + 2 y + z, and its sides, counter-clockwise seen from outside.
_CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_SIDES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])

Tile = tuple[str, Shape | None]  # caption and what is drawn; None leaves the place empty


@dataclass(frozen=True)
class GalleryOptions:
    """What a picture shows and where it goes."""

    shapes: int = 12  # random ones
    columns: int = 6  # of the random ones
    held_out: int = 3  # rows of held-out shapes
    grid: str = "on"  # their scalars: "on" the grid, as in the paper, or "off" it
    width: int = 1400  # pixels
    quality: int = 85  # of the JPEG
    seed: int = 3
    task4: bool | None = None  # the search from four outlines; None: when the class's bank of outlines is there
    out: Path = Path("docs/gallery")
    data: Path = Path(".cache/data")  # generated pairs, for the bank of outlines
    work: Path = Path(".cache/evaluate")


def run(classes: list[str], options: GalleryOptions = GalleryOptions()) -> Iterator[Path]:
    """Draw the picture of each, CLASS.jpg, of classes of the paper; yields their paths.

    Raises ModelError and WeightsError.
    """
    for name in classes:
        model = load(f"paper/{name}")
        bench = Bench(model, load_network(model.space, model.weights, decoder=True), options.work, options.data)
        picture = draw([_random_shapes(model, options), *held_out_rows(bench, options)], options)
        options.out.mkdir(parents=True, exist_ok=True)
        path = options.out / f"{name}.jpg"
        path.write_bytes(jpeg(picture, options.quality))
        yield path


def _random_shapes(model: Model, options: GalleryOptions) -> list[Tile]:
    generators = [np.random.default_rng([options.seed, i]) for i in range(options.shapes)]
    return [("", model.build(model.space.sample(rng))) for rng in generators]


def held_out_rows(bench: Bench, options: GalleryOptions) -> list[list[Tile]]:
    """A row a shape: the shape | the network's voxels | rebuilt from its grid | rebuilt from four outlines."""
    task4 = options.task4
    if task4 is None:
        task4 = bank_path(bench.model, CAMERAS, options.work).is_file()
    return [
        _row(bench, case, f"held-out shape, {options.grid}-grid", task4)
        for case in cases(bench.model, options.grid, options.held_out)
    ]


def _row(bench: Bench, case: Case, title: str, task4: bool) -> list[Tile]:
    grid = grids_from_params(bench.network, bench.network.codec.vectors([case.params]))[0]
    voxels = f"Task 1, its voxels by the network: {d_voxel(grid, case.grid):.2f} % differ"
    row: list[Tile] = [(title, case.shape), (voxels, cubes(grid) if grid.any() else None)]
    tasks = {"2": "Task 2, from its grid"} | ({f"4 {CAMERAS}": "Task 4, from 4 outlines"} if task4 else {})
    for task, source in tasks.items():
        found = bench.model.build(METHODS[task]["ours"](bench, case))
        row.append((f"{source}: D_chamfer {chamfer(found.to_trimesh(), case.mesh):.5f}", found))
    return row


def cubes(grid: np.ndarray) -> Shape:
    """The occupied voxels of a (R, R, R) bool grid as small cubes, one part, in the canonical frame."""
    size = len(grid)
    centres = (np.argwhere(grid) + 0.5) / size - 0.5
    vertices = (centres[:, None] + _CORNERS * CUBE / size).reshape(-1, 3)
    faces = (np.arange(len(centres))[:, None, None] * len(_CORNERS) + _SIDES).reshape(-1, 4)
    return Shape((Part("voxels", vertices, tuple(map(tuple, faces.tolist()))),))


def draw(groups: list[list[Tile]], options: GalleryOptions) -> np.ndarray:
    """(H, width, 3) uint8 RGB: the first group in rows of `columns`, then every group as a row with captions."""
    first = [groups[0][i : i + options.columns] for i in range(0, len(groups[0]), options.columns)]
    rows = [(row, options.columns, 0) for row in first]
    rows += [(row, max(len(row), 3), CAPTION) for row in groups[1:]]
    return stacked([strip(row, columns, caption, options.width) for row, columns, caption in rows])


def stacked(strips: list[np.ndarray]) -> np.ndarray:
    """(H, width, 3) uint8 RGB: strips below each other."""
    height = MARGIN + sum(s.shape[0] for s in strips) + GAP * (len(strips) - 1) + MARGIN
    sheet = np.full((height, strips[0].shape[1], 3), PAPER, np.uint8)
    y = MARGIN
    for s in strips:
        sheet[y : y + len(s)] = s
        y += len(s) + GAP
    return sheet


def strip(row: list[Tile], columns: int, caption: int, width: int) -> np.ndarray:
    """(side + caption, width, 3) uint8 RGB, square pictures side by side."""
    side = (width - 2 * MARGIN - GAP * (columns - 1)) // columns
    image = Image.new("RGB", (width, side + caption), PAPER)
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(15)
    for i, (text, shape) in enumerate(row):
        x = MARGIN + i * (side + GAP)
        if shape is not None:
            image.paste(Image.fromarray(render_previews(shape, 1, (side, side))[0]), (x, 0))
        pen.text((x + 2, side + 3), text, INK, font)
    return np.asarray(image)


def jpeg(picture: np.ndarray, quality: int) -> bytes:
    """The file's bytes, at most LARGEST where any quality above 40 allows it."""
    while True:
        ok, data = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
        if not ok:
            raise ValueError("the picture cannot be encoded as JPEG")
        if len(data) <= LARGEST or quality <= 40:
            return data.tobytes()
        quality -= 5
