"""Rows of `speed` about limits: shares of the machine's memory bandwidth and arithmetic, and the command's stages."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from nnproc.ray_operator import RayOperator, _product
from recon.evaluate.chair import SHIPPED, reconstruct
from recon.evaluate.speed.growth import orbit
from recon.evaluate.speed.pairs import Subject
from recon.evaluate.speed.rows import LIMIT, STAGE, Side, SpeedOptions, SpeedRow, in_turn

COLUMNS = 4  # grids that share a product in nnproc.ray_operator
PHOTO_VIEWS, PHOTO_SIZE = 28, 96  # about what a photo set gives the fit


def bandwidth(on: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """Bytes that a sparse product has to move, against the time a plain copy takes for as many.

    Each array counts once. What stays in a cache from call to call need not come from memory, so that a share may pass
    one; `photo` views do not fit in most caches.
    """
    source = torch.zeros(options.copied_mb * 250_000)
    target = torch.empty_like(source)
    sides, words, moved = [Side(lambda: target.copy_(source))], [], []
    for kind, operator in _operators(on, options):
        for name, matrix in (("W x", operator.weight), ("W^T y", operator.weight_t)):
            columns = torch.rand(matrix.shape[1], COLUMNS)
            sides.append(Side(partial(_product, matrix, columns)))
            arrays = (matrix.values(), matrix.col_indices(), matrix.crow_indices(), columns)
            moved.append(sum(a.nbytes for a in arrays) + 4 * COLUMNS * matrix.shape[0])
            words.append(f"{LIMIT}memory: sparse product {name} of {COLUMNS} columns, {kind}, {moved[-1] / 1e6:.0f} MB")
    copy, *seconds = in_turn(sides, options.repeats, options.least)
    speed = 2 * source.nbytes / copy  # bytes/s: each is read and written
    against = f"as many bytes copied at {speed / 1e9:.1f} GB/s"
    return [SpeedRow(w, against, s, m / speed) for w, s, m in zip(words, seconds, moved, strict=True)]


def _operators(on: Subject, options: SpeedOptions) -> list[tuple[str, RayOperator]]:
    photo = min(PHOTO_SIZE, options.size)
    return [
        (f"4 views of {options.size}^2", on.operator()),
        (f"{PHOTO_VIEWS} photo views of {photo}^2", orbit(PHOTO_VIEWS, photo)),
    ]


def operations(decoder: nn.Module, *inputs: Tensor) -> int:
    """Floating-point operations of the matrix products and convolutions in one forward pass, two a product."""
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        decoder(*inputs)
    return counter.get_total_flops()


def arithmetic(on: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """The decoder's operations, against the time a large matrix product takes for as many."""
    network, side = on.bench.network, options.matrix
    z = torch.randn(options.latents, network.config.latent)
    needed = operations(network.shape_decoder, z)

    def decode() -> None:
        with torch.inference_mode(), torch.autocast(z.device.type, torch.bfloat16):
            network.decode_grid(z)

    square = torch.randn(side, side)
    kinds = {"bfloat16": square.bfloat16(), "float32": square}
    sides = [Side(decode), *(Side(partial(torch.matmul, m, m)) for m in kinds.values())]
    seconds, *products = in_turn(sides, options.repeats, options.least)
    what = f"{LIMIT}arithmetic: decoder of {options.latents} latents in bfloat16, {needed / 1e9:.2f} GFLOP"
    rows = []
    for kind, taken in zip(kinds, products, strict=True):
        speed = 2 * side**3 / taken
        against = f"a {kind} matrix product at {speed / 1e9:.0f} GFLOP/s"
        rows.append(SpeedRow(what, against, seconds, needed / speed))
    return rows


def stages(_: Subject, options: SpeedOptions) -> list[SpeedRow]:
    """The whole command on the shipped photos, once, from nothing: each stage against the total."""
    with tempfile.TemporaryDirectory() as folder:
        seconds = reconstruct(SHIPPED / "photos", Path(folder) / "chair")["seconds"]
    return stage_rows(seconds)


def stage_rows(seconds: dict[str, float]) -> list[SpeedRow]:
    """Rows of a report's seconds; a stage too short for its two decimals counts as their last digit."""
    against = f"the whole command, {seconds['total']:.0f} s"
    return [SpeedRow(f"{STAGE}{name}", against, max(s, 0.01), seconds["total"]) for name, s in seconds.items()]


PARTS = (bandwidth, arithmetic)
