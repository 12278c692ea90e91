"""Parameter vectors as a network emits them: activations, losses and accuracy by kind of parameter.

A vector (see procmodels.space) has one slot for a scalar or flag and a one-hot block for an integer or choice.
A network emits raw scores of the same width: sigmoid for scalars and flags, softmax within a block (paper,
section 3.2).
"""

from __future__ import annotations

from collections.abc import Sequence

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

    def loss(self, scores: Tensor, target: Tensor) -> Tensor:
        """(B,) L_param of the paper's section 3.4: squared difference for scalars, cross-entropy for the rest."""
        total = scores.new_zeros(len(scores))
        if self.scalars:
            difference = torch.sigmoid(scores[:, self.scalars]) - target[:, self.scalars]
            total = total + difference.square().sum(1)
        if self.flags:
            entropy = F.binary_cross_entropy_with_logits(scores[:, self.flags], target[:, self.flags], reduction="none")
            total = total + entropy.sum(1)
        for block in self.blocks:
            total = total + F.cross_entropy(scores[:, block], target[:, block].argmax(1), reduction="none")
        return total

    def snap(self, values: Tensor) -> Tensor:
        """(B, width) with every block one-hot and every flag 0 or 1, as a decoded parameter set encodes."""
        out = values.clone()
        out[:, self.flags] = (values[:, self.flags] >= 0.5).to(values.dtype)
        for block in self.blocks:
            out[:, block] = F.one_hot(values[:, block].argmax(1), block.stop - block.start).to(values.dtype)
        return out

    def params(self, values: Tensor) -> list[Params]:
        """Parameter sets of (B, width) activated values."""
        return [self.space.decode(v) for v in values.detach().float().cpu().numpy()]

    def vectors(self, params: Sequence[Params]) -> Tensor:
        """(B, width) of parameter sets."""
        return torch.from_numpy(np.stack([self.space.encode(p) for p in params]))

    def scalar_error(self, values: Tensor, target: Tensor) -> Tensor:
        """(B,) mean absolute error of the scalars, as a fraction of their ranges."""
        return (values[:, self.scalars] - target[:, self.scalars]).abs().mean(1)

    def discrete_right(self, values: Tensor, target: Tensor) -> Tensor:
        """(B, number of integers, choices and flags) bool."""
        columns = [(values[:, i] >= 0.5) == (target[:, i] >= 0.5) for i in self.flags]
        columns += [values[:, b].argmax(1) == target[:, b].argmax(1) for b in self.blocks]
        return torch.stack(columns, 1) if columns else values.new_ones(len(values), 0, dtype=torch.bool)
