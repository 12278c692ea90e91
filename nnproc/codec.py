"""Parameter vectors as a network emits them: activations, losses and accuracy by kind of parameter.

A vector (see procmodels.space) has one slot for a scalar or flag and a one-hot block for an integer or choice.
A network emits raw scores of the same width: sigmoid for scalars and flags, softmax within a block (paper,
section 3.2). Parameters that do nothing beside the others are held at their usual values, and count neither in the loss
nor in the accuracy.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterator, Sequence

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from procmodels.space import Flag, Params, ParamSpace, Scalar


class Codec:
    """The layout of one space's parameter vector."""

    def __init__(self, space: ParamSpace) -> None:
        self.space = space
        self.width = space.width
        kinds = {p.name: p for p in space.parameters}
        self.scalars = [s.start for n, s in space.slices.items() if isinstance(kinds[n], Scalar)]
        self.flags = [s.start for n, s in space.slices.items() if isinstance(kinds[n], Flag)]
        self.blocks = [s for n, s in space.slices.items() if not isinstance(kinds[n], Scalar | Flag)]

    def activate(self, scores: Tensor) -> Tensor:
        """(B, width) raw scores to (B, width) values in [0, 1]; one-hot blocks sum to 1."""
        out = torch.sigmoid(scores).clone()
        for block in self.blocks:
            out[:, block] = F.softmax(scores[:, block], 1)
        return out

    def active(self, vectors: Tensor) -> Tensor:
        """(B, width) bool, slots of the parameters that do something in shapes with these vectors."""
        return self.space.active_in(vectors)

    def loss(self, scores: Tensor, target: Tensor, scalars: float = 1.0) -> Tensor:
        """(B,) L_param of the paper's section 3.4: squared difference for scalars, cross-entropy for the rest.

        Summed over the parameters that are active in the target. `scalars` is the weight of the differences: 1 is the
        paper; with 1 / (2 s^2) the sum is a likelihood, scalars being normal with a standard deviation of s.
        """
        total = scores.new_zeros(len(scores))
        active = self.active(target) if self.space.conditional else None
        if self.scalars:
            difference = torch.sigmoid(scores[:, self.scalars]) - target[:, self.scalars]
            total = total + scalars * _counted(difference.square(), active, self.scalars).sum(1)
        if self.flags:
            entropy = F.binary_cross_entropy_with_logits(scores[:, self.flags], target[:, self.flags], reduction="none")
            total = total + _counted(entropy, active, self.flags).sum(1)
        for block in self.blocks:
            entropy = F.cross_entropy(scores[:, block], target[:, block].argmax(1), reduction="none")
            total = total + _counted(entropy, active, block.start)
        return total

    def snap(self, values: Tensor) -> Tensor:
        """(B, width) with every block one-hot, every flag 0 or 1 and inactive parameters as usual, as a decoded
        parameter set encodes.
        """
        out = values.clone()
        out[:, self.flags] = (values[:, self.flags] >= 0.5).to(values.dtype)
        for block in self.blocks:
            out[:, block] = F.one_hot(values[:, block].argmax(1), block.stop - block.start).to(values.dtype)
        if not self.space.conditional:
            return out
        return torch.where(self.active(out), out, torch.from_numpy(self.space.usual_vector).to(out))

    def params(self, values: Tensor) -> list[Params]:
        """Parameter sets of (B, width) activated values."""
        return [self.space.decode(v) for v in values.detach().float().cpu().numpy()]

    def likely(self, values: Tensor, count: int) -> list[Params]:
        """At most so many parameter sets of (width,) activated values, likeliest first: the scalars as they are, and
        the most probable combinations of integers, choices and flags, each shape once."""
        one = values.detach().float().cpu().numpy()
        found: dict[str, Params] = {}
        for vector in self._combinations(one, 8 * count):
            params = self.space.decode(vector)
            found.setdefault(json.dumps(params, sort_keys=True), params)
            if len(found) == count:
                break
        return list(found.values())

    def _combinations(self, values: np.ndarray, most: int) -> Iterator[np.ndarray]:
        """Vectors with other discrete parameters, by probability."""
        kinds: list[int | slice] = [*self.flags, *self.blocks]
        shares = [np.array([1 - values[k], values[k]]) if isinstance(k, int) else values[k] for k in kinds]
        orders = [np.argsort(-s, kind="stable") for s in shares]
        costs = [-np.log(np.maximum(s[o], 1e-9)) for s, o in zip(shares, orders, strict=True)]
        # A combination's children lie one step down in one of its parameters, none before the last that was lowered.
        heap = [(float(sum(c[0] for c in costs)), (0,) * len(kinds), 0)]
        for _ in range(most):
            if not heap:
                return
            cost, ranks, last = heapq.heappop(heap)
            out = values.copy()
            for kind, order, rank in zip(kinds, orders, ranks, strict=True):
                if isinstance(kind, int):
                    out[kind] = order[rank]
                else:
                    out[kind] = np.eye(len(order))[order[rank]]
            yield out
            for i in range(last, len(kinds)):
                if (rank := ranks[i] + 1) < len(orders[i]):
                    lower = (*ranks[:i], rank, *ranks[i + 1 :])
                    heapq.heappush(heap, (cost + float(costs[i][rank] - costs[i][rank - 1]), lower, i))

    def vectors(self, params: Sequence[Params]) -> Tensor:
        """(B, width) of parameter sets."""
        return torch.from_numpy(np.stack([self.space.encode(p) for p in params]))

    def scalar_error(self, values: Tensor, target: Tensor) -> Tensor:
        """(B,) mean absolute error of the active scalars, as a fraction of their ranges."""
        error = (values[:, self.scalars] - target[:, self.scalars]).abs()
        if not self.space.conditional:
            return error.mean(1)
        active = self.active(target)[:, self.scalars]
        return (error * active).sum(1) / active.sum(1).clamp(min=1)

    def discrete_right(self, values: Tensor, target: Tensor) -> Tensor:
        """(B, number of integers, choices and flags) bool; inactive ones are right."""
        columns = [(values[:, i] >= 0.5) == (target[:, i] >= 0.5) for i in self.flags]
        columns += [values[:, b].argmax(1) == target[:, b].argmax(1) for b in self.blocks]
        if not columns:
            return torch.ones(len(values), 0, dtype=torch.bool, device=values.device)
        return torch.stack(columns, 1) | ~self._discrete_active(target)

    def discrete_accuracy(self, values: Tensor, target: Tensor) -> float:
        """Share of the active integers, choices and flags that are right; NaN where there are none."""
        active = self._discrete_active(target)
        return float(self.discrete_right(values, target)[active].float().mean())

    def _discrete_active(self, target: Tensor) -> Tensor:
        """(B, number of integers, choices and flags) bool, in the order of discrete_right."""
        return self.active(target)[:, [*self.flags, *(b.start for b in self.blocks)]]


def _counted(terms: Tensor, active: Tensor | None, slots: list[int] | int) -> Tensor:
    """Terms of a loss where their slots are active."""
    return terms if active is None else terms * active[:, slots]
