"""Train the network that tells kinds of things by their outlines (nnproc.outline_net).

    python -m datasets.outlines --data ikea_dev --data pix3d_dev --out DATA
    python -m nnproc.learn_outlines --data DATA

About ten minutes of one core. `--without N` leaves out the N-th third of the real objects, so that what is measured on
them (recon.evaluate.beliefs) is not what was learnt.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import time
import zlib
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path

import cv2
import numpy as np
import torch
from torch.nn import functional as F

from datasets import outlines
from datasets.outline_frame import KINDS
from datasets.outlines import Outlines
from nnproc.outline_net import FILE, OutlineNet, save
from nnproc.shape_nets import channels_last

log = logging.getLogger("nnproc.learn_outlines")
PARTS = 3  # of the real objects: what one of three networks did not see


@dataclass(frozen=True)
class LearnOptions:
    """How to train."""

    steps: int = 4000
    batch: int = 192
    real: float = 0.6  # share of a batch that real objects are
    learning_rate: float = 1.5e-3
    decay: float = 1e-3
    shift: int = 3  # px by which pictures are moved at most
    seed: int = 0


def part_of(name: str) -> int:
    """Which third of the real objects one belongs to; by its name alone."""
    return zlib.crc32(f"outline {name}".encode()) % PARTS


def train(found: Outlines, without: int | None, options: LearnOptions = LearnOptions()) -> OutlineNet:
    """The network of all pictures, but for those of one part of the real objects."""
    torch.manual_seed(options.seed)
    rng = np.random.default_rng(options.seed)
    network = OutlineNet()
    channels_last(network)
    left_out = np.array([part_of(n) == without for n in found.names] + [False])[found.owners]
    pools = [_by_kind(found, (found.owners >= 0) & ~left_out), _by_kind(found, found.owners < 0)]
    optimiser = torch.optim.AdamW(network.parameters(), options.learning_rate, weight_decay=options.decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, options.learning_rate, options.steps)
    started, said = time.monotonic(), []
    for step in range(options.steps):
        real = int(options.real * options.batch) if pools[0] else 0
        index = np.concatenate([_drawn(pools[0], real, rng), _drawn(pools[1], options.batch - real, rng)])
        pictures = torch.from_numpy(_moved(found.pictures(index), options.shift, rng))
        with torch.autocast("cpu", torch.bfloat16):
            said_kinds = network(pictures.contiguous(memory_format=torch.channels_last))
        loss = F.cross_entropy(said_kinds.float(), torch.from_numpy(found.kinds[index]), label_smoothing=0.05)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        said.append(float(loss.detach()))
        if (step + 1) % 500 == 0:
            log.info("step %d, loss %.3f, %.0f s", step + 1, np.mean(said[-500:]), time.monotonic() - started)
    return network.eval()


def _by_kind(found: Outlines, of: np.ndarray) -> list[list[np.ndarray]]:
    """Places of the pictures of every object that counts, by kind; made shapes are one object each kind."""
    out: list[list[np.ndarray]] = []
    for kind in range(len(KINDS)):
        mine = np.flatnonzero(of & (found.kinds == kind))
        out.append([mine[found.owners[mine] == o] for o in np.unique(found.owners[mine])])
    return [some for some in out if some]


def _drawn(pools: list[list[np.ndarray]], count: int, rng: np.random.Generator) -> np.ndarray:
    """Places of `count` pictures: every kind as often, of a kind every object as often; "other", which is many things,
    three times as often."""
    if not count:
        return np.zeros(0, int)
    weights = np.ones(len(pools))
    weights[-1] = 3.0 if len(pools) == len(KINDS) else 1.0
    kinds = rng.choice(len(pools), count, p=weights / weights.sum())
    objects = [pools[k][rng.integers(len(pools[k]))] for k in kinds]
    return np.array([o[rng.integers(len(o))] for o in objects])


def _moved(pictures: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    """(m, 1, 64, 64) float32: mirrored by chance, moved by some pixels, and a little fatter or thinner."""
    out = np.empty((len(pictures), 1, *pictures.shape[1:]), np.float32)
    for i, picture in enumerate(pictures):
        one = picture[:, ::-1] if rng.random() < 0.5 else picture
        scale, (x, y) = rng.uniform(0.92, 1.05), rng.integers(-most, most + 1, 2)
        middle = pictures.shape[1] / 2
        turn = np.array([(scale, 0, middle * (1 - scale) + x), (0, scale, middle * (1 - scale) + y)])
        out[i, 0] = cv2.warpAffine(one.astype(np.float32), turn, one.shape[::-1], flags=cv2.INTER_LINEAR) >= 0.5
    return out


def accuracy(network: OutlineNet, found: Outlines, of: np.ndarray) -> dict[str, float]:
    """Share of the pictures whose kind is named, by kind, and of chairs and others told apart."""
    index = np.flatnonzero(of)
    with torch.no_grad():
        parts = [
            network(torch.from_numpy(found.pictures(i)[:, None].astype(np.float32)))
            for i in np.array_split(index, max(1, len(index) // 512))
        ]
    said, true = torch.cat(parts).argmax(1).numpy(), found.kinds[index]
    return {kind: round(float((said[true == k] == k).mean()), 4) for k, kind in enumerate(KINDS) if (true == k).any()}


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m nnproc.learn_outlines", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--data", type=Path, required=True, help="folder that datasets.outlines wrote")
    parser.add_argument("--out", type=Path, default=FILE, help="the weights' file")
    parser.add_argument("--without", type=int, choices=range(PARTS), help="leave out a third of the real objects")
    parser.add_argument("--steps", type=int, default=LearnOptions.steps)
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    file, options = args.data / "outlines.npz", LearnOptions(steps=args.steps)
    if not file.is_file():
        sys.stderr.write(f"error: there is no {file}; make it with: python -m datasets.outlines --out {args.data}\n")
        return 2
    found, started = outlines.read(file), time.process_time()
    network = train(found, args.without, options)
    parts = np.array([part_of(n) for n in found.names] + [-1])[found.owners]
    unseen = (found.owners >= 0) & (parts == args.without)
    tested = accuracy(network, found, unseen) if unseen.any() else {}
    log.info("on objects that were left out: %s", tested)
    save(network, args.out)
    card = {
        "what": "kinds of things by their outlines",
        "kinds": KINDS,
        "options": asdict(options),
        "pictures": len(found.bits),
        "real objects": len(found.names),
        "minutes": round((time.process_time() - started) / 60, 1),
        "date": str(date.today()),
        "left out": args.without,
        "named right of these": tested,
    }
    args.out.with_suffix(".json").write_text(json.dumps(card, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
