"""Finish a trained network: each half goes on against the frozen other half, side by side on two cores.

    python -m nnproc.finish chair

In joint training the voxel term drowns the parameter term: SD is good long before PD, and SE serves both. Once PE has
settled the latent space, the halves no longer need each other:
  decode  SD learns on, from PE's codes and SE's samples (PE and SE frozen)
  encode  SE and PD learn on: SE towards PE's codes, PD from SE's samples and PE's codes (PE and SD frozen)
Each half is one process with one thread that writes its own file; an interrupted half goes on from its last save.
"""

from __future__ import annotations

import argparse
import copy
import json
import logging
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from datasets.synthetic import read
from nnproc import child
from nnproc.infer import WEIGHTS, load_network, save_network
from nnproc.losses import LossWeights, kl_divergence, similarity_loss
from nnproc.muon import Muon
from nnproc.network import NNProc, occupancy_loss
from nnproc.train import CellStore, TrainOptions, learning_rate, mixed_batch, optimiser_state, score
from procmodels import ModelError, load

log = logging.getLogger("nnproc.finish")
SIGMA = 3.0  # weight of the squared change of log sigma^2
HALVES = {"decode": ("shape_decoder",), "encode": ("shape_encoder", "param_decoder")}


@dataclass(frozen=True)
class FinishOptions:
    """How the halves go on; each card says what made its weights."""

    decode_steps: int = 2500
    encode_steps: int = 3000
    batch: int = 16
    decode_rate: float = 1e-3  # peak of the one-cycle schedule
    encode_rate: float = 1e-3
    on_grid_share: float = 0.6
    save_every: int = 300
    seed: int = 1


def half_loss(network: NNProc, before: nn.Module, half: str, cells: Tensor, vectors: Tensor, noise: Tensor) -> Tensor:
    """What one half minimises on a batch. `before` is SE as it was.

    Without SD nothing but the KL term would speak for sigma, and it would grow until samples mean nothing: the encoding
    half keeps the sigma that the joint training balanced.
    """
    weights = LossWeights()
    z_params = network.encode_params(vectors)
    with torch.set_grad_enabled(half == "encode"):
        mean, logvar = network.encode_cells(cells)
        z_shape = mean + noise * (0.5 * logvar).exp()
    if half == "decode":
        z = torch.cat([z_params[: len(z_params) // 2], z_shape[len(z_params) // 2 :]])
        return occupancy_loss(network.decode_cells(z), cells).mean()
    with torch.no_grad():
        logvar_before = before(cells).float().chunk(2, 1)[1].clamp(-12, 6)
    param = sum(network.codec.loss(network.score_params(z), vectors).mean() for z in (mean, z_shape, z_params))
    return (
        weights.param * param
        + weights.latent * (mean - z_params).square().sum(1).mean()
        + weights.kl * kl_divergence(mean, logvar).mean()
        + SIGMA * (logvar - logvar_before).square().sum(1).mean()
        + weights.sim * similarity_loss(mean, vectors)
    )


def finish_half(class_name: str, half: str, data: Path, work: Path, options: FinishOptions) -> None:
    """Train one half and write it, with the seconds of processor time it took, to `work`/HALF.safetensors."""
    torch.set_num_threads(1)
    network = load_network(load(class_name).space)
    before = copy.deepcopy(network.shape_encoder)
    stores = [CellStore(read(data, which, network.space.hash)) for which in ("train_on", "train_off")]
    trained = {n: p for n, p in network.named_parameters() if n.split(".")[0] in HALVES[half]}
    for parameter in trained.values():
        parameter.requires_grad_(True)
    steps = options.decode_steps if half == "decode" else options.encode_steps
    rate = options.decode_rate if half == "decode" else options.encode_rate
    schedule = TrainOptions(
        steps=steps,
        batch=options.batch,
        learning_rate=rate,
        on_grid_share=options.on_grid_share,
        seed=options.seed,
    )
    optimiser = Muon(trained.values())
    path = work / f"{half}.safetensors"
    step, spent = _resume(path, trained, optimiser, asdict(options))
    started = time.process_time()
    while step < steps:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(step, schedule)
        cells, vectors = mixed_batch(stores, step, schedule)
        generator = torch.Generator().manual_seed(options.seed * 1_000_003 + step)
        noise = torch.randn(len(cells), network.config.latent, generator=generator)
        with torch.autocast("cpu", torch.bfloat16):
            loss = half_loss(network, before, half, cells, vectors, noise)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        step += 1
        if step % 100 == 0:
            log.info("%s step %d of %d: %.4g", half, step, steps, float(loss.detach()))
        if step % options.save_every == 0 or step == steps:
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


def merge(class_name: str, data: Path, work: Path, options: FinishOptions) -> None:
    """Put both halves into the shipped weights and bring the card up to date. Merging again changes nothing."""
    network = load_network(load(class_name).space)
    state, minutes = network.state_dict(), {}
    for half in [h for h in HALVES if (work / f"{h}.safetensors").is_file()]:
        with safe_open(work / f"{half}.safetensors", framework="pt") as file:
            state |= {k[4:]: file.get_tensor(k) for k in file.keys() if k.startswith("net.")}  # noqa: SIM118 (not a dict)
            minutes[half] = round(float(file.metadata()["seconds"]) / 60, 1)
    network.load_state_dict(state)
    path = WEIGHTS / f"{class_name}.safetensors"
    card = json.loads(path.with_suffix(".json").read_text())
    command = f"python -m nnproc.finish {class_name} --seed {options.seed} --on-grid-share {options.on_grid_share}"
    command += f" --decode-steps {options.decode_steps} --encode-steps {options.encode_steps}"
    if len(minutes) < len(HALVES):
        command += f" --half {next(iter(minutes))}"
    entry = {"command": command, "options": asdict(options), "minutes": minutes}
    if entry in card.get("finish", []):
        log.info("%s holds these halves already", path)
        return
    card |= {
        "finish": [*card.get("finish", []), entry],
        # Side by side on two cores, a finish takes as long as its slower half.
        "minutes": round(card["minutes"] + max(minutes.values()), 1),
        "held_out": {w: score(network, read(data, w, network.space.hash)) for w in ("test_on", "test_off")},
    }
    save_network(path, network)
    path.with_suffix(".json").write_text(json.dumps(card, indent=1) + "\n")


def main(argv: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m nnproc.finish", description=__doc__.split("\n")[0])
    parser.add_argument("class_name", metavar="class")
    parser.add_argument("--data", type=Path, help="generated pairs (default .cache/data/CLASS)")
    parser.add_argument("--work", type=Path, help="checkpoints (default .cache/finish/CLASS_SEED)")
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
    try:
        if args.half in HALVES:
            finish_half(args.class_name, args.half, data, work, options)
            return 0
        if args.half is None:
            own = [args.class_name, "--data", str(data.resolve()), "--work", str(work.resolve())]
            for flag in ("seed", "on_grid_share", "decode_steps", "encode_steps"):
                own += [f"--{flag.replace('_', '-')}", str(getattr(options, flag))]
            halves = [child.start("nnproc.finish", *own, "--half", half) for half in HALVES]
            if any([p.wait() for p in halves]):
                raise ValueError("a half failed; its message stands above")
        merge(args.class_name, data, work, options)
    except (ModelError, ValueError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
