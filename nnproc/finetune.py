"""Finish a trained network: the forward half learns on, then the inverse half learns to follow it.

    python -m nnproc.finetune chair

In joint training the voxel term drowns the parameter term, and SE costs most of a step. Hence, after it:
  decode  PE and SD learn on, from PE's codes, half of a batch with noise as wide as SE's: what Task 1 measures
  encode  SE and PD learn on: SE towards PE's codes, PD from SE's samples and PE's codes (PE and SD frozen)
Each half writes its own file; an interrupted half goes on from its last save. Then both go into the weights.
"""

from __future__ import annotations

import argparse
import copy
import json
import logging
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from datasets.synthetic import Pairs, read
from nnproc.infer import load_network, save_network
from nnproc.losses import LossWeights, kl_divergence, similarity_loss
from nnproc.muon import Muon
from nnproc.network import NNProc, occupancy_loss, occupancy_slope
from nnproc.train import CellStore, Store, TrainOptions, learning_rate, mixed_batch, optimiser_state, score
from procmodels import ModelError, load

log = logging.getLogger("nnproc.finetune")
SIGMA = 3.0  # weight of the squared change of log sigma^2
HALVES = {"decode": ("param_encoder", "shape_decoder"), "encode": ("shape_encoder", "param_decoder")}
SAMPLES = 200  # of each set, for the width of SE's samples
LOG_EVERY = 500  # steps

# A batch's loss; its gradients are left in the parameters. The value is None where computing it would cost time.
Step = Callable[[Tensor, Tensor, Tensor, bool], float | None]


@dataclass(frozen=True)
class FinishOptions:
    """How the halves go on; each card says what made its weights."""

    decode_steps: int = 20000
    encode_steps: int = 6000
    batch: int = 16
    decode_rate: float = 2e-3  # peak of the one-cycle schedule
    encode_rate: float = 1e-3
    on_grid_share: float = 0.4
    save_every: int = 300
    seed: int = 1


class GridStore:
    """Training pairs in memory, grids as packed bits as they lie in the file."""

    def __init__(self, pairs: Pairs) -> None:
        self.vectors, self.bits = torch.from_numpy(pairs.vectors), pairs.bits

    def __len__(self) -> int:
        return len(self.vectors)

    def batch(self, index: np.ndarray) -> tuple[Tensor, Tensor]:
        """Grids (B, 64, 64, 64) bfloat16 and vectors (B, width)."""
        flat = torch.from_numpy(np.unpackbits(self.bits[index], axis=1)).to(torch.bfloat16)
        return flat.reshape(-1, 64, 64, 64), self.vectors[index]


def decode_step(network: NNProc, sigma: Tensor) -> Step:
    """PE and SD on grids (B, 64, 64, 64); `sigma` (latent,) is the width of SE's samples.

    The codes carry the KL and similarity terms that SE's means do, so that the latent keeps its size and meaning.
    """
    weights = LossWeights()

    def step(grids: Tensor, vectors: Tensor, noise: Tensor, logged: bool) -> float | None:
        half = len(grids) // 2
        with torch.autocast("cpu", torch.bfloat16):
            z = network.encode_params(vectors)
            logits = network.decode_grid(torch.cat([z[:half], z[half:] + sigma * noise[half:]]))
        terms = weights.kl * kl_divergence(z, torch.zeros_like(z)).mean() + weights.sim * similarity_loss(z, vectors)
        slope = occupancy_slope(logits.detach(), grids).div_(len(grids))
        torch.autograd.backward([logits, terms], [slope, torch.ones_like(terms)])
        return float(occupancy_loss(logits.detach(), grids).mean()) if logged else None

    return step


