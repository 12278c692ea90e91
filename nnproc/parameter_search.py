"""Find parameters by searching the network's shapes: ranked bank, discrete neighbours, Gauss-Newton on the scalars.

A free latent (nnproc.latent_fit) can leave the shapes that the procedural model makes. Here every candidate is
SD(PE(p)), so it cannot; measured on Task 4 this is better and faster (docs/results.md, Table 1).

The network draws surface grids, which are half a voxel thicker than the mesh all round, more than the difference
between two legs. A bank of training shapes knows what the exact meshes look like to the same cameras. Each candidate
inherits from the bank shape it started at the *bias* there, drawn by the network minus exact, and a candidate is
compared as SD(PE(p)) - bias: right at the start itself, and right to first order around it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from nnproc.network import NNProc
from nnproc.on_device import logits_of_vectors
from nnproc.ray_operator import RayOperator
from procmodels.space import Params

Draw = Callable[[Tensor], Tensor]  # grid logits (B, 64, 64, 64) -> what is compared with the target, (B, n) in [0, 1]

_ONES = np.array([bin(i).count("1") for i in range(1 << 16)], np.uint8)


@dataclass(frozen=True)
class SearchOptions:
    """How wide and how long to search."""

    starts: int = 8  # shapes taken from the bank
    keep: tuple[int, ...] = (6, 3)  # candidates that go on after each round of neighbours; one number a round
    newton_steps: int = 3  # a round
    differences: float = 0.04  # of a scalar's range, for derivatives: about a voxel
    reach: float = 0.2  # of a scalar's range: the longest step


@dataclass(frozen=True)
class Bank:
    """Known shapes: vectors (N, width) and what the exact mesh shows, (N, bytes) packed bits of n values each."""

    vectors: Tensor
    seen: np.ndarray
    n: int

    def nearest(self, target: Tensor, count: int) -> Tensor:
        """Indices of the shapes that differ least from target (n,), nearest first."""
        bits = _packed(target[None].numpy() > 0.5)
        differing = _ONES[self.seen.view(np.uint16) ^ bits.view(np.uint16)].sum(1, dtype=np.int32)
        return torch.from_numpy(np.argsort(differing, kind="stable")[:count])

    def exact(self, index: Tensor) -> Tensor:
        """(len(index), n) float, 0 or 1."""
        return torch.from_numpy(np.unpackbits(self.seen[index.numpy()], axis=1, count=self.n)).float()


def bank(vectors: Tensor, seen: Sequence[np.ndarray]) -> Bank:
    """A bank of shapes from their vectors and what each shows, (n,) bool."""
    return Bank(vectors, np.concatenate([_packed(s[None]) for s in seen]), len(seen[0]))


def _packed(values: np.ndarray) -> np.ndarray:
    """(B, n) bool as bits, padded to whole pairs of bytes."""
    bits = np.packbits(values, axis=1)
    return np.pad(bits, ((0, 0), (0, bits.shape[1] % 2)))


@dataclass(frozen=True)
class Found:
    """One answer: parameters, their vector (width,), and the mean squared difference left (lower is better)."""

    params: Params
    vector: Tensor
    loss: float


def draw_silhouettes(operator: RayOperator) -> Draw:
    """Candidates as silhouettes at the operator's rays."""
    return operator.render


def draw_grid(logits: Tensor) -> Tensor:
    """Candidates as occupancies of the whole grid."""
    return torch.sigmoid(logits).flatten(1)


@torch.no_grad()
def search(
    network: NNProc,
    draw: Draw,
    target: Tensor,
    known: Bank,
    options: SearchOptions = SearchOptions(),
    corrected: bool = True,
) -> list[Found]:
    """The best parameter sets found for target (n,), best first.

    `corrected` takes the network's bias at the bank shape off each candidate; grids need none.
    """
    index = known.nearest(target, options.starts)
    vectors = known.vectors[index]
    bias = torch.zeros(len(index), len(target))
    if corrected:
        bias = _drawn(network, draw, vectors) - known.exact(index)
    for keep in options.keep:
        vectors, bias = _with_neighbours(network, draw, target, vectors, bias, keep)
        for _ in range(options.newton_steps):
            vectors = _newton_step(network, draw, target + bias, vectors, options)
    losses = (_drawn(network, draw, vectors) - bias - target).square().mean(1)
    order = losses.argsort()
    params = network.codec.params(vectors[order])
    return [Found(p, v, float(x)) for p, v, x in zip(params, vectors[order], losses[order], strict=True)]


