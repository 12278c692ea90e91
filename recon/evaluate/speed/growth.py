"""Rows of `speed` about growth: one gradient step with more views, larger images, more starts, finer grids."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from nnproc.network import NNProc
from nnproc.ray_operator import RayOperator, ray_operator
from nnproc.rays import look_at_cameras
from nnproc.shape_nets import RESOLUTION
from recon.evaluate.speed.pairs import Subject
from recon.evaluate.speed.rows import GROWTH, Side, SpeedOptions, SpeedRow, in_turn

FOUR = 4  # views where something else grows


def orbit(views: int, size: int, resolution: int = RESOLUTION) -> RayOperator:
    """Cameras all round a whole object, low and high in turn."""
    azimuth = [360 * v / views for v in range(views)]
    elevation = [15.0 + 20 * (v % 2) for v in range(views)]
    return ray_operator(*look_at_cameras(azimuth, elevation, 2.2, 35, size), size, size, resolution)


def operator_bytes(operator: RayOperator) -> int:
    """Values and indices of both orders of the sparse matrix."""
    arrays = [a for w in (operator.weight, operator.weight_t) for a in (w.values(), w.col_indices(), w.crow_indices())]
    return sum(a.nbytes for a in arrays)


def step_mb(operator: RayOperator, count: int) -> float:
    """The operator, and the float32 logits, silhouettes and gradients of both of `count` grids, in MB."""
    numbers = 2 * count * (operator.resolution**3 + operator.n_rays)
    return (operator_bytes(operator) + 4 * numbers) / 1e6


def network_step(network: NNProc, operator: RayOperator, count: int) -> Callable[[], object]:
    """Decode `count` latents, draw them, compare with an empty image, and go all the way back."""
    z = torch.randn(count, network.config.latent, generator=torch.Generator().manual_seed(0)).requires_grad_()

    def step() -> tuple[Tensor, ...]:
        with torch.autocast(z.device.type, torch.bfloat16):
            logits = network.decode_grid(z)
        return torch.autograd.grad(operator.render(logits.float()).square().mean(), z)

    return step


def operator_step(operator: RayOperator, count: int) -> Callable[[], object]:
    """Draw `count` random grids and go back."""
    logits = (torch.randn(count, *(operator.resolution,) * 3) - 4).requires_grad_()
    return lambda: torch.autograd.grad(operator.render(logits).square().mean(), logits)


Measured = tuple[str, RayOperator, int, Callable[[], object]]  # words, operator, grids, one step


def _rows(kind: str, measured: Sequence[Measured], options: SpeedOptions) -> list[SpeedRow]:
    """Each size against the first."""
    seconds = in_turn([Side(call) for *_, call in measured], options.repeats, options.least)
    first = measured[0][0]
    return [
        SpeedRow(f"{GROWTH}{kind}: {words}", first, s, seconds[0], step_mb(operator, count))
        for (words, operator, count, _), s in zip(measured, seconds, strict=True)
    ]


def views(on: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """More views."""
    network, n, size = on.bench.network, options.latents, options.view_size
    operators = [orbit(v, size) for v in options.views]
    measured = [(f"{_views(o)} of {size}^2", o, n, network_step(network, o, n)) for o in operators]
    return _rows(f"a step of {n} latents", measured, options)


def images(on: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """Larger images of as many views."""
    network, n = on.bench.network, options.latents
    operators = [orbit(FOUR, side) for side in options.sides]
    measured = [(f"{_views(o)}, {o.shape[1]}^2 each", o, n, network_step(network, o, n)) for o in operators]
    return _rows(f"a step of {n} latents", measured, options)


def starts(on: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """More latents at once."""
    operator = orbit(FOUR, options.view_size)
    kind = f"a step, {_views(operator)} of {options.view_size}^2"
    measured = [
        (f"{n} start{'s' * (n != 1)}", operator, n, network_step(on.bench.network, operator, n)) for n in options.starts
    ]
    return _rows(kind, measured, options)


def grids(_: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """Finer grids, the operator alone: the network's own grid is fixed."""
    n, size = options.latents, options.view_size
    operators = [orbit(FOUR, size, resolution) for resolution in options.grids]
    measured = [(f"{o.resolution}^3 voxels", o, n, operator_step(o, n)) for o in operators]
    return _rows(f"the operator alone, {n} grids, {FOUR} views of {size}^2", measured, options)


def _views(operator: RayOperator) -> str:
    count = operator.shape[0]
    return f"{count} view{'s' * (count != 1)}"


PARTS = (views, images, starts, grids)