def encode_step(network: NNProc) -> Step:
    """SE and PD on cells, PE and SD frozen.

    Without SD nothing but the KL term would speak for sigma, and it would grow until samples mean nothing: sigma stays
    as the joint training balanced it.
    """
    weights, before = LossWeights(), copy.deepcopy(network.shape_encoder)

    def step(cells: Tensor, vectors: Tensor, noise: Tensor, logged: bool) -> float | None:
        with torch.autocast("cpu", torch.bfloat16):
            z_params = network.encode_params(vectors)
            mean, logvar = network.encode_cells(cells)
            z_shape = mean + noise * (0.5 * logvar).exp()
            with torch.no_grad():
                logvar_before = before(cells).float().chunk(2, 1)[1].clamp(-12, 6)
            param = sum(network.codec.loss(network.score_params(z), vectors).mean() for z in (mean, z_shape, z_params))
        loss = (
            weights.param * param
            + weights.latent * (mean - z_params).square().sum(1).mean()
            + weights.kl * kl_divergence(mean, logvar).mean()
            + SIGMA * (logvar - logvar_before).square().sum(1).mean()
            + weights.sim * similarity_loss(mean, vectors)
        )
        loss.backward()
        return float(loss.detach()) if logged else None

    return step


@torch.inference_mode()
def sample_width(network: NNProc, grids: Tensor) -> Tensor:
    """(latent,) root mean square of SE's sigma over some grids."""
    with torch.autocast("cpu", torch.bfloat16):
        _, logvar = network.encode_grid(grids)
    return logvar.exp().mean(0).sqrt()


def _decode_half(network: NNProc, pairs: list[Pairs]) -> tuple[Sequence[Store], Step]:
    stores = [GridStore(p) for p in pairs]
    some = torch.cat([s.batch(np.arange(min(SAMPLES, len(s))))[0] for s in stores])
    return stores, decode_step(network, sample_width(network, some).clone())  # a copy that gradients may meet


def _encode_half(network: NNProc, pairs: list[Pairs], work: Path) -> tuple[Sequence[Store], Step]:
    if (decoded := work / "decode.safetensors").is_file():
        network.load_state_dict(_half(decoded), strict=False)
    return [CellStore(p) for p in pairs], encode_step(network)


def finish_half(class_name: str, half: str, data: Path, work: Path, options: FinishOptions, weights: Path) -> None:
    """Train one half and write it, with the seconds of processor time it took, to `work`/HALF.safetensors."""
    network = load_network(load(class_name).space, weights, decoder=True)
    pairs = [read(data, which, network.space.hash) for which in ("train_on", "train_off")]
    stores, take = _decode_half(network, pairs) if half == "decode" else _encode_half(network, pairs, work)
    trained = {n: p for n, p in network.named_parameters() if n.split(".")[0] in HALVES[half]}
    for parameter in trained.values():
        parameter.requires_grad_(True)
    schedule = TrainOptions(
        steps=getattr(options, f"{half}_steps"),
        batch=options.batch,
        learning_rate=getattr(options, f"{half}_rate"),
        on_grid_share=options.on_grid_share,
        seed=options.seed,
    )
    optimiser = Muon(trained.values())
    path = work / f"{half}.safetensors"
    step, spent = _resume(path, trained, optimiser, asdict(options))
    started = time.process_time()
    while step < schedule.steps:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(step, schedule)
        shapes, vectors = mixed_batch(stores, step, schedule)
        generator = torch.Generator().manual_seed(options.seed * 1_000_003 + step)
        noise = torch.randn(len(shapes), network.config.latent, generator=generator)
        optimiser.zero_grad(set_to_none=True)
        loss = take(shapes, vectors, noise, (step + 1) % LOG_EVERY == 0)
        optimiser.step()
        step += 1
        if loss is not None:
            log.info("%s step %d of %d: %.4g", half, step, schedule.steps, loss)
        if step % options.save_every == 0 or step == schedule.steps:
            _save(path, trained, optimiser, step, spent + time.process_time() - started, asdict(options))


