"""What a printed sheet gives, on six rendered photo sets: size, up, and cameras where the floor is plain.

    python -m recon.evaluate sheet

Own chairs in a rendered room (those of `evaluate chair`) with sheets on the floor as texture; the floor is patterned or
of one colour, as in the set of `evaluate alignment` that fails without a sheet.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from datasets.photosets import Photoset, PhotosetOptions, read_photoset, render_photoset
from procmodels import Model, load
from procmodels.studio.room import Paper
from recon.evaluate.chair import hidden_params, read_result, reconstruct
from recon.evaluate.data.scenes import misaligned
from recon.evaluate.rows import Row
from recon.scene import ReconError
from recon.sheet.drawing import page
from recon.sheet.layout import PAPERS
from recon.system.whole_files import write_picture

OPTIONS = PhotosetOptions(views=20, width=1280, height=960, samples=4, up="z", front="-y")
PAGE_DPI = 150.0  # of the pictures that lie on the floor: finer than any photo shows


@dataclass(frozen=True)
class Lying:
    """A sheet of a paper on the floor: metres from the object's middle, degrees, and the size of the print."""

    paper: str
    x: float
    y: float
    degrees: float
    sheet: int = 1
    printed: float = 1.0


@dataclass(frozen=True)
class Kind:
    """One set: a chair of `evaluate chair`, sheets on the floor, and the room."""

    name: str
    chair: int
    sheets: tuple[Lying, ...]
    room: dict[str, Any] = field(default_factory=dict)  # of PhotosetOptions


KINDS = (
    Kind("patterned floor, A4", 0, (Lying("A4", 0.52, -0.3, 25),)),
    Kind("plain floor, A4", 4, (Lying("A4", 0.5, -0.35, 70),), {"floor": "plain"}),
    Kind("plain floor, A3", 1, (Lying("A3", -0.55, 0.3, 140),), {"floor": "plain"}),
    Kind("plain floor, two A4", 2, (Lying("A4", 0.5, 0.3, 10), Lying("A4", -0.5, -0.35, 200, 2)), {"floor": "plain"}),
    Kind("rug, A4 on it", 3, (Lying("A4", 0.48, -0.4, 300),), {"rug": True}),
    Kind("patterned floor, Letter half under the chair", 5, (Lying("Letter", 0.25, -0.25, 45),)),
)


@dataclass(frozen=True)
class Measured:
    """Share of photos registered; degrees of up and yaw; shares that the size is off, by the sheet and of the chair."""

    registered: float
    up: float
    yaw: float
    metres: float
    size: float


FAILED = Measured(0.0, np.inf, np.inf, np.inf, np.inf)


def run(work: Path, only: Sequence[str] = ()) -> Iterator[Row]:
    """Rows of every set. `only`: names of kinds; empty: all."""
    model = load("chair")
    for kind in KINDS:
        if only and kind.name not in only:
            continue
        found = _measured(model, work, kind)
        yield Row(f"{kind.name}: photos registered, share", found.registered, ">= 1")
        yield Row(f"{kind.name}: height of the chair by the sheet off, share", found.metres, "<= 0.005")
        yield Row(f"{kind.name}: up, degrees off", found.up, "<= 0.3")
        yield Row(f"{kind.name}: yaw, degrees off", found.yaw, "<= 2")
        yield Row(f"{kind.name}: size of the chair off, share", found.size, "<= 0.02")


def _measured(model: Model, work: Path, kind: Kind) -> Measured:
    """Reconstruct one set; infinitely far off when the command gives no result."""
    truth, out = rendered(model, work, kind), work / "sheet" / "out" / _folder(kind)
    shutil.rmtree(out, ignore_errors=True)
    try:
        report = reconstruct(truth.photos[0].parent, out)
    except ReconError as error:
        tqdm.write(f"{kind.name}: {error}")
        return FAILED
    _, cameras, canonical = read_result(model, out)
    found = misaligned(truth, cameras, canonical)
    told = report["size"]["height_metres"]
    off = np.inf if told is None else abs(told / truth.info["options"]["object_height"] - 1)
    return Measured(report["registered"]["n"] / len(truth.names), found.up, abs(found.yaw), off, found.size)


def _folder(kind: Kind) -> str:
    return kind.name.replace(",", "").replace(" ", "_")


def rendered(model: Model, work: Path, kind: Kind, options: PhotosetOptions = OPTIONS) -> Photoset:
    """The photo set with its truth, rendered once and kept below `work`/sheet."""
    folder = work / "sheet" / _folder(kind)
    if not (folder / "truth" / "cameras.json").is_file():
        folder.parent.mkdir(parents=True, exist_ok=True)
        mesh = folder.with_suffix(".ply")
        model.build(hidden_params(model)[kind.chair]).to_trimesh().export(mesh)
        papers = tuple(_paper(folder.parent, s) for s in kind.sheets)
        render_photoset(mesh, folder, replace(options, seed=kind.chair, papers=papers, **kind.room))
    return read_photoset(folder)


def _paper(folder: Path, lying: Lying) -> Paper:
    """The page as a picture in `folder`, and where it lies."""
    paper = PAPERS[lying.paper]
    path = folder / f"{lying.paper}_{lying.sheet}.png"
    write_picture(path, np.asarray(cv2.GaussianBlur(page(paper, lying.sheet, PAGE_DPI), (0, 0), 0.6), np.uint8))
    size = (1e-3 * lying.printed * paper.width, 1e-3 * lying.printed * paper.height)
    return Paper(str(path), size, (lying.x, lying.y), float(np.radians(lying.degrees)))
