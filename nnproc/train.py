"""Train one class's network on generated pairs.

    python -m nnproc.train chair --data .cache/data/chair --work .cache/train/chair

Every 500 steps the whole state goes to WORK; an interrupted run goes on from there and ends as an uninterrupted one
would. At the end the weights and their card are written beside the model's file.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import os
import platform
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import date
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from datasets.synthetic import Pairs, read
from nnproc.infer import grids_from_params, save_network, values_from_grids
from nnproc.losses import VARIANTS, LossWeights, losses
from nnproc.muon import Muon
from nnproc.network import NetworkConfig, NNProc, parameter_count
from nnproc.on_device import device
from nnproc.shape_nets import SHAPE_NETS, cells_from_grid, channels_last
from procmodels import ModelError, load

log = logging.getLogger("nnproc.train")
OCTAVES = 4  # what the command takes by default; see docs/decoders.md


@dataclass(frozen=True)
class TrainOptions:
    """How to train; each card says what made its weights."""

    steps: int = 3500
    batch: int = 16  # at equal time 16 learns more than 32
    learning_rate: float = 2e-3  # peak of a one-cycle schedule, Muon (nnproc.muon)
    warmup: float = 0.05  # share of the steps spent rising to the peak
    on_grid_share: float = 0.4  # of a batch; the rest is off-grid
    checkpoint_every: int = 500  # steps
    seed: int = 0
    weights: LossWeights = field(default_factory=LossWeights)
    network: NetworkConfig = field(default_factory=NetworkConfig)


class Store(Protocol):
    """Training pairs that give batches of shapes and vectors."""

    def __len__(self) -> int: ...
    def batch(self, index: np.ndarray) -> tuple[Tensor, Tensor]: ...


class CellStore:
    """Training pairs in memory, grids as packed bits in cell order, so that a batch costs one unpacking."""

    def __init__(self, pairs: Pairs) -> None:
        self.vectors = torch.from_numpy(pairs.vectors)
        self.bits = np.concatenate([self._packed(pairs, i) for i in range(0, len(pairs), 100)])

    @staticmethod
    def _packed(pairs: Pairs, start: int) -> np.ndarray:
        cells = cells_from_grid(torch.from_numpy(pairs.grids(slice(start, start + 100))))
        channels_last = cells.permute(0, 2, 3, 4, 1).reshape(len(cells), -1)
        return np.packbits(channels_last.numpy(), axis=1)

    def __len__(self) -> int:
        return len(self.vectors)

    def batch(self, index: np.ndarray) -> tuple[Tensor, Tensor]:
        """Cells (B, 64, 16, 16, 16) bfloat16 with channels last in memory, and vectors (B, width)."""
        flat = torch.from_numpy(np.unpackbits(self.bits[index], axis=1)).to(device(), torch.bfloat16)
        return flat.reshape(-1, 16, 16, 16, 64).permute(0, 4, 1, 2, 3), self.vectors[index].to(device())


def learning_rate(step: int, options: TrainOptions) -> float:
    """One cycle: linear rise, then half a cosine down to 1/200 of the peak."""
    rise = options.warmup * options.steps
    if step < rise:
        return options.learning_rate * (step + 1) / rise
    done = (step - rise) / max(1, options.steps - rise)
    return options.learning_rate * (0.005 + 0.995 * 0.5 * (1 + math.cos(math.pi * done)))


class Trainer:
    """The state of a run: network, optimiser, step, seconds of processor time spent."""

    def __init__(self, class_name: str, work: Path, options: TrainOptions) -> None:
        torch.manual_seed(options.seed)
        self.options, self.work = options, work
        self.network = NNProc(load(class_name).space, options.network)
        self.network.to(device())
        channels_last(self.network)
        self.optimiser = Muon(self.network.parameters())
        self.step, self.seconds = 0, 0.0

    @property
    def checkpoint(self) -> Path:
        return self.work / "checkpoint.safetensors"

    def _identity(self) -> str:
        return json.dumps([self.network.space.hash, asdict(self.options)], sort_keys=True)

    def save(self) -> None:
        """Write the whole state."""
        tensors = {f"net.{k}": v for k, v in self.network.state_dict().items()}
        for name, parameter in self.network.named_parameters():
            for key, value in self.optimiser.state[parameter].items():
                tensors[f"opt.{key}.{name}"] = value
        metadata = {"identity": self._identity(), "step": str(self.step), "seconds": str(self.seconds)}
        self.work.mkdir(parents=True, exist_ok=True)
        partial = self.checkpoint.with_suffix(".partial")
        save_file({k: v.detach().cpu().contiguous() for k, v in tensors.items()}, partial, metadata)
        partial.replace(self.checkpoint)

    def resume(self) -> bool:
        """Take up a checkpoint of the same options; False when there is none.

        Raises ValueError for a checkpoint of other options or another space.
        """
        if not self.checkpoint.is_file():
            return False
        with safe_open(self.checkpoint, framework="pt") as file:
            metadata = file.metadata()
            if metadata["identity"] != self._identity():
                raise ValueError(f"{self.checkpoint} belongs to a run with other options; use another --work folder")
            tensors = {k: file.get_tensor(k) for k in file.keys()}  # noqa: SIM118 (not a dict)
        self.network.load_state_dict({k[4:]: v for k, v in tensors.items() if k.startswith("net.")})
        for name, parameter in self.network.named_parameters():
            self.optimiser.state[parameter] = optimiser_state(tensors, name, parameter)
        self.step, self.seconds = int(metadata["step"]), float(metadata["seconds"])
        return True

    def advance(self, cells: Tensor, vectors: Tensor) -> dict[str, float]:
        """One gradient step; noise depends on the seed and the step alone."""
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate(self.step, self.options)
        generator = torch.Generator().manual_seed(self.options.seed * 1_000_003 + self.step)
        with torch.autocast(device().type, torch.bfloat16):
            terms = losses(self.network, cells, vectors, self.options.weights, generator)
        self.optimiser.zero_grad(set_to_none=True)
        terms["total"].backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 2000.0)
        self.optimiser.step()
        self.step += 1
        return {k: float(v.detach()) for k, v in terms.items()}


def optimiser_state(tensors: Mapping[str, Tensor], name: str, parameter: Tensor) -> dict[str, Tensor]:
    """What the optimiser kept for one parameter, out of a checkpoint's tensors (`opt.KEY.NAME`)."""
    keys = [k.split(".")[1] for k in tensors if k.startswith("opt.") and k.split(".", 2)[2] == name]
    return {key: _laid_out_as(tensors[f"opt.{key}.{name}"], parameter) for key in keys}