def _save(
    path: Path,
    trained: dict[str, torch.nn.Parameter],
    optimiser: torch.optim.Optimizer,
    step: int,
    seconds: float,
    options: dict,
) -> None:
    tensors: dict[str, Tensor] = {f"net.{n}": p for n, p in trained.items()}
    for name, parameter in trained.items():
        tensors |= {f"opt.{k}.{name}": v for k, v in optimiser.state[parameter].items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    metadata = {"step": str(step), "seconds": str(seconds), "options": json.dumps(options)}
    save_file({k: v.detach().contiguous() for k, v in tensors.items()}, partial, metadata)
    partial.replace(path)


def _resume(
    path: Path, trained: dict[str, torch.nn.Parameter], optimiser: torch.optim.Optimizer, options: dict
) -> tuple[int, float]:
    """Take up an earlier save of the same options; the step to go on from and the seconds already spent."""
    if not path.is_file():
        return 0, 0.0
    with safe_open(path, framework="pt") as file:
        metadata = file.metadata()
        if json.loads(metadata["options"]) != options:
            raise ValueError(f"{path} belongs to a run with other options; remove it or use another --work folder")
        tensors = {k: file.get_tensor(k) for k in file.keys()}  # noqa: SIM118 (not a dict)
        for name, parameter in trained.items():
            parameter.data.copy_(tensors[f"net.{name}"])
            optimiser.state[parameter] = optimiser_state(tensors, name, parameter)
    return int(metadata["step"]), float(metadata["seconds"])


def _half(path: Path) -> dict[str, Tensor]:
    """The weights that a half trained."""
    with safe_open(path, framework="pt") as file:
        return {k[4:]: file.get_tensor(k) for k in file.keys() if k.startswith("net.")}  # noqa: SIM118 (not a dict)


def merge(class_name: str, data: Path, work: Path, options: FinishOptions, path: Path) -> None:
    """Put both halves into the weights at `path` and bring their card up to date. Merging again changes nothing."""
    network = load_network(load(class_name).space, path, decoder=True)
    minutes = {}
    for half in [h for h in HALVES if (work / f"{h}.safetensors").is_file()]:
        network.load_state_dict(_half(work / f"{half}.safetensors"), strict=False)
        with safe_open(work / f"{half}.safetensors", framework="pt") as file:
            minutes[half] = round(float(file.metadata()["seconds"]) / 60, 1)
    card = json.loads(path.with_suffix(".json").read_text())
    command = f"python -m nnproc.finetune {class_name} --seed {options.seed} --on-grid-share {options.on_grid_share}"
    command += f" --decode-steps {options.decode_steps} --encode-steps {options.encode_steps}"
    if len(minutes) < len(HALVES):
        command += f" --half {next(iter(minutes))}"
    entry = {"command": command, "options": asdict(options), "minutes": minutes}
    if entry in card.get("finish", []):
        log.info("%s holds these halves already", path)
        return
    card |= {
        "finish": [*card.get("finish", []), entry],
        "minutes": round(card["minutes"] + sum(minutes.values()), 1),
        "held_out": {w: score(network, read(data, w, network.space.hash)) for w in ("test_on", "test_off")},
    }
    save_network(path, network)
    path.with_suffix(".json").write_text(json.dumps(card, indent=1) + "\n")


def main(argv: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m nnproc.finetune", description=__doc__.split("\n")[0])
    parser.add_argument("class_name", metavar="class")
    parser.add_argument("--data", type=Path, help="generated pairs (default .cache/data/CLASS)")
    parser.add_argument("--work", type=Path, help="checkpoints (default .cache/finish/CLASS_SEED)")
    parser.add_argument("--weights", type=Path, help="what goes on (default: beside the model)")
    parser.add_argument("--seed", type=int, default=1, help="another seed for another round")
    parser.add_argument("--on-grid-share", type=float, default=FinishOptions.on_grid_share)
    parser.add_argument("--decode-steps", type=int, default=FinishOptions.decode_steps)
    parser.add_argument("--encode-steps", type=int, default=FinishOptions.encode_steps)
    parser.add_argument("--half", choices=(*HALVES, "merge"), help="only this part (default: both, then merge)")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    data = args.data or Path(".cache/data") / args.class_name
    work = args.work or Path(".cache/finish") / f"{args.class_name}_{args.seed}"
    options = FinishOptions(
        seed=args.seed,
        on_grid_share=args.on_grid_share,
        decode_steps=args.decode_steps,
        encode_steps=args.encode_steps,
    )
    weights = args.weights or load(args.class_name).weights
    try:
        for half in [args.half] if args.half in HALVES else HALVES if args.half is None else ():
            finish_half(args.class_name, half, data, work, options, weights)
        if args.half not in HALVES:
            merge(args.class_name, data, work, options, weights)
    except (ModelError, ValueError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
