"""The network as functions of CPU tensors, and the one place that decides where it computes.

Everything else (rays, masks, cells, the exact model) stays on the CPU: what crosses is a few megabytes a step.
"""

from __future__ import annotations

import torch
from torch import Tensor

from nnproc.network import NNProc


def device() -> torch.device:
    """CUDA when it is there, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def logits_of_latents(network: NNProc, latents: Tensor) -> Tensor:
    """(B, 64, 64, 64) float32 logits of latents (B, L), decoded in half precision. Differentiable."""
    with torch.autocast(device().type, torch.bfloat16):
        return network.decode_grid(latents.to(device())).float().to(latents.device)


def logits_of_vectors(network: NNProc, vectors: Tensor) -> Tensor:
    """(B, 64, 64, 64) float32 logits SD(PE(p)) of parameter vectors (B, width), in half precision. Differentiable."""
    with torch.autocast(device().type, torch.bfloat16):
        return network.decode_grid(network.encode_params(vectors.to(device()))).float().to(vectors.device)


def codes_of_vectors(network: NNProc, vectors: Tensor) -> Tensor:
    """(B, L) codes PE(p) of parameter vectors (B, width). Differentiable."""
    return network.encode_params(vectors.to(device())).to(vectors.device)


def values_of_latents(network: NNProc, latents: Tensor) -> Tensor:
    """(B, width) activated parameter values PD(z) of latents (B, L). Differentiable."""
    return network.decode_params(latents.to(device())).to(latents.device)


def latents_of_grids(network: NNProc, grids: Tensor, half: bool = False) -> Tensor:
    """(B, L) means SE(s) of grids (B, 64, 64, 64), in half precision if asked for."""
    with torch.autocast(device().type, torch.bfloat16, enabled=half):
        mean, _ = network.encode_grid(grids.to(device(), torch.float32))
    return mean.to(grids.device)
