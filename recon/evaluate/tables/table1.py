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
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from datasets.jobs import Backend, Here, JobError, in_order
from datasets.voxels import surface_grid
from nnproc.infer import grids_from_params, load_network, save_network
from nnproc.losses import VARIANTS
from nnproc.train import TrainOptions, train
from procmodels import Model, load
from procmodels.registry import PAPER
from procmodels.space import Params
from recon.evaluate.data.held_out import Case, cases
from recon.evaluate.metrics import chamfer, d_voxel
from recon.evaluate.tables.methods import METHODS, Bench, Method, mask_problem
from recon.evaluate.tables.table1_rows import GRIDS, Table1Row
from recon.fitting import known_place

TASKS = ("1", *METHODS)
SHORT = "same budget"  # our full loss, trained as briefly as the ablations
ABLATIONS = {"without KL": "without_kl", "without sim": "without_sim", "without both": "without_both", SHORT: "full"}
SIMPLE = {"simple": "simple"}
VARIANT_OF = {**ABLATIONS, **SIMPLE}
ALL_METHODS = ("spread", "ours", "refined", "paper", "cobyqa", *SIMPLE, *ABLATIONS)


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


def run(classes: list[str], options: Table1Options, backend: Backend = Here()) -> Iterator[Table1Row]:
    """All rows asked for of the paper's classes, one after another, measured by any back end.

    Raises ModelError and WeightsError; JobError for a row that a worker cannot measure.
    """
    for outcome in in_order(backend.map(one_row, _jobs(classes, options))):
        if outcome.error is not None:
            raise JobError(f"a row of Table 1 cannot be measured: {outcome.error}\n{outcome.details}")
        yield Table1Row(**outcome.value)


def _jobs(classes: list[str], options: Table1Options) -> Iterator[dict[str, Any]]:
    """A job a row. Ablations are trained here, so that no two workers train the same one."""
    plain = {**asdict(options), "data": str(options.data.absolute()), "work": str(options.work.absolute())}
    for name in classes:
        for grid, method in product(options.grids, options.methods):
            if method in VARIANT_OF:
                _variant_weights(load(PAPER + name), VARIANT_OF[method], options)
            for task in _tasks(method, options):
                yield {"options": plain, "class": name, "grid": grid, "task": task, "method": method}


def one_row(job: dict[str, Any]) -> dict[str, Any]:
    """What a worker does: the row of a class, a kind of shapes, a task and a method."""
    told = dict(job["options"])
    places = {"data": Path(told["data"]), "work": Path(told["work"])}
    lists = {name: tuple(told[name]) for name in ("methods", "tasks", "grids")}
    options = Table1Options(**{**told, **places, **lists})
    return asdict(_kept_or_measured(load(PAPER + job["class"]), job["grid"], job["task"], job["method"], options))


@lru_cache(maxsize=1)
def _held_out(name: str, grid: str, shapes: int) -> list[Case]:
    """Built when the first row needs them, and kept for those that follow."""
    return cases(load(name), grid, shapes)


def _tasks(method: str, options: Table1Options) -> list[str]:
    if method == "spread":
        return ["spread"]
    if method in SIMPLE:
        return [t for t in options.tasks if t == "2"]
    known = [t for t in options.tasks if t == "1" or method in METHODS[t] or method in ABLATIONS]
    return [t for t in known if t != "1" or method == "ours" or method in ABLATIONS]


def _kept_or_measured(model: Model, grid: str, task: str, method: str, options: Table1Options) -> Table1Row:
    weights = model.weights
    if method in VARIANT_OF:
        weights = _variant_weights(model, VARIANT_OF[method], options)
    digest = hashlib.sha256(weights.read_bytes()).hexdigest()[:12] if weights.is_file() else "none"
    case = f"{model.space.name}_{model.space.hash}_{grid}_{task}_{method}_{options.shapes}_{digest}"
    name = case.replace(" ", "-") + ".json"
    path = options.work / "table1" / name
    if path.is_file():
        return Table1Row(**json.loads(path.read_text()))
    row = _measured(model, grid, task, method, weights, options, _held_out(model.name, grid, options.shapes))
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
    bench = Bench(model, load_network(model.space, weights, decoder=True), options.work, options.data)
    if task == "1":
        return _task1(bench, grid, method, held_out)
    return _recovered(bench, grid, task, method, METHODS[task].get(method, METHODS[task]["ours"]), held_out)


def _spread(model: Model, grid: str, held_out: list[Case]) -> Table1Row:
    """Average dissimilarities of random pairs (the paper's columns 2 and 3): each shape with the next."""
    pairs = list(zip(held_out, held_out[1:] + held_out[:1], strict=True))
    return Table1Row(
        model.space.name,
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
    return Table1Row(bench.model.space.name, grid, "1", method, len(held_out), d_voxel=wrong, seconds=seconds)


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
        bench.model.space.name,
        grid,
        task,
        name,
        len(held_out),
        d_chamfer=float(np.mean([chamfer(s.to_trimesh(), c.mesh) for s, c in zip(shapes, held_out, strict=True)])),
        floor=float(np.mean([chamfer(c.mesh, c.mesh) for c in held_out])),
        d_voxel=float(np.mean([d_voxel(g, c.grid) for g, c in zip(grids, held_out, strict=True)])),
        discrete_accuracy=codec.discrete_accuracy(values, true),
        scalar_error=float(codec.scalar_error(values, true).mean()),
        seconds=float(np.mean(seconds)),
        visible_right=_visible_right(bench.model, task, found, held_out) if task.startswith("4 ") else None,
    )


def _visible_right(model: Model, task: str, found: list[Params], held_out: list[Case]) -> float | None:
    """Share of the discrete parameters that are right among those whose every other value changes the true masks by
    more than some ten pixels; None when there are none."""
    right = []
    for params, case in zip(found, held_out, strict=True):
        problem = mask_problem(model, case, task.removeprefix("4 "))
        good, _ = known_place.losses(problem)
        for p in model.space.discrete:
            others = {p.grid_value(i) for i in range(p.grid_steps)} - {case.params[p.name]}
            states = [problem.state({**case.params, p.name: value}, np.zeros(0)) for value in others]
            if min(map(problem.loss, states)) > good:
                right.append(params[p.name] == case.params[p.name])
    return float(np.mean(right)) if right else None


def _variant_weights(model: Model, variant: str, options: Table1Options) -> Path:
    """Weights of an ablation, trained when there are none yet."""
    path = (
        options.work
        / "variants"
        / f"{model.space.name}_{model.space.hash}_{variant}_{options.variant_steps}.safetensors"
    )
    if not path.is_file():
        training = TrainOptions(steps=options.variant_steps, weights=VARIANTS[variant])
        trainer = train(model.name, options.data / model.space.name, path.with_suffix(""), training)
        save_network(path, trainer.network)
    return path