def _drawn(network: NNProc, draw: Draw, vectors: Tensor, batch: int = 16) -> Tensor:
    return torch.cat([draw(logits_of_vectors(network, some)) for some in vectors.split(batch)])


def _with_neighbours(
    network: NNProc, draw: Draw, target: Tensor, vectors: Tensor, bias: Tensor, keep: int
) -> tuple[Tensor, Tensor]:
    """The best of all candidates and what one discrete change makes of them; one for each discrete combination."""
    families = [_neighbours(network, v) for v in vectors]
    all_vectors = torch.cat(families)
    losses = [
        (_drawn(network, draw, family) - b - target).square().mean(1) for family, b in zip(families, bias, strict=True)
    ]
    origin = torch.repeat_interleave(torch.arange(len(vectors)), torch.tensor([len(f) for f in families]))
    discrete = [i for i in range(network.codec.width) if i not in network.codec.scalars]
    chosen: dict[tuple[float, ...], int] = {}
    for i in torch.cat(losses).argsort().tolist():
        chosen.setdefault(tuple(all_vectors[i, discrete].tolist()), i)
        if len(chosen) == keep:
            break
    index = torch.tensor(list(chosen.values()))
    return all_vectors[index], bias[origin[index]]


def _neighbours(network: NNProc, vector: Tensor) -> Tensor:
    """(m, width): the vector itself and every change of one integer, choice or flag."""
    out = [vector]
    for block in network.codec.blocks:
        for value in range(block.stop - block.start):
            if not vector[block.start + value]:
                other = vector.clone()
                other[block] = 0
                other[block.start + value] = 1
                out.append(other)
    for flag in network.codec.flags:
        other = vector.clone()
        other[flag] = 1 - vector[flag]
        out.append(other)
    return torch.stack(out)


def _newton_step(network: NNProc, draw: Draw, target: Tensor, vectors: Tensor, options: SearchOptions) -> Tensor:
    """One damped Gauss-Newton step of all scalars of every candidate against its own target (B, n).

    Derivatives are finite differences about a voxel wide: a network of voxels is a staircase seen more closely.
    """
    scalars = network.codec.scalars
    count, k = len(vectors), len(scalars)
    if not k:
        return vectors
    # Differences point inwards where the range ends.
    signs = torch.where(vectors[:, scalars] > 0.5, -1.0, 1.0) * options.differences
    moved = vectors[:, None].repeat(1, k, 1)
    moved[:, torch.arange(k), scalars] += signs
    drawn = _drawn(network, draw, torch.cat([vectors[:, None], moved], 1).flatten(0, 1)).unflatten(0, (count, k + 1))
    residual = drawn[:, 0] - target
    slopes = (drawn[:, 1:] - drawn[:, :1]) / signs[..., None]
    normal = slopes @ slopes.transpose(1, 2)
    damping = 0.02 * torch.diag_embed(normal.diagonal(dim1=1, dim2=2)) + 1e-4 * torch.eye(k)
    step = torch.linalg.solve(normal + damping, -(slopes @ residual[..., None]))[..., 0]
    step = step.clamp(-options.reach, options.reach)
    trials = torch.stack([vectors] * 3)
    for trial, share in zip(trials[1:], (1.0, 0.4), strict=True):
        trial[:, scalars] = (vectors[:, scalars] + share * step).clamp(0, 1)
    moved_loss = (_drawn(network, draw, trials[1:].flatten(0, 1)).unflatten(0, (2, count)) - target).square().mean(2)
    best = torch.cat([residual.square().mean(1)[None], moved_loss]).argmin(0)
    return trials[best, torch.arange(count)]
