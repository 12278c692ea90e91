"""Rows of `speed` that set our way beside the usual or the published one: silhouettes, the latent fit, Task 4."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from nnproc.infer import load_network
from nnproc.latent_fit import PAPER, Objective, fit, silhouette_objective, turned
from nnproc.losses import kl_divergence
from nnproc.ray_marching import ray_march
from nnproc.ray_operator import RayOperator, ray_operator
from nnproc.rays import paper_cameras
from procmodels import load
from recon.evaluate.data.held_out import SIZE, Case, cases, masks
from recon.evaluate.speed.rows import Side, SpeedOptions, SpeedRow, in_turn
from recon.evaluate.tables.methods import EVALUATIONS, Bench, cobyqa, search_masks

CHANNELS = (40, 32, 24, 16, 8)  # of the published decoder, coarse to fine


@dataclass(frozen=True)
class Subject:
    """One held-out chair before the paper's four cameras: what all rows are measured on.

    target (4, size, size) exact masks;  grid (1, 64, 64, 64) the network's logits of the true parameters
    """

    bench: Bench
    case: Case
    K: Tensor
    cam_from_canonical: Tensor
    target: Tensor
    grid: Tensor

    def march(self, logits: Tensor, samples: int) -> Tensor:
        """(B, 4, size, size) silhouettes by plain ray marching of logits (B, 64, 64, 64)."""
        size = self.target.shape[-1]
        return ray_march(torch.sigmoid(logits), self.K, self.cam_from_canonical, size, size, samples)

    def operator(self) -> RayOperator:
        """All pixels of the four views as our sparse operator."""
        size = self.target.shape[-1]
        return ray_operator(self.K, self.cam_from_canonical, size, size)


def subject(options: SpeedOptions) -> Subject:
    """The first held-out on-grid chair and the shipped network."""
    if not 1 <= options.size <= SIZE or SIZE % options.size:
        raise ValueError(f"size must divide {SIZE}, got {options.size}")
    model = load("paper/chair")
    network = load_network(model.space, model.weights, decoder=True)
    (case,) = cases(model, "on", 1)
    K, cam_from_canonical = (c.float() for c in paper_cameras(options.size))
    stride = SIZE // options.size
    with torch.no_grad():
        grid = network.decode_grid(network.encode_params(network.codec.vectors([case.params])))
    bench = Bench(model, network, options.work, options.data)
    return Subject(bench, case, K, cam_from_canonical, masks(case.shape, "paper")[:, ::stride, ::stride], grid)


def silhouettes(on: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """Four views forward and backward: the operator against ray marching."""
    operator, logits = on.operator(), on.grid.clone().requires_grad_()

    def both_ways(draw: Callable[[Tensor], Tensor]) -> Side:
        return Side(lambda: torch.autograd.grad(draw(logits).sum(), logits))

    marches = [both_ways(partial(on.march, samples=n)) for n in options.samples]
    ours, *others = in_turn([both_ways(operator.render), *marches], options.repeats, options.least)
    what = f"silhouettes, 4 views of {options.size}^2, forward and backward: sparse operator"
    return [
        SpeedRow(what, f"grid_sample ray marching, {n} samples a ray", ours, other)
        for n, other in zip(options.samples, others, strict=True)
    ]


def latent_fit(on: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """The same fit of latents with either renderer as its objective, from the same starts."""
    network, samples = on.bench.network, options.samples[-1]
    operator = on.operator()
    rng = np.random.default_rng(0)
    vectors = network.codec.vectors([network.space.sample(rng) for _ in range(options.fit.starts)])
    starts = [(z, 0) for z in network.encode_params(vectors)]

    def marched(logits: Tensor, turns: Tensor) -> Tensor:
        return (on.march(turned(logits, turns).float(), samples) - on.target).square().flatten(1).mean(1)

    objectives: list[Objective] = [silhouette_objective(operator, operator.gather(on.target)), marched]
    # One step warms up: a whole fit by marching takes a while.
    short = replace(options.fit, steps=1)
    fits = [partial(fit, network, o, extra_starts=starts) for o in objectives]
    sides = [Side(partial(f, options=options.fit), warm=partial(f, options=short)) for f in fits]
    ours, other = in_turn(sides, options.repeats, options.least)
    words = f"latent fit, {options.fit.starts} starts, {options.fit.steps} steps, 4 views of {options.size}^2"
    return [SpeedRow(f"{words}: sparse operator", f"the same with ray marching, {samples} samples a ray", ours, other)]


class PublishedDecoder(nn.Module):
    """A decoder like the published one: 3^3 convolutions at every scale up to 64^3. Untrained: only its time counts."""

    def __init__(self, latent: int = 128) -> None:
        super().__init__()
        self.start = nn.Sequential(nn.Linear(latent, 256), nn.ReLU(), nn.Linear(256, CHANNELS[0] * 4**3), nn.ReLU())
        layers: list[nn.Module] = [nn.Conv3d(CHANNELS[0], CHANNELS[0], 3, padding=1), nn.ReLU()]  # 4^3
        for a, b in zip(CHANNELS[:-1], CHANNELS[1:], strict=True):
            layers += [nn.Upsample(scale_factor=2), nn.Conv3d(a, b, 3, padding=1), nn.ReLU()]
        self.convs = nn.Sequential(*layers, nn.Conv3d(CHANNELS[-1], 1, 3, padding=1))

    def forward(self, z: Tensor) -> Tensor:
        """Latents (B, latent) to logits (B, 64, 64, 64)."""
        return self.convs(self.start(z).reshape(-1, CHANNELS[0], 4, 4, 4))[:, 0]


def published_steps(on: Subject, decoder: nn.Module, samples: int, count: int) -> None:
    """`count` steps of the paper's Task 4: one start at zero, L2 summed over pixels + KL, Adam; all in float32."""
    mean, logvar = (torch.zeros(1, 128, requires_grad=True) for _ in range(2))
    optimiser = torch.optim.Adam([mean, logvar], lr=PAPER.learning_rate)
    for _ in range(count):
        optimiser.zero_grad()
        z = mean + torch.randn_like(mean) * (0.5 * logvar).exp()
        loss = (on.march(decoder(z), samples) - on.target).square().sum()
        (loss + kl_divergence(mean, logvar).sum()).backward()
        optimiser.step()


def task4(on: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """One chair from four masks: our search against the published protocol and against the derivative-free baseline."""
    ours, samples, count = search_masks("paper"), options.samples[-1], options.published_steps
    decoder = PublishedDecoder().requires_grad_(False)
    sides = [
        Side(lambda: ours(on.bench, on.case)),  # its first call, unmeasured, makes the bank when there is none
        Side(
            lambda: published_steps(on, decoder, samples, count),
            scale=PAPER.steps / count,
            warm=lambda: published_steps(on, decoder, samples, 1),
        ),
        Side(lambda: cobyqa(on.bench, on.case)),
    ]
    ours_s, published_s, baseline_s = in_turn(sides, options.repeats, options.least)
    what = "Task 4, one chair from four masks: our search"
    published = (
        f"the published protocol, {PAPER.steps} steps (scaled from {count}), {samples} samples a ray, 3^3 decoder"
    )
    baseline = f"COBYQA from a random start, {EVALUATIONS} evaluations"
    return [SpeedRow(what, published, ours_s, published_s), SpeedRow(what, baseline, ours_s, baseline_s)]


PARTS = (silhouettes, latent_fit, task4)
