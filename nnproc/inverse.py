"""Train the inverse half of a class's network alone: SE and PD, on grids that the procedure did not make.

    python -m datasets.synthetic MODEL --train-on 0 --train-off 30000 --test-on 0 --train-hull 15000 --test-hull 300 \\
        --workers 2 --out DATA
    python -m nnproc.inverse MODEL --data DATA --work WORK

For a class of many parameters: its encoder learns in minutes, a decoder of whole shapes does not. A batch is a mix of
clean grids, visual hulls, splatted clouds and damaged scans (datasets.disturbed). Every 500 steps the whole state goes
to WORK; an interrupted run goes on from there. At the end the weights and their card are written beside the model's
file: a network whose has_decoder is False. `--start WEIGHTS` goes on from such weights with a fresh optimiser.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import logging
import os
import platform
import sys
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from datetime import date
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from datasets.synthetic import Pairs, read
from nnproc.accuracy import KINDS, accuracy
from nnproc.infer import load_network, save_network
from nnproc.losses import VARIANTS, LossWeights
from nnproc.network import HALVES, NetworkConfig, NNProc, parameter_count
from nnproc.on_device import device
from nnproc.shape_nets import CELL, GRID, SHAPE_NETS
from nnproc.train import Trainer, TrainOptions
from procmodels import ModelError, load

log = logging.getLogger("nnproc.inverse")
LOG_EVERY = 50  # steps; what is said is their mean loss
BATCH = 21  # of the generators that draw batches
SCALARS = 15.0  # weight of scalars' squared errors: of normal ones with a deviation of 0.18 of the range


@dataclass(frozen=True)
class InverseOptions(TrainOptions):
    """How to train; the card says what made its weights."""

    steps: int = 20000
    learning_rate: float = 1e-3  # twice as much did not learn on a rich chair
    # Of equal weight, nine choices drown 29 scalars: after 9,000 steps these were still 16 % of their ranges off.
    weights: LossWeights = field(default_factory=lambda: replace(VARIANTS["simple"], scalars=SCALARS))
    network: NetworkConfig = field(default_factory=lambda: NetworkConfig(layers="planes", hidden=512))
    # Shares of what a batch shows, in the order of KINDS.
    mix: tuple[float, ...] = (0.35, 0.3, 0.15, 0.2)
    start: str = ""  # digest of the weights that it goes on from


class MixedStore:
    """Surface grids and hulls in memory, as packed bits; a batch shows them as they might be met."""

    def __init__(self, clean: list[Pairs], hulls: Pairs) -> None:
        self.clean, self.hulls = clean[0], hulls
        if len(clean) > 1:  # a single set, of gigabytes, is not copied
            self.clean = Pairs(np.concatenate([p.vectors for p in clean]), np.concatenate([p.bits for p in clean]))

    def batch(self, step: int, options: InverseOptions) -> tuple[Tensor, Tensor]:
        """Cells (B, 64, 16, 16, 16) bfloat16 with channels last in memory, and vectors (B, width), of a step."""
        rng = np.random.default_rng([options.seed, BATCH, step])
        grids, vectors = [], []
        for kind in rng.choice(list(KINDS), options.batch, p=options.mix):
            pairs = self.hulls if kind == "hull" else self.clean
            index = int(rng.integers(len(pairs)))
            grids.append(KINDS[kind](pairs.grids(np.array([index]))[0], rng))
            vectors.append(pairs.vectors[index])
        return _cells(np.stack(grids)), torch.from_numpy(np.stack(vectors))

    def batches(self, first: int, options: InverseOptions) -> Iterator[tuple[Tensor, Tensor]]:
        """The batches of the steps from `first` on; the next one is made while one is used."""
        with ThreadPoolExecutor(1) as pool:
            coming = pool.submit(self.batch, first, options)
            for step in range(first + 1, options.steps + 1):
                batch, coming = coming.result(), pool.submit(self.batch, step, options)
                yield batch


def _cells(grids: np.ndarray) -> Tensor:
    """What nnproc.shape_nets.cells_from_grid makes of (B, 64, 64, 64), with channels last in memory."""
    parts = grids.reshape(-1, GRID, CELL, GRID, CELL, GRID, CELL).transpose(0, 1, 3, 5, 2, 4, 6)
    flat = torch.from_numpy(np.ascontiguousarray(parts).reshape(-1, GRID, GRID, GRID, CELL**3))
    return flat.to(torch.bfloat16).permute(0, 4, 1, 2, 3)


class InverseTrainer(Trainer):
    """The state of a run; `seconds` are those on the clock. PE and SD get no gradient and stay as they were made."""

    def __init__(self, class_name: str, work: Path, options: InverseOptions, start: Path | None = None) -> None:
        super().__init__(class_name, work, options)
        self.network.has_decoder = False
        if start is not None:
            network = load_network(self.network.space, start)
            if network.config != options.network:
                raise ValueError(f"{start} holds a network of {network.config}, not of {options.network}")
            state = network.state_dict()
            own = {k: v for k, v in state.items() if k.split(".")[0] in HALVES["inverse"]}
            self.network.load_state_dict(own, strict=False)


def train(
    class_name: str, data: Path, work: Path, options: InverseOptions, start: Path | None = None
) -> InverseTrainer:
    """Run, or finish, a training. Raises ValueError for unusable data, weights, or a foreign checkpoint."""
    trainer = InverseTrainer(class_name, work, options, start)
    store = training_set(data, trainer.network.space.hash)
    if trainer.resume():
        log.info("resuming at step %d", trainer.step)
    log.info("%d weights learn, %d steps", _learning(trainer.network), options.steps)
    first, began, before, recent = trainer.step, time.monotonic(), trainer.seconds, 0.0
    for cells, vectors in store.batches(first, options):
        terms = trainer.advance(cells.to(device()), vectors.to(device()))
        trainer.seconds = before + time.monotonic() - began
        recent += terms["param"] / LOG_EVERY
        if trainer.step % LOG_EVERY == 0:
            left = (time.monotonic() - began) / (trainer.step - first) * (options.steps - trainer.step)
            text = "step %d of %d  loss %.4f  %.1f min, %.1f to go"
            log.info(text, trainer.step, options.steps, recent, trainer.seconds / 60, left / 60)
            recent = 0.0
        if trainer.step % options.checkpoint_every == 0 or trainer.step == options.steps:
            trainer.save()
    return trainer


def training_set(data: Path, space_hash: str) -> MixedStore:
    """The sets of a folder: surface grids on or off the grid of values, whichever are there, and hulls."""
    names = json.loads((data / "manifest.json").read_text())["shards"] if (data / "manifest.json").is_file() else []
    clean = [w for w in ("train_on", "train_off") if any(n.startswith(w) for n in names)] or ["train_off"]
    return MixedStore([read(data, w, space_hash) for w in clean], read(data, "train_hull", space_hash))


def _learning(network: NNProc) -> int:
    return sum(parameter_count(getattr(network, name)) for name in HALVES["inverse"])


def write_card(trainer: InverseTrainer, data: Path, path: Path, command: str, before: list[Mapping]) -> None:
    """The model card beside the weights: what they are, data, seed, command, minutes, machine, accuracy.

    before  the trainings that it went on from, oldest first
    """
    network = trainer.network.eval()
    manifest = json.loads((data / "manifest.json").read_text())
    clean, hulls = (read(data, w, network.space.hash) for w in ("test_off", "test_hull"))
    training = {
        "command": command,
        "options": asdict(trainer.options),
        "data": {"seed": manifest["seed"], "shapes": _counted(manifest["shards"])},
        "minutes": round(trainer.seconds / 60, 1),
        "machine": f"{os.cpu_count()} cores ({torch.get_num_threads()} used), {platform.machine()}, "
        f"torch {torch.__version__}",
        "date": date.today().isoformat(),
    }
    card = {
        "class": network.space.name,
        "space_hash": network.space.hash,
        "halves": "inverse: from shapes to parameters (SE, PD); the forward half is not trained and not in the file",
        "parameters_trained": _learning(network),
        "minutes": round(sum(t["minutes"] for t in [*before, training]), 1),
        "trainings": [*before, training],
        "held_out": accuracy(network, clean, hulls),
        "licence": "Apache-2.0, trained on shapes of this project's own procedural model",
    }
    path.write_text(json.dumps(card, indent=1) + "\n")


def _counted(shards: Mapping[str, tuple[int, str]]) -> dict[str, int]:
    """Shapes by set, from the manifest's entries by shard."""
    out: dict[str, int] = {}
    for name, (count, _) in sorted(shards.items()):
        which = name.rpartition("_")[0]
        out[which] = out.get(which, 0) + count
    return out


