"""How well a network reads parameters from grids of every kind that it may be given, by held-out shapes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from datasets.disturbed import damaged, met, splat
from datasets.synthetic import Pairs
from nnproc.infer import values_from_grids
from nnproc.network import NNProc

# What a grid is made into: a surface grid (64, 64, 64) bool, but for hulls, which are made from shapes.
Disturb = Callable[[np.ndarray, np.random.Generator], np.ndarray]
KINDS: dict[str, Disturb] = {"clean": lambda grid, _: grid, "hull": met, "splat": splat, "damaged": damaged}
HELD_OUT = 22  # of the generators


def accuracy(network: NNProc, clean: Pairs, hulls: Pairs, seed: int = 0) -> dict[str, dict[str, object]]:
    """What the network reads from held-out grids of every kind: % of active choices right, error in % of the range.

    `by_parameter` holds the one or the other for every parameter that is active in any of them.
    """
    out: dict[str, dict[str, object]] = {}
    for code, (kind, disturb) in enumerate(KINDS.items()):
        pairs = hulls if kind == "hull" else clean
        seen = [disturb(g, np.random.default_rng([seed, HELD_OUT, code, i])) for i, g in enumerate(pairs.grids())]
        out[kind] = reading(network, values_from_grids(network, np.stack(seen)), torch.from_numpy(pairs.vectors))
    return out


def reading(network: NNProc, values: Tensor, target: Tensor) -> dict[str, object]:
    """The same of activated values (B, width) beside their true vectors."""
    space, codec = network.space, network.codec
    active = codec.active(target)
    discrete = {p.name for p in space.discrete}
    wrong: dict[str, Tensor] = {}
    for name, slots in space.slices.items():
        mine, true = values[:, slots], target[:, slots]
        if slots.stop - slots.start > 1:
            off = (mine.argmax(1) != true.argmax(1)).float()
        else:
            off = (
                ((mine[:, 0] >= 0.5) != (true[:, 0] >= 0.5)).float() if name in discrete else (mine - true).abs()[:, 0]
            )
        wrong[name] = off[active[:, slots.start]]
    choices = [v for n, v in wrong.items() if n in discrete]
    scalars = [v for n, v in wrong.items() if n not in discrete]
    each = {n: _percent(1 - v.mean() if n in discrete else v.mean()) for n, v in wrong.items() if len(v)}
    return {
        "choices_right_percent": _percent(1 - torch.cat(choices).mean()) if choices else None,
        "scalar_error_percent": _percent(torch.cat(scalars).mean()) if scalars else None,
        "by_parameter": each,
    }


def _percent(share: Tensor) -> float:
    return round(100 * float(share), 2)
