"""The paper's five losses (section 3.4), each summed over elements and averaged over the batch."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from nnproc.network import NNProc, occupancy_loss


@dataclass(frozen=True)
class LossWeights:
    """Weights of the five terms; all 1 is the paper. 0 leaves a term out (ablations: kl, sim).

    The voxel term is a sum over 262,144 elements and drowns the parameter terms; ours are balanced by hand
    """

    shape: float = 1.0
    param: float = 300.0
    kl: float = 1.0
    sim: float = 1.0
    latent: float = 3.0
    # Share of a batch whose shape is decoded from PE(p) rather than from SE's sample: Task 1 is SD(PE(p)),
    # which the paper's sum trains only through the latent term (0 = the paper).
    decode_from_params: float = 0.5
    scalars: float = 1.0  # of the squared differences in `param`, beside its cross-entropies (Codec.loss)


PAPER = LossWeights(param=1.0, latent=1.0, decode_from_params=0.0)

# The paper's ablations (section 4.4) and its network of SE + PD alone. Without KL the latent has no noise.
VARIANTS = {
    "full": LossWeights(),
    "without_kl": LossWeights(kl=0.0),
    "without_sim": LossWeights(sim=0.0),
    "without_both": LossWeights(kl=0.0, sim=0.0),
    "simple": LossWeights(shape=0.0, kl=0.0, sim=0.0, latent=0.0),
}


def kl_divergence(mean: Tensor, logvar: Tensor) -> Tensor:
    """(B,) divergence of N(mean, exp(logvar)) from the standard normal, summed over the latent."""
    return -0.5 * (1 + logvar - mean.square() - logvar.exp()).sum(1)


def similarity_loss(mean: Tensor, vectors: Tensor) -> Tensor:
    """Sum over pairs of (CosSim(mu1, mu2) - CosSim(p1, p2))^2, divided by the batch size."""
    cosine_mean = F.normalize(mean, dim=1) @ F.normalize(mean, dim=1).T
    cosine_params = F.normalize(vectors, dim=1) @ F.normalize(vectors, dim=1).T
    return (cosine_mean - cosine_params).square().sum() / len(mean)


def losses(
    network: NNProc,
    cells: Tensor,
    vectors: Tensor,
    weights: LossWeights,
    generator: torch.Generator | None = None,
) -> dict[str, Tensor]:
    """The weighted total and each unweighted term for a batch of cells (B, 64, 16, 16, 16) and vectors (B, width)."""
    mean, logvar = network.encode_cells(cells)
    z_shape = mean
    if weights.kl:
        noise = torch.randn(mean.shape, generator=generator).to(mean.device)
        z_shape = mean + noise * (0.5 * logvar).exp()
    if not weights.shape:  # SE and PD alone: nothing else has a task
        only = network.codec.loss(network.score_params(z_shape), vectors, weights.scalars).mean()
        return {"total": weights.param * only, "param": only}
    z_params = network.encode_params(vectors)

    from_params = round(len(cells) * weights.decode_from_params)
    z = torch.cat([z_params[:from_params], z_shape[from_params:]])
    # The decoders see the same kind of latent in use: a sample, its mean, and PE's own code.
    param = [network.codec.loss(network.score_params(z), vectors, weights.scalars) for z in (z_params, z_shape)]
    terms = {
        "shape": occupancy_loss(network.decode_cells(z), cells).mean(),
        "param": (param[0] + param[1]).mean() / 2,
        "kl": kl_divergence(mean, logvar).mean(),
        "sim": similarity_loss(mean, vectors),
        "latent": (mean - z_params).square().sum(1).mean(),
    }
    total = sum((getattr(weights, name) * value for name, value in terms.items()), torch.zeros(()))
    return {"total": total, **terms}
