"""The NNProc network (paper, section 3.2): encoders and decoders of parameters and shapes that share one latent space.

SE, SD  shape encoder and decoder, 64^3 surface grids    PE, PD  parameter encoder and decoder, vectors of a Codec

Four layer lists:
  "patch"    a grid is handled as 16^3 cells of 4^3 voxels, so that no convolution runs above 16^3 (a quarter of the
             cost of transposed convolutions on a CPU, with several times the capacity)
  "product"  the same encoder; the decoder is a sum of products of 1-D profiles, which boxes are (docs/decoders.md)
  "paper"    strided convolutions 8-16-24-32-40, mirrored by transposed ones
  "wide"     the patch network with a wider encoder, for classes of many parameters (NetworkConfig.hidden: 512)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from nnproc.codec import Codec
from procmodels.space import ParamSpace

RESOLUTION, CELL = 64, 4
GRID = RESOLUTION // CELL


@dataclass(frozen=True)
class NetworkConfig:
    """What rebuilds a network, beside the parameter space."""

    layers: str = "patch"  # "patch", "product", "paper" or "wide"
    latent: int = 128
    hidden: int = 256  # width of the parameter MLPs
    octaves: int = 0  # of sines and cosines of the scalars that PE sees beside their values


def cells_from_grid(grid: Tensor) -> Tensor:
    """(B, 64, 64, 64) to (B, 64, 16, 16, 16): channel = voxel within a cell (space to depth)."""
    x = grid.reshape(-1, GRID, CELL, GRID, CELL, GRID, CELL)
    return x.permute(0, 2, 4, 6, 1, 3, 5).reshape(-1, CELL**3, GRID, GRID, GRID)


def grid_from_cells(cells: Tensor) -> Tensor:
    """The inverse of cells_from_grid (depth to space)."""
    x = cells.reshape(-1, CELL, CELL, CELL, GRID, GRID, GRID)
    return x.permute(0, 4, 1, 5, 2, 6, 3).reshape(-1, RESOLUTION, RESOLUTION, RESOLUTION)


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


class PatchEncoder(nn.Module):
    """Cells (B, 64, 16, 16, 16) to (B, out), five convolutions."""

    def __init__(self, out: int) -> None:
        super().__init__()
        self.convs = nn.Sequential(
            *(nn.Conv3d(64, 32, 1), nn.ReLU()),
            *(nn.Conv3d(32, 48, 3, stride=2, padding=1), nn.ReLU()),  # 8^3
            *(nn.Conv3d(48, 48, 3, padding=1), nn.ReLU()),
            *(nn.Conv3d(48, 96, 3, stride=2, padding=1), nn.ReLU()),  # 4^3
            *(nn.Conv3d(96, 32, 3, padding=1), nn.ReLU()),
        )
        self.head = nn.Sequential(nn.Flatten(), nn.Linear(32 * 4**3, 256), nn.ReLU(), nn.Linear(256, out))

    def forward(self, cells: Tensor) -> Tensor:
        return self.head(self.convs(cells))


class WideEncoder(nn.Module):
    """Cells (B, 64, 16, 16, 16) to (B, out): as PatchEncoder, with twice the channels and blocks that add to them."""

    def __init__(self, out: int) -> None:
        super().__init__()
        self.convs = nn.Sequential(
            *(nn.Conv3d(64, 64, 1), nn.ReLU()),
            *(nn.Conv3d(64, 96, 3, stride=2, padding=1), nn.ReLU()),  # 8^3
            *(_Block(96), nn.ReLU()),
            *(nn.Conv3d(96, 192, 3, stride=2, padding=1), nn.ReLU()),  # 4^3
            *(_Block(192), nn.ReLU()),
            *(nn.Conv3d(192, 48, 1), nn.ReLU()),
        )
        self.head = nn.Sequential(nn.Flatten(), nn.Linear(48 * 4**3, 384), nn.ReLU(), nn.Linear(384, out))

    def forward(self, cells: Tensor) -> Tensor:
        return self.head(self.convs(cells))


class _Block(nn.Module):
    """A convolution whose result is added to what it saw."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv = nn.Conv3d(channels, channels, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.conv(x)


class PatchDecoder(nn.Module):
    """Latent (B, latent) to cells; between scales a 1^3 convolution and a shuffle of channels into space."""

    def __init__(self, latent: int) -> None:
        super().__init__()
        self.start = nn.Sequential(nn.Linear(latent, 256), nn.ReLU(), nn.Linear(256, 32 * 4**3), nn.ReLU())
        self.at4 = nn.Sequential(nn.Conv3d(32, 96, 3, padding=1), nn.ReLU())
        self.to8 = nn.Sequential(nn.Conv3d(96, 64 * 8, 1), nn.ReLU())
        self.at8 = nn.Sequential(nn.Conv3d(64, 64, 3, padding=1), nn.ReLU())
        self.to16 = nn.Sequential(nn.Conv3d(64, 32 * 8, 1), nn.ReLU())
        self.at16 = nn.Sequential(
            *(nn.Conv3d(32, 48, 3, padding=1), nn.ReLU()),
            nn.Conv3d(48, CELL**3, 1),
        )

    def forward(self, z: Tensor) -> Tensor:
        x = self.start(z).reshape(-1, 32, 4, 4, 4).contiguous(memory_format=torch.channels_last_3d)
        x = _shuffle(self.to8(self.at4(x)))
        x = _shuffle(self.to16(self.at8(x)))
        return self.at16(x)


