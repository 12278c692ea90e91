"""The NNProc network (paper, section 3.2): encoders and decoders of parameters and shapes that share one latent space.

SE, SD  shape encoder and decoder, 64^3 surface grids    PE, PD  parameter encoder and decoder, vectors of a Codec

Four layer lists:
  "patch"    a grid is handled as 16^3 cells of 4^3 voxels, so that no convolution runs above 16^3 (a quarter of the
             cost of transposed convolutions on a CPU, with several times the capacity)
  "product"  the same encoder; the decoder is a sum of products of 1-D profiles, which boxes are (docs/decoders.md)
  "paper"    strided convolutions 8-16-24-32-40, mirrored by transposed ones
  "planes"   the patch network with an encoder that sees the grid as images of 64 layers from three sides, for classes
             of many parameters (NetworkConfig.hidden: 512)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from nnproc.codec import Codec
from nnproc.shape_nets import SHAPE_NETS, ProductDecoder, cells_from_grid, grid_from_cells
from procmodels.space import ParamSpace

# Which parts lead from parameters to shapes, and which back.
HALVES = {"forward": ("param_encoder", "shape_decoder"), "inverse": ("shape_encoder", "param_decoder")}


@dataclass(frozen=True)
class NetworkConfig:
    """What rebuilds a network, beside the parameter space."""

    layers: str = "patch"  # "patch", "product", "paper" or "planes"
    latent: int = 128
    hidden: int = 256  # width of the parameter MLPs
    octaves: int = 0  # of sines and cosines of the scalars that PE sees beside their values


class NNProc(nn.Module):
    """One class's network. Latents are (B, latent); cells are (B, 64, 16, 16, 16) (see cells_from_grid).

    has_decoder  False where only the inverse half, SE and PD, is trained: the forward half then refuses to answer
    """

    has_decoder: bool = True

    def __init__(self, space: ParamSpace, config: NetworkConfig = NetworkConfig()) -> None:
        super().__init__()
        if config.layers not in SHAPE_NETS:
            raise ValueError(f"layers must be one of {', '.join(SHAPE_NETS)}, got {config.layers!r}")
        self.space, self.config, self.codec = space, config, Codec(space)
        encoder, decoder = SHAPE_NETS[config.layers]
        self.shape_encoder, self.shape_decoder = encoder(2 * config.latent), decoder(config.latent)
        h, latent, width = config.hidden, config.latent, self.codec.width
        self.param_encoder = _mlp(width + 2 * config.octaves * len(self.codec.scalars), h, h, latent)
        self.param_decoder = _mlp(latent, h, h, width)

    def encode_cells(self, cells: Tensor) -> tuple[Tensor, Tensor]:
        """SE: mean and log-variance, each (B, latent)."""
        mean, logvar = self.shape_encoder(cells).float().chunk(2, 1)
        return mean, logvar.clamp(-12, 6)

    def decode_cells(self, z: Tensor) -> Tensor:
        """SD: occupancy logits as cells. Raises RuntimeError where the forward half is not trained."""
        self._need_decoder()
        return self.shape_decoder(z)

    def encode_grid(self, grid: Tensor) -> tuple[Tensor, Tensor]:
        """SE on (B, 64, 64, 64) occupancies."""
        return self.encode_cells(cells_from_grid(grid))

    def decode_grid(self, z: Tensor) -> Tensor:
        """SD: (B, 64, 64, 64) occupancy logits."""
        if isinstance(self.shape_decoder, ProductDecoder):
            self._need_decoder()
            return self.shape_decoder.grid(z)
        return grid_from_cells(self.decode_cells(z))

    def encode_params(self, vectors: Tensor) -> Tensor:
        """PE: (B, width) vectors to (B, latent). Raises RuntimeError where the forward half is not trained."""
        self._need_decoder()
        angles = math.pi * vectors[:, self.codec.scalars]
        waves = [f(2**k * angles) for k in range(1, self.config.octaves + 1) for f in (torch.sin, torch.cos)]
        return self.param_encoder(torch.cat([vectors * 2 - 1, *waves], 1)).float()

    def score_params(self, z: Tensor) -> Tensor:
        """PD without its activation: (B, width) raw scores."""
        return self.param_decoder(z).float()

    def decode_params(self, z: Tensor) -> Tensor:
        """PD: (B, width) values in [0, 1]."""
        return self.codec.activate(self.score_params(z))

    def _need_decoder(self) -> None:
        if not self.has_decoder:
            raise RuntimeError(f"the network of {self.space.name} is trained from shapes to parameters alone")


def _mlp(*widths: int) -> nn.Sequential:
    """Three fully connected layers, ReLU between them."""
    layers: list[nn.Module] = []
    for i, (a, b) in enumerate(zip(widths[:-1], widths[1:], strict=True)):
        layers += [nn.Linear(a, b), nn.ReLU()] if i < len(widths) - 2 else [nn.Linear(a, b)]
    return nn.Sequential(*layers)


def parameter_count(network: nn.Module) -> int:
    """How many trained numbers a network holds."""
    return sum(p.numel() for p in network.parameters())


def occupancy_loss(logits: Tensor, target: Tensor) -> Tensor:
    """(B,) summed cross-entropy of logits against a target of the same shape with entries 0 or 1."""
    return _CrossEntropy.apply(logits, target)


def occupancy_slope(logits: Tensor, target: Tensor) -> Tensor:
    """The gradient of occupancy_loss by the logits: most of what a step needs, at a tenth of the loss's own time."""
    return torch.sigmoid(logits).sub_(target)


class _CrossEntropy(torch.autograd.Function):
    """Binary cross-entropy in the logits' own precision: in bfloat16 a third of the library function's time.

    With s = +1 where the target is 0 and -1 where it is 1, the loss is softplus(s x) and its gradient s sigmoid(s x):
    neither loses digits near certainty, which is why bfloat16 is enough.
    """

    @staticmethod
    def forward(ctx, logits: Tensor, target: Tensor) -> Tensor:
        sign = 1 - 2 * target.to(logits.dtype)
        signed = logits * sign
        ctx.save_for_backward(torch.sigmoid(signed).mul_(sign))
        return F.softplus(signed).flatten(1).sum(1, dtype=torch.promote_types(logits.dtype, torch.float32))

    @staticmethod
    def backward(ctx, grad: Tensor) -> tuple[Tensor, None]:
        (slope,) = ctx.saved_tensors
        return slope * grad.to(slope.dtype).view(-1, *[1] * (slope.dim() - 1)), None
