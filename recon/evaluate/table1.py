"""The paper's Table 1, measured here: four tasks, the baseline, SE + PD alone and the ablations.

    python -m recon.evaluate table1 --class chair --shapes 300 --method ours --json docs/results/table1_chair.json

Rows already measured with the same weights are kept in the work folder and not measured again.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
import torch
from tqdm import tqdm

from datasets.voxels import surface_grid
from nnproc.infer import WEIGHTS, grids_from_params, load_network, save_network
from nnproc.losses import VARIANTS
from nnproc.train import TrainOptions, train
from procmodels import Model, load
from procmodels.space import Params
from recon.evaluate.held_out import Case, cases
from recon.evaluate.methods import METHODS, Bench, Method
from recon.evaluate.metrics import chamfer, d_voxel
from recon.evaluate.rows import machine

GRIDS = ("on", "off")
TASKS = ("1", *METHODS)
SHORT = "same budget"  # our full loss, trained as briefly as the ablations
ABLATIONS = {"without KL": "without_kl", "without sim": "without_sim", "without both": "without_both", SHORT: "full"}
SIMPLE = {"simple": "simple"}
ALL_METHODS = ("spread", "ours", "refined", "paper", "cobyqa", *SIMPLE, *ABLATIONS)
# Figures of the paper's Table 1 for its own method, to print beside ours: D_voxel for Task 1, else D_chamfer.
PAPER_FIGURES = {
    "table": {"spread": 0.066, "1": 0.75, "2": 0.0003, "3": 0.0031, "4 paper": 0.0117},
    "sofa": {"spread": 0.0033, "1": 0.34, "2": 0.0002, "3": 0.0005, "4 paper": 0.0016},
    "chair": {"spread": 0.019, "1": 0.08, "2": 0.0001, "3": 0.0007, "4 paper": 0.0057},
    "shelf": {"spread": 0.036, "1": 0.25, "2": 0.0006, "3": 0.0031, "4 paper": 0.0063},
    "bed": {"spread": 0.014, "1": 0.23, "2": 0.0004, "3": 0.0015, "4 paper": 0.0109},
}

TASK_NAMES = {
    "spread": "random pairs: D_chamfer, D_voxel",
    "1": "1 parameters to grid, D_voxel",
    "2": "2 grid to parameters",
    "3": "3 by search",
    "4 paper": "4 four masks, the paper's cameras",
    "4 spread": "4 four masks, cameras all round",
}


@dataclass(frozen=True)
class Table1Options:
    """What to measure, on how many held-out shapes."""

    shapes: int = 300
    methods: tuple[str, ...] = ("spread", "ours")
    tasks: tuple[str, ...] = TASKS
    grids: tuple[str, ...] = GRIDS
    variant_steps: int = 600  # training steps of the ablations, of `simple`, and of ours beside them
    data: Path = Path(".cache/data")  # generated pairs, for training the ablations and as known shapes
    work: Path = Path(".cache/evaluate")


@dataclass(frozen=True)
class Table1Row:
    """One figure; None where a measure does not apply. seconds is the mean wall time of the method a shape."""

    class_name: str
    grid: str
    task: str
    method: str
    shapes: int
    d_chamfer: float | None = None
    floor: float | None = None
    d_voxel: float | None = None
    discrete_accuracy: float | None = None
    scalar_error: float | None = None
    seconds: float | None = None

    @staticmethod
    def from_json(values: dict) -> Table1Row:
        """The inverse of as_json."""
        rest = {k: v for k, v in values.items() if k != "class"}
        return Table1Row(values["class"], **rest)

    def as_json(self) -> dict:
        """The row as written to files: `class` for class_name."""
        values = asdict(self)
        return {"class": values.pop("class_name"), **values}


def run(classes: list[str], options: Table1Options) -> Iterator[Table1Row]:
    """All rows asked for, one after another. Raises ModelError and WeightsError."""
    for name in classes:
        model = load(name)
        for grid in options.grids:
            held_out: list[Case] = []  # built when the first row needs them
            for method in options.methods:
                for task in _tasks(method, options):
                    yield _kept_or_measured(model, grid, task, method, options, held_out)


def _tasks(method: str, options: Table1Options) -> list[str]:
    if method == "spread":
        return ["spread"]
    if method in SIMPLE:
        return [t for t in options.tasks if t == "2"]
    known = [t for t in options.tasks if t == "1" or method in METHODS[t] or method in ABLATIONS]
    return [t for t in known if t != "1" or method == "ours" or method in ABLATIONS]


def _kept_or_measured(
    model: Model, grid: str, task: str, method: str, options: Table1Options, held_out: list[Case]
) -> Table1Row:
    weights = WEIGHTS / f"{model.name}.safetensors"
    if method in ABLATIONS or method in SIMPLE:
        weights = _variant_weights(model, {**ABLATIONS, **SIMPLE}[method], options)
    digest = hashlib.sha256(weights.read_bytes()).hexdigest()[:12] if weights.is_file() else "none"
    name = f"{model.name}_{model.space.hash}_{grid}_{task}_{method}_{options.shapes}_{digest}.json".replace(" ", "-")
    path = options.work / "table1" / name
    if path.is_file():
        return Table1Row(**json.loads(path.read_text()))
    if not held_out:
        held_out.extend(cases(model, grid, options.shapes))
    row = _measured(model, grid, task, method, weights, options, held_out)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(asdict(row)))
    partial.replace(path)
    return row


def _measured(
    model: Model, grid: str, task: str, method: str, weights: Path, options: Table1Options, held_out: list[Case]
) -> Table1Row:
    if task == "spread":
        return _spread(model, grid, held_out)
    bench = Bench(model, load_network(model.space, weights), options.work, options.data)
    if task == "1":
        return _task1(bench, grid, method, held_out)
    return _recovered(bench, grid, task, method, METHODS[task].get(method, METHODS[task]["ours"]), held_out)


def _spread(model: Model, grid: str, held_out: list[Case]) -> Table1Row:
    """Average dissimilarities of random pairs (the paper's columns 2 and 3): each shape with the next."""
    pairs = list(zip(held_out, held_out[1:] + held_out[:1], strict=True))
    return Table1Row(
        model.name,
        grid,
        "spread",
        "spread",
        len(pairs),
        d_chamfer=float(np.mean([chamfer(a.mesh, b.mesh) for a, b in pairs])),
        d_voxel=float(np.mean([d_voxel(a.grid, b.grid) for a, b in pairs])),
    )


def _task1(bench: Bench, grid: str, method: str, held_out: list[Case]) -> Table1Row:
    vectors = bench.network.codec.vectors([c.params for c in held_out])
    grids_from_params(bench.network, vectors[:1])
    started = time.perf_counter()
    found = [grids_from_params(bench.network, v[None])[0] for v in vectors]
    seconds = (time.perf_counter() - started) / len(vectors)
    wrong = float(np.mean([d_voxel(f, c.grid) for f, c in zip(found, held_out, strict=True)]))
    return Table1Row(bench.model.name, grid, "1", method, len(held_out), d_voxel=wrong, seconds=seconds)


def _recovered(bench: Bench, grid: str, task: str, name: str, method: Method, held_out: list[Case]) -> Table1Row:
    """Tasks 2 to 4: parameters found, built again and compared with the truth."""
    method(bench, held_out[0])  # makes what is shared, and warms up
    found: list[Params] = []
    seconds = []
    for case in tqdm(held_out, desc=f"{bench.model.name} {grid}-grid, task {task}, {name}", disable=None):
        started = time.perf_counter()
        found.append(method(bench, case))
        seconds.append(time.perf_counter() - started)
    codec = bench.network.codec
    values, true = codec.vectors(found), codec.vectors([c.params for c in held_out])
    shapes = [bench.model.build(p) for p in found]
    grids = [surface_grid(s.vertices(), s.triangles()) for s in shapes]
    return Table1Row(
        bench.model.name,
        grid,
        task,
        name,
        len(held_out),
        d_chamfer=float(np.mean([chamfer(s.to_trimesh(), c.mesh) for s, c in zip(shapes, held_out, strict=True)])),
        floor=float(np.mean([chamfer(c.mesh, c.mesh) for c in held_out])),
        d_voxel=float(np.mean([d_voxel(g, c.grid) for g, c in zip(grids, held_out, strict=True)])),
        discrete_accuracy=float(codec.discrete_right(values, true).float().mean()),
        scalar_error=float(codec.scalar_error(values, true).mean()),
        seconds=float(np.mean(seconds)),
    )


def _variant_weights(model: Model, variant: str, options: Table1Options) -> Path:
    """Weights of an ablation, trained when there are none yet."""
    path = options.work / "variants" / f"{model.name}_{model.space.hash}_{variant}_{options.variant_steps}.safetensors"
    if not path.is_file():
        training = TrainOptions(steps=options.variant_steps, weights=VARIANTS[variant])
        trainer = train(model.name, options.data / model.name, path.with_suffix(""), training)
        save_network(path, trainer.network)
    return path


def print_rows(rows: list[Table1Row], to: TextIO) -> None:
    """A Markdown table, the paper's figure beside each of ours where it gives one."""
    to.write(f"Measured on {machine()}, {torch.get_num_threads()} thread(s).\n\n")
    to.write(markdown(rows))


def markdown(rows: list[Table1Row]) -> str:
    """The table alone; README prints the kept results through this."""
    head = "class grid task method shapes D_chamfer floor excess paper D_voxel_% discrete_right scalar_error s_a_shape"
    names = [h.replace("_", " ") if h != "D_chamfer" else h for h in head.split()]
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    for r in rows:
        paper = (
            PAPER_FIGURES.get(r.class_name, {}).get(r.task)
            if r.grid == "on" and r.method in ("ours", "spread")
            else None
        )
        excess = r.d_chamfer - r.floor if r.d_chamfer is not None and r.floor is not None else None
        cells = [r.class_name, r.grid, r.task, r.method, str(r.shapes), _number(r.d_chamfer, 5), _number(r.floor, 5)]
        cells += [_number(excess, 5), "" if paper is None else f"{paper:g}", _number(r.d_voxel, 3)]
        cells += [_percent(r.discrete_accuracy), _percent(r.scalar_error), _number(r.seconds, 4)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def compact(rows: list[Table1Row]) -> str:
    """A line a class and task, for the README: ours and refined on / off the grid beside the paper's figure."""
    names = [
        "class",
        "task",
        "ours, on-grid",
        "ours, off-grid",
        "refined, on-grid",
        "refined, off-grid",
        "floor",
        "paper",
        "discrete right, ours on / off",
        "discrete right, refined on / off",
        "other methods, on-grid",
    ]
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    found = {(r.class_name, r.task, r.method, r.grid): r for r in rows}
    for class_name, task in dict.fromkeys((r.class_name, r.task) for r in rows):
        own = ["spread"] if task == "spread" else ["ours", "refined"]
        figures = [[found.get((class_name, task, method, grid)) for grid in GRIDS] for method in own]
        figures += [[None, None]] * (2 - len(own))
        first = next((r for r in (*figures[0], *figures[1]) if r is not None), None)
        if first is None:
            continue
        here = [r for r in rows if (r.class_name, r.task, r.grid) == (class_name, task, "on")]
        cells = [class_name, TASK_NAMES[task]]
        cells += ["" if r is None else _figure(r) for pair in figures for r in pair] + [_number(first.floor, 5)]
        cells += [f"{PAPER_FIGURES[class_name][task]:g}" if task in PAPER_FIGURES.get(class_name, {}) else ""]
        cells += [
            " / ".join(_percent(r.discrete_accuracy) for r in pair if r is not None and r.discrete_accuracy)
            for pair in figures
        ]
        cells += ["; ".join(f"{r.method} {_figure(r)}" for r in here if r.method not in own)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _figure(row: Table1Row) -> str:
    """The figure of a row's task with the number of shapes it is the mean of."""
    if row.task == "spread":
        return f"{_number(row.d_chamfer, 4)}, {_number(row.d_voxel, 2)} % ({row.shapes})"
    value = f"{_number(row.d_voxel, 3)} %" if row.d_chamfer is None else _number(row.d_chamfer, 5)
    return f"{value} ({row.shapes})"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.1f} %"
