"""Encoders and decoders of shapes, one pair a layer list (see nnproc.network), and grids as cells."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

RESOLUTION, CELL = 64, 4
GRID = RESOLUTION // CELL


def cells_from_grid(grid: Tensor) -> Tensor:
    """(B, 64, 64, 64) to (B, 64, 16, 16, 16): channel = voxel within a cell (space to depth)."""
    x = grid.reshape(-1, GRID, CELL, GRID, CELL, GRID, CELL)
    return x.permute(0, 2, 4, 6, 1, 3, 5).reshape(-1, CELL**3, GRID, GRID, GRID)


def grid_from_cells(cells: Tensor) -> Tensor:
    """The inverse of cells_from_grid (depth to space)."""
    x = cells.reshape(-1, CELL, CELL, CELL, GRID, GRID, GRID)
    return x.permute(0, 4, 1, 5, 2, 6, 3).reshape(-1, RESOLUTION, RESOLUTION, RESOLUTION)


def channels_last(network: nn.Module) -> None:
    """Lay out the weights of convolutions as their layers read them fastest."""
    formats = {4: torch.channels_last, 5: torch.channels_last_3d}
    for weight in network.parameters():
        if weight.dim() in formats:
            weight.data = weight.data.contiguous(memory_format=formats[weight.dim()])


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


class PlaneEncoder(nn.Module):
    """Cells (B, 64, 16, 16, 16) to (B, out): convolutions over the grid's three planes, each side's 64 layers as
    channels. Edges are seen as finely as voxels are, where three dimensions would have to be coarse to be as cheap."""

    CHANNELS = (16, 32, 64, 128, 64)  # at 64^2, 32^2, ... 4^2

    def __init__(self, out: int) -> None:
        super().__init__()
        self.planes = nn.ModuleList(self._plane() for _ in range(3))
        self.head = nn.Sequential(nn.Linear(3 * self.CHANNELS[-1] * 4**2, 256), nn.ReLU(), nn.Linear(256, out))

    def _plane(self) -> nn.Sequential:
        layers: list[nn.Module] = [nn.Conv2d(RESOLUTION, self.CHANNELS[0], 1), nn.ReLU()]
        for a, b in pairwise(self.CHANNELS):
            layers += [nn.Conv2d(a, b, 3, stride=2, padding=1), nn.ReLU()]
        return nn.Sequential(*layers, nn.Flatten())

    def forward(self, cells: Tensor) -> Tensor:
        grid = grid_from_cells(cells)
        views = (grid, grid.transpose(1, 2), grid.transpose(1, 3))
        seen = [
            plane(view.contiguous(memory_format=torch.channels_last))
            for plane, view in zip(self.planes, views, strict=True)
        ]
        return self.head(torch.cat(seen, 1))


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


SHAPE_NETS = {
    "patch": (PatchEncoder, PatchDecoder),
    "product": (PatchEncoder, ProductDecoder),
    "paper": (PaperEncoder, PaperDecoder),
    "planes": (PlaneEncoder, PatchDecoder),
}
