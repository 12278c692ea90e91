"""Fit a latent to silhouettes (Task 4) or to a grid (Task 3): optimise mu and log sigma^2, many starts at once.

A free latent drifts to places where SD draws the right silhouette and PD reads nonsense, so our objective keeps z where
the two latent spaces agree: PE(PD(z)) = z. Starts come from a bank of generated shapes ranked by their own silhouettes
and, when there is one, from the visual hull through SE. `PAPER` is the procedure of the paper's section 4.2.4.

The object may face any of four sides of the given canonical box: start b is drawn turned by turns[b] quarter turns
about Z, anticlockwise seen from above (from X towards Y), before it is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from datasets.hulls import skin
from nnproc.losses import kl_divergence
from nnproc.network import NNProc, occupancy_loss
from nnproc.on_device import codes_of_vectors, latents_of_grids, logits_of_latents, values_of_latents
from nnproc.ray_operator import RayOperator
from procmodels.space import Params


@dataclass(frozen=True)
class FitOptions:
    """How to search; the defaults are ours, PAPER is the published procedure."""

    bank: int = 256  # generated shapes ranked against the target, for every quarter turn (0: none)
    starts: int = 12  # latents optimised together, the best of the bank and the hull's
    keep: int = 4  # how many of them go on after `prune_at` steps
    prune_at: int = 15
    steps: int = 60
    learning_rate: float = 0.05
    data: float = 400.0  # weight of the mean squared silhouette difference
    cycle: float = 2.0  # weight of mean (PE(PD(z)) - z)^2
    kl: float = 1e-4  # weight of KL(N(mu, sigma^2) | N(0, 1))
    start_logvar: float = -6.0
    seed: int = 0


PAPER = FitOptions(
    bank=0, starts=1, keep=1, prune_at=0, steps=100, learning_rate=0.1, cycle=0.0, kl=1.0, data=1.0, start_logvar=0.0
)

Objective = Callable[[Tensor, Tensor], Tensor]  # cells' grids (B, 64, 64, 64) logits, turns (B,) -> (B,) loss


@dataclass(frozen=True)
class Fit:
    """One latent found: its decoded parameters, quarter turn, data loss (lower is better), mu and log sigma^2."""

    params: Params
    turn: int
    loss: float
    mean: Tensor
    logvar: Tensor


def turned(grids: Tensor, turns: Tensor | Sequence[int]) -> Tensor:
    """Grids (B, R, R, R), each turned by its number of quarter turns about Z (from X towards Y)."""
    counts = [int(t) for t in turns]
    if not any(counts):
        return grids
    return torch.stack([torch.rot90(g, t, (0, 1)) for g, t in zip(grids, counts, strict=True)])


def silhouette_objective(operator: RayOperator, target: Tensor, total: bool = False) -> Objective:
    """Squared difference between rendered silhouettes and target (n_rays,): mean over rays, or their sum (paper)."""

    def loss(logits: Tensor, turns: Tensor) -> Tensor:
        error = (operator.render(turned(logits, turns).float()) - target).square()
        return error.sum(1) if total else error.mean(1)

    return loss


def grid_objective(grid: Tensor, total: bool = False) -> Objective:
    """Cross-entropy with a target grid (64, 64, 64), turns ignored: mean over voxels (scaled), or the paper's sum."""

    def loss(logits: Tensor, turns: Tensor) -> Tensor:
        entropy = occupancy_loss(logits, grid.expand_as(logits))
        # Scaled so that the same weights serve both objectives: about 1 % of a grid's voxels are as many as matter.
        return entropy if total else entropy / (0.01 * grid.numel())

    return loss


def fit(
    network: NNProc,
    objective: Objective,
    options: FitOptions = FitOptions(),
    turns: Sequence[int] = (0,),
    extra_starts: Sequence[tuple[Tensor, int]] = (),
    progress: bool = False,
) -> list[Fit]:
    """The best latents found, best first: at most `keep`.

    extra_starts are (latent, turn) pairs that are always tried, for example the hull through SE.
    """
    mean, turn = _starts(network, objective, options, turns, extra_starts)
    logvar = torch.full_like(mean, options.start_logvar)
    generator = torch.Generator().manual_seed(options.seed)
    state = _State(mean, logvar, turn, options)
    for step in tqdm(range(options.steps), desc="fit", unit="step", disable=None if progress else True):
        if step == options.prune_at and len(state.turn) > options.keep:
            losses = _data_loss(network, objective, state.mean.detach(), state.turn)
            state = state.kept(losses.argsort()[: options.keep])
        state.optimiser.zero_grad()
        noise = torch.randn(state.mean.shape, generator=generator)
        z = state.mean + noise * (0.5 * state.logvar).exp()
        _objective_sum(network, objective, z, state, options).backward()
        state.optimiser.step()
    return _results(network, objective, state, options)


