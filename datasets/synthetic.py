"""Training pairs (parameters, surface grid) of a procedural model, in resumable shards.

    python -m datasets.synthetic chair --out .cache/data/chair

writes sets of on-grid and of off-grid training shapes and, never overlapping them, of held-out test shapes (paper,
sections 3.3 and 4.1). Beside them, if asked for, sets whose grids are the skins of visual hulls, which is what is known
of an object in photos. Shape number i of a set depends on the seed and i alone, so that an interrupted run goes on
where it stopped, and any number of workers gives the same data.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import logging
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from datasets.hulls import hull
from datasets.jobs import Backend, JobError, Pool, RayNodes
from datasets.voxels import pack, surface_grid, unpack
from procmodels import Model, ModelError, load
from procmodels.space import Params, ParamSpace

log = logging.getLogger(__name__)

SHARD = 500
# Sets that are drawn use generators seeded with (seed, code, i): off the grid no two of them share a shape.
SETS = {"train_on": 1, "train_off": 2, "test_on": 3, "test_off": 4, "train_hull": 5, "test_hull": 6}
VIEWS = 1  # beside them, of the generator that places a hull's cameras
LISTED = 1_000_000  # grids up to this many points are permuted; of larger ones points are drawn
TEST = 1 / 8  # share of the points of such a grid that belong to the test set
DRAWS = 1000  # after so many a grid is too small for its two sets


@dataclass(frozen=True)
class SyntheticOptions:
    """How many shapes of each set to make, and from which seed."""

    train_on: int = 3000  # on-grid, as in the paper
    train_off: int = 9000  # scalars drawn continuously: real objects live off the grid
    test_on: int = 300  # held out, as in the paper
    test_off: int = 300
    train_hull: int = 0  # off-grid shapes known by their silhouettes: for classes that are fitted to photos by them
    test_hull: int = 0
    seed: int = 0


@dataclass(frozen=True)
class Pairs:
    """vectors (n, width) float32 parameter vectors; bits (n, 32768) uint8 packed 64^3 surface grids, or hulls."""

    vectors: np.ndarray
    bits: np.ndarray

    def __len__(self) -> int:
        return len(self.vectors)

    def grids(self, index: np.ndarray | slice = slice(None)) -> np.ndarray:
        """(m, 64, 64, 64) bool."""
        return unpack(self.bits[index])


def shape_params(model: Model, which: str, index: int, options: SyntheticOptions) -> Params:
    """Parameters of shape `index` of a set.

    The on-grid sets never share a shape: they are the two ends of one permutation of the grid or, where that is too
    large to be listed or some of its points are one shape, points that are drawn until one belongs to the set.
    """
    space = model.space
    rng = np.random.default_rng([options.seed, SETS[which], index])
    if not which.endswith("_on"):
        return space.sample(rng)
    if _is_listed(space):
        order = _order(space.grid_size, options.seed)
        return space.grid_point(int(order[index if which == "train_on" else space.grid_size - 1 - index]))
    for _ in range(DRAWS):
        params = space.sample(rng, on_grid=True)
        if _is_test(params) == (which == "test_on"):
            return params
    raise ValueError(f"{model.name}: the grid is too small for sets of training and of test shapes that share none")


def _is_listed(space: ParamSpace) -> bool:
    return space.grid_size <= LISTED and not space.conditional


@lru_cache(maxsize=4)
def _order(size: int, seed: int) -> np.ndarray:
    return np.random.default_rng([seed, 0]).permutation(size)


def _is_test(params: Params) -> bool:
    """Which of two sets a shape belongs to, by its values alone."""
    digest = hashlib.sha256(json.dumps(params).encode()).digest()
    return digest[0] < 256 * TEST


def shape_grid(model: Model, which: str, index: int, params: Params, seed: int, scratch: Path) -> np.ndarray:
    """(64, 64, 64) bool, what shape `index` of a set looks like: its surface, or the skin of its visual hull."""
    shape = model.build(params)
    if which.endswith("_hull"):
        return hull(shape, np.random.default_rng([seed, SETS[which], index, VIEWS]))
    return surface_grid(shape.vertices(), shape.triangles(), scratch=scratch)


class ShardError(Exception):
    """Some shapes could not be made, by a worker's accidents."""


@dataclass(frozen=True)
class _Shard:
    """Shapes start .. start + count of a set, and the file that is to hold them."""

    which: str
    start: int
    count: int
    path: Path


def generate(
    model: Model, out: Path, options: SyntheticOptions = SyntheticOptions(), backend: Backend | None = None
) -> None:
    """Write every set below `out`; shards that are whole (by checksum) and of this space are kept.

    A back end's workers load the model from its file; without one it is done here. Raises ValueError when the on-grid
    sets do not fit in the grid or `out` holds data of another space or seed, ShardError when a shard cannot be made.
    """
    if _is_listed(model.space) and options.train_on + options.test_on > model.space.grid_size:
        raise ValueError(
            f"{model.name}: {options.train_on} + {options.test_on} shapes asked for, "
            f"the grid has {model.space.grid_size}"
        )
    manifest = _manifest(out, model, options)
    missing = [
        shard
        for shard in _shards(out, options)
        if manifest["shards"].get(shard.path.name) != [shard.count, _digest(shard.path)]
    ]
    done = _made(backend, model, missing, options) if backend else _made_here(model, missing, options)
    for shard in tqdm(done, total=len(missing), desc=model.name, unit="shard", disable=None):
        manifest["shards"][shard.path.name] = [shard.count, _digest(shard.path)]
        _write_json(out / "manifest.json", manifest)