def trainings_of(weights: Path) -> list[Mapping]:
    """What the card beside weights says of how they were made."""
    card = weights.with_suffix(".json")
    return json.loads(card.read_text()).get("trainings", []) if card.is_file() else []


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m nnproc.inverse", description=__doc__.split("\n")[0])
    defaults = InverseOptions()
    parser.add_argument("model", help="class name, or the path of a model's .py file")
    parser.add_argument("--data", type=Path, required=True, help="generated pairs, hulls among them")
    parser.add_argument("--work", type=Path, required=True, help="checkpoints")
    parser.add_argument("--out", type=Path, help="where the weights go (default: beside the model)")
    parser.add_argument("--start", type=Path, help="weights to go on from")
    parser.add_argument("--steps", type=int, default=defaults.steps)
    parser.add_argument("--batch", type=int, default=defaults.batch)
    parser.add_argument("--rate", type=float, default=defaults.learning_rate, help="peak learning rate")
    parser.add_argument("--scalars", type=float, default=SCALARS, help="weight of scalars' squared errors")
    parser.add_argument("--seed", type=int, default=defaults.seed)
    parser.add_argument("--layers", choices=tuple(SHAPE_NETS), default=defaults.network.layers)
    parser.add_argument("--hidden", type=int, default=defaults.network.hidden, help="width of PE's and PD's layers")
    parser.add_argument("--threads", type=int, help="processor threads (default: all; 1 on a busy machine)")
    return parser


def main(argv: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    args = _parser().parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if args.threads:
        torch.set_num_threads(args.threads)
    command = f"python -m nnproc.inverse {args.model} --steps {args.steps} --batch {args.batch} --rate {args.rate:g}"
    command += f" --scalars {args.scalars:g} --seed {args.seed} --layers {args.layers} --hidden {args.hidden}"
    try:
        model = load(args.model)
        options = InverseOptions(
            steps=args.steps,
            batch=args.batch,
            learning_rate=args.rate,
            seed=args.seed,
            weights=replace(VARIANTS["simple"], scalars=args.scalars),
            network=NetworkConfig(layers=args.layers, hidden=args.hidden),
            start=hashlib.sha256(args.start.read_bytes()).hexdigest()[:16] if args.start else "",
        )
        before = trainings_of(args.start) if args.start else []
        trainer = train(args.model, args.data, args.work, options, args.start)
        out = args.out or model.weights
        save_network(out, trainer.network)
        write_card(trainer, args.data, out.with_suffix(".json"), command + (" --start" if args.start else ""), before)
    except (ModelError, ValueError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    log.info("wrote %s and its card", out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