def _laid_out_as(value: Tensor, parameter: Tensor) -> Tensor:
    """The tensor with the parameter's memory layout (a scalar stays as it is)."""
    return value if value.dim() == 0 else torch.empty_like(parameter).copy_(value)


def _pick(step: int, total: int, count: int, options: TrainOptions, code: int) -> np.ndarray:
    """Indices of one batch: shuffled epochs of `total`, cut into runs of `count`."""
    first = step * count
    place = np.arange(first, first + count)
    epochs = place // total
    order = {e: np.random.default_rng([options.seed, code, int(e)]).permutation(total) for e in np.unique(epochs)}
    return np.array([order[e][p % total] for e, p in zip(epochs, place, strict=True)])


def mixed_batch(stores: Sequence[Store], step: int, options: TrainOptions) -> tuple[Tensor, Tensor]:
    """The batch of a step: on-grid and off-grid shapes, shuffled since parts of a batch are treated differently."""
    on_grid = round(options.batch * options.on_grid_share)
    counts = (on_grid, options.batch - on_grid)
    picks = [_pick(step, len(s), c, options, i) for i, (s, c) in enumerate(zip(stores, counts, strict=True))]
    batches = [s.batch(p) for s, p in zip(stores, picks, strict=True) if len(p)]
    mix = np.random.default_rng([options.seed, 9, step]).permutation(options.batch)
    cells, vectors = (torch.cat(t)[mix] for t in zip(*batches, strict=True))
    return cells, vectors