def _shards(out: Path, options: SyntheticOptions) -> Iterator[_Shard]:
    for which in SETS:
        total = getattr(options, which)
        for start in range(0, total, SHARD):
            yield _Shard(which, start, min(SHARD, total - start), out.absolute() / f"{which}_{start:06d}.npz")


def _made(backend: Backend, model: Model, shards: list[_Shard], options: SyntheticOptions) -> Iterator[_Shard]:
    """The shards as they are done. Raises ShardError for one that could not be made."""
    file, about = str(model.weights.with_suffix(".py")), asdict(options)
    orders = ({"file": file, "options": about, "shard": {**asdict(s), "path": str(s.path)}} for s in shards)
    for outcome in backend.map(make_shard, orders):
        shard = shards[outcome.number]
        if outcome.error is not None:
            raise ShardError(f"{shard.path.name} could not be made: {outcome.error}\n{outcome.details}")
        yield shard


def make_shard(order: dict[str, Any]) -> None:
    """What a worker does, which loads the model from its file."""
    shard = _Shard(**{**order["shard"], "path": Path(order["shard"]["path"])})
    _make(_loaded(order["file"]), shard, SyntheticOptions(**order["options"]))


@lru_cache(maxsize=1)
def _loaded(file: str) -> Model:
    return load(file)


def _made_here(model: Model, shards: list[_Shard], options: SyntheticOptions) -> Iterator[_Shard]:
    for shard in shards:
        _make(model, shard, options)
        yield shard


def _make(model: Model, shard: _Shard, options: SyntheticOptions) -> None:
    numbers = range(shard.start, shard.start + shard.count)
    rows = [shape_params(model, shard.which, i, options) for i in numbers]
    scratch = shard.path.with_suffix(".ply")
    grids = [shape_grid(model, shard.which, i, r, options.seed, scratch) for i, r in zip(numbers, rows, strict=True)]
    scratch.unlink(missing_ok=True)
    _write(shard.path, vectors=np.stack([model.space.encode(r) for r in rows]), bits=pack(np.stack(grids)))


def read(out: Path, which: str, space_hash: str) -> Pairs:
    """One set, whole. Raises ValueError when it is missing, damaged or of another parameter space."""
    path = out / "manifest.json"
    if not path.is_file():
        raise ValueError(f"{out} holds no generated data; make it with: python -m datasets.synthetic CLASS --out {out}")
    manifest = json.loads(path.read_text())
    if manifest["space_hash"] != space_hash:
        raise ValueError(
            f"{out} holds shapes of space {manifest['space_hash']}, the model now has {space_hash}; "
            "generate them again into an empty folder"
        )
    names = sorted(n for n in manifest["shards"] if n.startswith(which + "_"))
    parts = []
    for name in names:
        if manifest["shards"][name][1] != _digest(out / name):
            raise ValueError(f"{out / name} is damaged or missing; run python -m datasets.synthetic again to remake it")
        with np.load(out / name, allow_pickle=False) as data:
            parts.append((data["vectors"], data["bits"]))
    if not parts:
        raise ValueError(f"{out} holds no {which} shapes")
    return Pairs(np.concatenate([v for v, _ in parts]), np.concatenate([b for _, b in parts]))


def _manifest(out: Path, model: Model, options: SyntheticOptions) -> dict:
    out.mkdir(parents=True, exist_ok=True)
    path = out / "manifest.json"
    head = {"class": model.name, "space_hash": model.space.hash, "seed": options.seed}
    if not path.exists():
        return {**head, "shards": {}}
    manifest = json.loads(path.read_text())
    if any(manifest.get(k) != v for k, v in head.items()):
        raise ValueError(f"{out} holds data of another model, space or seed; choose an empty folder")
    return manifest


def _digest(path: Path) -> str | None:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.is_file() else None


def _write(path: Path, **arrays: np.ndarray) -> None:
    partial = path.with_suffix(".partial")
    with partial.open("wb") as file:
        np.savez_compressed(file, **arrays)
    partial.replace(path)


def _write_json(path: Path, content: dict) -> None:
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(content, indent=1))
    partial.replace(path)


def main(argv: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m datasets.synthetic", description=__doc__.split("\n")[0])
    parser.add_argument("model", help="class name, or the path of a model's .py file")
    parser.add_argument("--out", type=Path, required=True)
    defaults = SyntheticOptions()
    for field in (*SETS, "seed"):
        parser.add_argument(f"--{field.replace('_', '-')}", type=int, default=getattr(defaults, field))
    parser.add_argument("--workers", type=int, default=1, help="processes; the data are the same")
    parser.add_argument("--ray", metavar="ADDRESS", help="of a Ray cluster whose machines do the work")
    args = parser.parse_args(argv)
    options = SyntheticOptions(**{field: getattr(args, field) for field in (*SETS, "seed")})
    pool = Pool(args.workers) if args.workers > 1 else None
    try:
        generate(load(args.model), args.out, options, RayNodes(args.ray) if args.ray else pool)
    except (ModelError, JobError, ShardError, ValueError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
