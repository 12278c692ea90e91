"""The paper's Table 2: real objects and their reconstructions from every kind of input, with the oracle beside each.

    python -m recon.evaluate table2 --data PATH --class chair --limit 10 --json rows.json

PATH is whatever datasets.catalogues knows: ShapeNet, Pix3D, a Sweet Home 3D catalogue, a folder of meshes. An
object's rows are kept in the work folder as soon as it is done, so that an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import csv
import hashlib
import json
import logging
import zlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from datasets.catalogues import DataError, RealObject, objects
from datasets.jobs import Backend, Here, in_order
from procmodels import Model, load
from procmodels.registry import PAPER
from recon.evaluate.tables.oracle import OracleOptions, oracle
from recon.evaluate.tables.real_answers import INPUTS
from recon.evaluate.tables.real_pictures import object_picture, worst_sheet
from recon.evaluate.tables.table2_rows import Table2Row
from recon.scene import ReconError
from recon.system.digests import code_version

log = logging.getLogger("recon")

# Figures of the paper's Table 2 (ShapeNet meshes and points, Pix3D photographs), to print beside ours.
PAPER_FIGURES = {
    "mesh": {"bed": 0.0023, "chair": 0.0021, "shelf": 0.0079, "table": 0.0030},
    "500 points": {"bed": 0.0106, "chair": 0.0057, "shelf": 0.0593, "table": 0.0134},
    "1 mask, camera known": {"bed": 0.0072, "chair": 0.0452, "shelf": 0.0129, "table": 0.0055},
}


@dataclass(frozen=True)
class Table2Options:
    """What is measured."""

    data: tuple[Path, ...] = ()
    classes: tuple[str, ...] = ("bed", "chair", "shelf", "sofa", "table")
    inputs: tuple[str, ...] = tuple(INPUTS)
    limit: int | None = None  # objects a class and source, the first ones; all
    seed: int = 0
    oracle: OracleOptions = field(default_factory=OracleOptions)
    work: Path = Path(".cache/evaluate")


def run(options: Table2Options, backend: Backend = Here()) -> Iterator[list[Table2Row]]:
    """The rows of one object after another, measured by any back end.

    Raises DataError for unusable data, ModelError, WeightsError.
    """
    plain = {**asdict(options), "data": [str(p.absolute()) for p in options.data], "work": str(options.work.absolute())}
    for class_name in options.classes:
        count = len(_listed(options, class_name))
        jobs = ({"options": plain, "class": class_name, "number": number} for number in range(count))
        outcomes = in_order(backend.map(one_object, jobs))
        for outcome in tqdm(outcomes, total=count, desc=class_name, disable=None):
            if outcome.error is not None or "left_out" in outcome.value:
                log.warning("left out: %s", outcome.error or outcome.value["left_out"])
            else:
                yield [Table2Row.from_json(row) for row in outcome.value["rows"]]


def one_object(job: dict[str, Any]) -> dict[str, Any]:
    """What a worker does: {"rows"} of an object of a class, or {"left_out"}, why it cannot be used."""
    told = dict(job["options"])
    places = {"data": tuple(map(Path, told["data"])), "work": Path(told["work"])}
    lists = {"classes": tuple(told["classes"]), "inputs": tuple(told["inputs"])}
    search = OracleOptions(**{**told["oracle"], "seeds": tuple(told["oracle"]["seeds"])})
    options = Table2Options(**{**told, **places, **lists, "oracle": search})
    try:
        item = _kept_list(options, job["class"])[job["number"]]
        return {"rows": [row.as_json() for row in measured(load(job["class"]), item, options)]}
    except DataError as error:
        return {"left_out": str(error)}


@cache
def _kept_list(options: Table2Options, class_name: str) -> list[RealObject]:
    return _listed(options, class_name)


def _listed(options: Table2Options, class_name: str) -> list[RealObject]:
    """Objects of a class from all sources, by turns, so that a run stopped early has seen some of each."""
    lists = []
    for path in options.data:
        try:
            lists.append(objects(path, class_name.removeprefix(PAPER))[: options.limit])
        except DataError as error:
            if len(options.data) == 1 and len(options.classes) == 1:
                raise
            log.info("%s", error)
    longest = max(map(len, lists), default=0)
    return [found[i] for i in range(longest) for found in lists if i < len(found)]


def measured(model: Model, item: RealObject, options: Table2Options) -> list[Table2Row]:
    """All inputs of one object, from the work folder when they were measured with this version, weights and options."""
    weights = model.weights
    trained = weights.read_bytes() if weights.is_file() else b""
    about = f"{code_version()} {model.space.hash} {options.seed} {options.oracle}"
    key = hashlib.sha256(about.encode() + trained).hexdigest()[:8]
    name = picture_name(item.data, model.name, item.name)
    folder = options.work / "table2"
    file = folder / f"{name}_{key}.json"
    kept = {r["input"]: r for r in json.loads(file.read_text())} if file.is_file() else {}
    if not (missing := [i for i in options.inputs if i not in kept]):
        return [Table2Row.from_json(kept[i]) for i in options.inputs]
    mesh = item.load()
    # Whatever is fitted to an object, it is seen from the same places.
    seed = zlib.crc32(picture_name(item.data, item.class_name, item.name).encode()) + options.seed
    best_params, best = (
        oracle(model, mesh, options.oracle) if not kept else ({}, min(r["oracle"] for r in kept.values()))
    )
    rows = [Table2Row.from_json(r) for r in kept.values()]
    for input_name in missing:
        row = Table2Row(item.data, model.name, input_name, item.name, oracle=best)
        try:
            found = INPUTS[input_name](model, mesh, seed)
        except ReconError as error:
            rows.append(replace(row, error=str(error)))
            continue
        row = replace(
            row,
            d_chamfer=round(found.d_chamfer, 6),
            turn=found.turn,
            iou=None if found.iou is None else round(found.iou, 4),
            seconds=round(found.seconds, 2),
            params=found.params,
        )
        rows.append(row)
        if found.d_chamfer < best:
            best, best_params = found.d_chamfer, found.params
    rows = [replace(r, oracle=round(best, 6)) for r in rows]
    object_picture(model, mesh, rows, best_params, folder / f"{name}.jpg")
    write_rows(rows, file)
    found_rows = {r.input: r for r in rows}
    return [found_rows[i] for i in options.inputs]


def picture_name(data: str, class_name: str, name: str) -> str:
    """What the files of an object are called."""
    return f"{data}_{class_name}_{name}".replace("/", "-").replace(" ", "-")


def write_rows(rows: list[Table2Row], file: Path) -> None:
    """All rows as a JSON list, a line each; written whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_suffix(".partial")
    partial.write_text("[\n" + ",\n".join(json.dumps(r.as_json()) for r in rows) + "\n]\n")
    partial.replace(file)