def train(class_name: str, data: Path, work: Path, options: TrainOptions) -> Trainer:
    """Run, or finish, a training. Raises ValueError for unusable data or a foreign checkpoint."""
    trainer = Trainer(class_name, work, options)
    space_hash = trainer.network.space.hash
    stores = [CellStore(read(data, which, space_hash)) for which in ("train_on", "train_off")]
    if trainer.resume():
        log.info("resuming at step %d", trainer.step)
    log.info("%d weights, %d steps", parameter_count(trainer.network), options.steps)
    while trainer.step < options.steps:
        started = time.process_time()
        cells, vectors = mixed_batch(stores, trainer.step, options)
        terms = trainer.advance(cells, vectors)
        trainer.seconds += time.process_time() - started
        if trainer.step % 50 == 0:
            text = " ".join(f"{k} {v:.3g}" for k, v in terms.items())
            log.info("step %d  %.1f min  %s", trainer.step, trainer.seconds / 60, text)
        if trainer.step % options.checkpoint_every == 0 or trainer.step == options.steps:
            trainer.save()
    return trainer


def score(network: NNProc, pairs: Pairs) -> dict[str, float]:
    """Task 1 and Task 2 on held-out pairs, by voxels and parameters (no meshes)."""
    grids, vectors = pairs.grids(), torch.from_numpy(pairs.vectors)
    values = values_from_grids(network, grids)
    right = network.codec.discrete_right(values, vectors)
    return {
        "task1_d_voxel": float(100 * (grids_from_params(network, vectors) ^ grids).mean()),
        "task2_discrete_accuracy": network.codec.discrete_accuracy(values, vectors),
        "task2_all_discrete_right": float(right.all(1).float().mean()),
        "task2_scalar_error": float(network.codec.scalar_error(values, vectors).mean()),
    }


def write_card(trainer: Trainer, data: Path, path: Path, command: str) -> None:
    """The model card beside the weights: data, seed, command, minutes, machine, metrics."""
    network = trainer.network.eval()
    manifest = json.loads((data / "manifest.json").read_text())
    card = {
        "class": network.space.name,
        "space_hash": network.space.hash,
        "parameters_trained": parameter_count(network),
        "data": {"seed": manifest["seed"], "shapes": {k: v[0] for k, v in manifest["shards"].items()}},
        "command": command,
        "options": asdict(trainer.options),
        "minutes": round(trainer.seconds / 60, 1),
        "machine": f"{os.cpu_count()} cores, {platform.machine()}, torch {torch.__version__}",
        "date": date.today().isoformat(),
        "held_out": {w: score(network, read(data, w, network.space.hash)) for w in ("test_on", "test_off")},
        "licence": "Apache-2.0, trained on shapes of this project's own procedural model",
    }
    path.write_text(json.dumps(card, indent=1) + "\n")


def main(argv: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m nnproc.train", description=__doc__.split("\n")[0])
    parser.add_argument("class_name", metavar="class")
    parser.add_argument("--data", type=Path, help="generated pairs (default .cache/data/CLASS)")
    parser.add_argument("--work", type=Path, help="checkpoints (default .cache/train/CLASS)")
    parser.add_argument("--out", type=Path, help="where the weights go (default: beside the model)")
    parser.add_argument("--steps", type=int, default=TrainOptions.steps)
    parser.add_argument("--batch", type=int, default=TrainOptions.batch)
    parser.add_argument("--seed", type=int, default=TrainOptions.seed)
    parser.add_argument("--layers", choices=tuple(SHAPE_NETS), default="product")
    parser.add_argument("--hidden", type=int, default=NetworkConfig.hidden, help="width of PE's and PD's layers")
    parser.add_argument("--octaves", type=int, default=OCTAVES, help="of sines of the scalars that PE sees")
    parser.add_argument("--variant", choices=tuple(VARIANTS), default="full", help="an ablation of the paper")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    options = TrainOptions(
        steps=args.steps,
        batch=args.batch,
        seed=args.seed,
        network=NetworkConfig(layers=args.layers, hidden=args.hidden, octaves=args.octaves),
        weights=VARIANTS[args.variant],
    )
    data = args.data or Path(".cache/data") / args.class_name
    out = args.out or load(args.class_name).weights
    try:
        trainer = train(args.class_name, data, args.work or Path(".cache/train") / args.class_name, options)
        save_network(out, trainer.network)
        command = (
            f"python -m nnproc.train {args.class_name} --steps {args.steps} --batch {args.batch} --seed {args.seed}"
        )
        command += f" --layers {args.layers} --hidden {args.hidden} --octaves {args.octaves}"
        write_card(trainer, data, out.with_suffix(".json"), command)
    except (ModelError, ValueError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    log.info("wrote %s and its card", out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