class _State:
    """Latents under optimisation and their optimiser."""

    def __init__(self, mean: Tensor, logvar: Tensor, turn: Tensor, options: FitOptions) -> None:
        self.mean = mean.detach().clone().requires_grad_()
        self.logvar = logvar.detach().clone().requires_grad_()
        self.turn, self.options = turn, options
        self.optimiser = torch.optim.Adam([self.mean, self.logvar], lr=options.learning_rate)

    def kept(self, index: Tensor) -> _State:
        """Only these latents, with their moments."""
        new = _State(self.mean[index], self.logvar[index], self.turn[index], self.options)
        for old_p, new_p in ((self.mean, new.mean), (self.logvar, new.logvar)):
            old = self.optimiser.state.get(old_p, {})
            new.optimiser.state[new_p] = {k: v if v.dim() == 0 else v[index].clone() for k, v in old.items()}
        return new


def _objective_sum(network: NNProc, objective: Objective, z: Tensor, state: _State, options: FitOptions) -> Tensor:
    """The whole objective, summed over latents (which do not influence each other)."""
    loss = options.data * objective(logits_of_latents(network, z), state.turn)
    if options.cycle:
        back = codes_of_vectors(network, values_of_latents(network, z))
        loss = loss + options.cycle * (back - z).square().mean(1)
    if options.kl:
        loss = loss + options.kl * kl_divergence(state.mean, state.logvar)
    return loss.sum()


@torch.no_grad()
def _data_loss(network: NNProc, objective: Objective, z: Tensor, turn: Tensor, batch: int = 16) -> Tensor:
    parts = []
    for zs, ts in zip(z.split(batch), turn.split(batch), strict=True):
        parts.append(objective(logits_of_latents(network, zs), ts))
    return torch.cat(parts)


@torch.no_grad()
def _starts(
    network: NNProc,
    objective: Objective,
    options: FitOptions,
    turns: Sequence[int],
    extra: Sequence[tuple[Tensor, int]],
) -> tuple[Tensor, Tensor]:
    """Latents (B, latent) and turns (B,): the extra ones, then the best of the bank, then zeros."""
    latents = [z.reshape(1, -1) for z, _ in extra]
    turn = [t for _, t in extra]
    missing = max(options.starts - len(extra), 0)
    if options.bank and missing:
        bank, bank_turn = _ranked_bank(network, objective, options, turns)
        latents.append(bank[:missing])
        turn += bank_turn[:missing].tolist()
    elif missing:
        latents.append(torch.zeros(missing, network.config.latent))
        turn += [turns[i % len(turns)] for i in range(missing)]
    return torch.cat(latents), torch.tensor(turn)


def _ranked_bank(
    network: NNProc, objective: Objective, options: FitOptions, turns: Sequence[int]
) -> tuple[Tensor, Tensor]:
    """Generated shapes in every turn, nearest first."""
    rng = np.random.default_rng(options.seed)
    vectors = network.codec.vectors([network.space.sample(rng) for _ in range(options.bank)])
    codes = codes_of_vectors(network, vectors)
    losses = []
    for zs in codes.split(16):
        logits = logits_of_latents(network, zs)
        losses.append(torch.stack([objective(logits, torch.full((len(zs),), t)) for t in turns], 1))
    order = torch.cat(losses).flatten().argsort()
    return codes[order // len(turns)], torch.tensor(turns)[order % len(turns)]


@torch.no_grad()
def _results(network: NNProc, objective: Objective, state: _State, options: FitOptions) -> list[Fit]:
    losses = _data_loss(network, objective, state.mean, state.turn)
    params = network.codec.params(values_of_latents(network, state.mean))
    order = losses.argsort()[: options.keep].tolist()
    return [
        Fit(params[i], int(state.turn[i]), float(losses[i]), state.mean[i].detach(), state.logvar[i].detach())
        for i in order
    ]


@torch.no_grad()
def hull_starts(network: NNProc, hull: np.ndarray, turns: Sequence[int]) -> list[tuple[Tensor, int]]:
    """SE's means of the skin of a solid hull (64, 64, 64) bool, seen in the frame of each front hypothesis."""
    surface = torch.from_numpy(skin(hull)).float()
    grids = torch.stack([torch.rot90(surface, -t, (0, 1)) for t in turns])
    return list(zip(latents_of_grids(network, grids), turns, strict=True))