class ProductDecoder(nn.Module):
    """Latent (B, latent) to logits: the sum over TERMS of tanh X(x) tanh Y(y) Z(z), each profile 64 numbers.

    An axis-aligned box is one such product of three intervals, and what a parameter moves is the end of an interval.
    The narrow layer before the profiles keeps the file small: they are 12,288 numbers.
    """

    TERMS, WIDE, NARROW = 64, 384, 128
    EMPTY = -4.0  # logit to start from, since few voxels are occupied

    def __init__(self, latent: int) -> None:
        super().__init__()
        self.trunk = nn.Sequential(
            *(nn.Linear(latent, self.WIDE), nn.ReLU()),
            *(nn.Linear(self.WIDE, self.WIDE), nn.ReLU()),
            *(nn.Linear(self.WIDE, self.NARROW), nn.ReLU()),
            nn.LayerNorm(self.NARROW, elementwise_affine=False),  # keeps tanh from going flat
        )
        self.profiles = nn.Linear(self.NARROW, 3 * self.TERMS * RESOLUTION)
        with torch.no_grad():
            start = self.profiles.bias.view(3, self.TERMS, RESOLUTION)
            start.normal_(std=0.3)  # products of zeros have no gradient
            start[:2, 0], start[2, 0] = 2.0, self.EMPTY  # the first term stands for the whole cube

    def grid(self, z: Tensor) -> Tensor:
        """(B, 64, 64, 64) logits."""
        profiles = self.profiles(self.trunk(z)).reshape(-1, 3, self.TERMS, RESOLUTION)
        x, y = (torch.tanh(profiles[:, i]).transpose(1, 2).contiguous() for i in (0, 1))  # twice as fast as views
        planes = (x[:, :, None] * y[:, None]).flatten(1, 2)  # (B, 64^2, terms)
        return (planes @ profiles[:, 2].contiguous()).reshape(-1, RESOLUTION, RESOLUTION, RESOLUTION)

    def forward(self, z: Tensor) -> Tensor:
        return cells_from_grid(self.grid(z))


def _shuffle(x: Tensor) -> Tensor:
    """(B, 8 C, n, n, n) to (B, C, 2n, 2n, 2n), memory kept channels last."""
    b, c, n = x.shape[0], x.shape[1] // 8, x.shape[2]
    y = x.permute(0, 2, 3, 4, 1).reshape(b, n, n, n, 2, 2, 2, c)
    return y.permute(0, 1, 4, 2, 5, 3, 6, 7).reshape(b, 2 * n, 2 * n, 2 * n, c).permute(0, 4, 1, 2, 3)


_CHANNELS = (8, 16, 24, 32, 40)


class PaperEncoder(nn.Module):
    """The paper's list: five strided convolutions, then two fully connected layers."""

    def __init__(self, out: int) -> None:
        super().__init__()
        widths = (1, *_CHANNELS)
        layers: list[nn.Module] = []
        for a, b in zip(widths[:-1], widths[1:], strict=True):
            layers += [nn.Conv3d(a, b, 4, stride=2, padding=1), nn.ReLU()]
        self.convs = nn.Sequential(*layers)
        self.head = nn.Sequential(nn.Flatten(), nn.Linear(_CHANNELS[-1] * 2**3, 256), nn.ReLU(), nn.Linear(256, out))

    def forward(self, cells: Tensor) -> Tensor:
        return self.head(self.convs(grid_from_cells(cells)[:, None]))


class PaperDecoder(nn.Module):
    """The mirror image of PaperEncoder."""

    def __init__(self, latent: int) -> None:
        super().__init__()
        self.start = nn.Sequential(nn.Linear(latent, 256), nn.ReLU(), nn.Linear(256, _CHANNELS[-1] * 2**3), nn.ReLU())
        widths = (*_CHANNELS[::-1], 1)
        layers: list[nn.Module] = []
        for a, b in zip(widths[:-1], widths[1:], strict=True):
            layers += [nn.ConvTranspose3d(a, b, 4, stride=2, padding=1), nn.ReLU()]
        self.convs = nn.Sequential(*layers[:-1])

    def forward(self, z: Tensor) -> Tensor:
        x = self.start(z).reshape(-1, _CHANNELS[-1], 2, 2, 2)
        return cells_from_grid(self.convs(x)[:, 0])


HALVES = {"forward": ("param_encoder", "shape_decoder"), "inverse": ("shape_encoder", "param_decoder")}
SHAPE_NETS = {
    "patch": (PatchEncoder, PatchDecoder),
    "product": (PatchEncoder, ProductDecoder),
    "paper": (PaperEncoder, PaperDecoder),
    "wide": (WideEncoder, PatchDecoder),
}


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
