"""Masks of real photographs with their true models (Pix3D), camera unknown: outline agreement and D_chamfer.

A folder holds NAME.png (white = object) and NAME.ply (the true model, y up, facing -z). The estimated pose is undone by
comparing in the canonical frame: the true model is stood upright (its up axis is known), both are normalised, and the
best of four quarter turns about the vertical counts, because which side is the front cannot always be told.

    python -m recon.evaluate.pix3d_dev ../shared/data/pix3d_dev/chair --class chair --out .cache/pix3d_chair
"""

from __future__ import annotations

import csv
import logging
import sys
import time
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import cv2
import numpy as np
import trimesh

from datasets.pix3d import PIX3D_FROM_CANONICAL
from procmodels import Model, load
from recon.evaluate.data.scenes import read_mask
from recon.evaluate.metrics import best_turn
from recon.evaluate.rows import Row, print_table
from recon.fitting.camera_search import FoundView, find
from recon.fitting.one_view import CameraSearchOptions, OneView
from recon.fitting.silhouette_bank import load_bank
from recon.geometry.raster import iou, silhouettes
from recon.geometry.view_geometry import guessed_K, mask_box
from recon.scene import Cameras, InputError, cam_from_canonical
from recon.system import net, process
from recon.system.arguments import Parser, readable
from recon.system.whole_files import write_picture

SIDE = 1000  # px, longest side that masks are reduced to
AIMS = {"iou": ">= 0.8", "d_chamfer": "<= 0.015"}


@dataclass(frozen=True)
class Measured:
    """One object; d_chamfer and front (quarter turns that were needed, 0 = the front is right) are empty without a
    true model. seconds is processor time, so that a busy machine does not matter."""

    object: str
    iou: float
    d_chamfer: float | None
    front: int | None
    azimuth: float
    elevation: float
    seconds: float
    params: str


def run(
    folder: Path,
    model: Model,
    out: Path | None = None,
    limit: int | None = None,
    options: CameraSearchOptions = CameraSearchOptions(),
) -> list[Measured]:
    """Measure the masks of a folder; with `out`, each adds a row to objects.csv and an overlay NAME.png there."""
    bank = load_bank(model, options.bank)
    rows = []
    for file in sorted(folder.glob("*.png"))[:limit]:
        mask = _reduced(read_mask(file))
        started = time.process_time()
        found = find(model, OneView(mask, guessed_K(mask.shape[1], mask.shape[0])), bank, options)
        seconds = time.process_time() - started
        drawn = redrawn(model, found, mask.shape)
        distance, turn = _distance(model, found, file.with_suffix(".ply"))
        values = " ".join(f"{k}={v if isinstance(v, str) else round(v, 3)}" for k, v in found.refined.params.items())
        place = round(found.azimuth, 1), round(found.elevation, 1)
        rows.append(Measured(file.stem, round(iou(mask, drawn), 4), distance, turn, *place, round(seconds, 1), values))
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
            write_picture(out / file.name, overlay(mask, drawn))
            write_csv(rows, out / "objects.csv")
    return rows


def redrawn(model: Model, found: FoundView, shape: tuple[int, ...]) -> np.ndarray:
    """(H, W) bool: the answer's silhouette in an image of that shape."""
    size = np.array([[shape[1], shape[0]]])
    cameras = Cameras(("view",), found.K[None], found.cam_from_world[None], size)
    poses = cam_from_canonical(cameras, found.refined.canonical)
    return silhouettes(model.build(found.refined.params), cameras.K, poses, size)[0]


def overlay(mask: np.ndarray, drawn: np.ndarray, side: int = 300) -> np.ndarray:
    """(h, w, 3) uint8 BGR round the object: white where both are, blue the mask alone, red the answer alone."""
    picture = np.stack([mask, mask & drawn, drawn], -1).astype(np.uint8) * 255
    x, y, w, h = (int(v) for v in mask_box(mask | drawn) or (0, 0, mask.shape[1], mask.shape[0]))
    scale = side / max(w, h)
    size = max(1, round(w * scale)), max(1, round(h * scale))
    return cv2.resize(picture[y : y + h, x : x + w], size, interpolation=cv2.INTER_AREA)


def _distance(model: Model, found: FoundView, file: Path) -> tuple[float | None, int | None]:
    """D_chamfer to the true model after the best quarter turn, and that turn."""
    if not file.is_file():
        return None, None
    truth = trimesh.load_mesh(file, process=False)
    upright = trimesh.Trimesh(truth.vertices @ PIX3D_FROM_CANONICAL, truth.faces, process=False)
    best, turn = best_turn(model.build(found.refined.params).to_trimesh(), upright, 5000)
    return round(best, 5), turn


def _reduced(mask: np.ndarray) -> np.ndarray:
    scale = SIDE / max(mask.shape)
    if scale >= 1:
        return mask
    return cv2.resize(mask.astype(np.float32), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) > 0.5


def write_csv(rows: list[Measured], file: Path) -> None:
    """One line an object; written whole or not at all."""
    partial = file.with_suffix(".partial")
    with partial.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, [f.name for f in fields(Measured)])
        writer.writeheader()
        writer.writerows(asdict(r) for r in rows)
    partial.replace(file)


def summary(rows: list[Measured]) -> list[Row]:
    """The means beside what was aimed at."""
    known = [r for r in rows if r.d_chamfer is not None]
    out = [Row(f"{len(rows)} masks, camera unknown: mean IoU", float(np.mean([r.iou for r in rows])), AIMS["iou"])]
    if known:
        mean = float(np.mean([r.d_chamfer for r in known if r.d_chamfer is not None]))
        out.append(Row("mean D_chamfer, best of four quarter turns", mean, AIMS["d_chamfer"]))
        out.append(Row("front right, share", float(np.mean([r.front == 0 for r in known]))))
    out.append(Row("processor seconds a mask", float(np.mean([r.seconds for r in rows])), "<= 60"))
    return out


def main(argv: list[str] | None = None) -> int:
    """The command line; exit code 1 when an aim is missed."""
    net.quiet(verbose=False)
    return net.run(lambda about: _command(argv, about))


def _command(argv: list[str] | None, about: net.About) -> int:
    """Measure and tell; raises what net.run says to the user."""
    parser = Parser(prog="python -m recon.evaluate.pix3d_dev", description=__doc__)
    parser.add_argument("folder", type=Path, help="NAME.png masks, and NAME.ply models where they are known")
    parser.add_argument("--class", dest="class_name", default="chair")
    parser.add_argument("--out", type=Path, default=Path(".cache/pix3d_dev"), help="objects.csv and overlays")
    parser.add_argument("--limit", type=int, help="only the first masks")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    about.what = args.folder
    readable(args.folder, "FOLDER")
    try:
        rows = run(args.folder, load(args.class_name), args.out, args.limit)
    except ValueError as error:
        raise InputError(str(error)) from error
    if not rows:
        raise InputError(f"{args.folder} holds no .png masks")
    table = summary(rows)
    print_table(table, sys.stdout)
    return 0 if all(r.holds for r in table) else 1


if __name__ == "__main__":
    sys.exit(process.run(main))