def write_csv(rows: list[Table2Row], file: Path) -> None:
    """One line an object and input; written whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_suffix(".partial")
    with partial.open("w", newline="", encoding="utf-8") as stream:
        names = [k for k in rows[0].as_json() if k != "params"] + ["params"]
        writer = csv.DictWriter(stream, names)
        writer.writeheader()
        for row in rows:
            values = row.as_json()
            values["params"] = " ".join(
                f"{k}={v:.4g}" if isinstance(v, float) else f"{k}={v}" for k, v in row.params.items()
            )
            writer.writerow(values)
    partial.replace(file)


def summary(rows: list[Table2Row]) -> str:
    """A Markdown line a class and input: means over its objects beside the oracle's and the paper's."""
    head = ["class", "input", "objects", "D_chamfer", "median", "oracle", "times the oracle", "paper", "front right"]
    head += ["IoU", "processor s"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for class_name, input_name in dict.fromkeys((r.class_name, r.input) for r in rows):
        group = [r for r in rows if (r.class_name, r.input) == (class_name, input_name)]
        done = [r for r in group if r.d_chamfer is not None]
        if not done:
            lines.append(f"| {class_name} | {input_name} | 0 of {len(group)} |" + " |" * 8)
            continue
        distances = np.array([r.d_chamfer for r in done])
        best = float(np.mean([r.oracle for r in done]))
        paper = PAPER_FIGURES.get(input_name, {}).get(class_name.removeprefix(PAPER))
        agreements = [r.iou for r in done if r.iou is not None]
        count = str(len(done)) if len(done) == len(group) else f"{len(done)} of {len(group)}"
        cells = [class_name, input_name, count, f"{distances.mean():.4f}", f"{np.median(distances):.4f}", f"{best:.4f}"]
        cells += [f"{distances.mean() / best:.2f}", "" if paper is None else f"{paper:.4f}"]
        cells += [f"{100 * np.mean([r.turn == 0 for r in done]):.0f} %"]
        cells += [f"{np.mean(agreements):.3f}" if agreements else ""]
        cells += [f"{np.mean([r.seconds for r in done if r.seconds is not None]):.1f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def worst(rows: list[Table2Row], input_name: str = "mesh", count: int = 10) -> dict[str, list[Table2Row]]:
    """The objects of each class with the largest D_chamfer, worst first; those without an answer before all."""
    out: dict[str, list[Table2Row]] = {}
    for row in sorted(rows, key=lambda r: -(np.inf if r.d_chamfer is None else r.d_chamfer)):
        if row.input == input_name and len(out.setdefault(row.class_name, [])) < count:
            out[row.class_name].append(row)
    return out


def write_worst(rows: list[Table2Row], work: Path) -> list[Path]:
    """A sheet of the worst of each class: worst_CLASS.jpg in the work folder."""
    out = []
    for class_name, group in worst(rows).items():
        pictures = [work / "table2" / f"{picture_name(r.data, r.class_name, r.object)}.jpg" for r in group]
        if sheet := worst_sheet(pictures, work / f"worst_{class_name.replace('/', '-')}.jpg"):
            out.append(sheet)
    return out
