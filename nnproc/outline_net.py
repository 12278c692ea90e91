"""What kind of thing an outline shows: a small network over silhouettes, for any of the classes known by name.

It knows no procedure. An answer that a flexible class bends to a bottle explains its outline, yet no one would take
that outline for a chair's; this network says so (recon.fitting.likeness). It is trained by nnproc.learn_outlines.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from datasets.outline_frame import KINDS, SIDE, framed
from nnproc.infer import WeightsError

FILE = Path(__file__).with_name("outline_net.safetensors")
_instead: ContextVar[Path | None] = ContextVar("instead", default=None)


class OutlineNet(nn.Module):
    """Pictures (B, 1, 64, 64) of 0 and 1 to logits (B, kinds)."""

    CHANNELS = (1, 24, 48, 96, 96)  # at 64^2, 32^2, ... 4^2

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for a, b in pairwise(self.CHANNELS):
            layers += [nn.Conv2d(a, b, 3, stride=2, padding=1, bias=False), nn.BatchNorm2d(b), nn.ReLU()]
        last = self.CHANNELS[-1] * (SIDE // 2 ** (len(self.CHANNELS) - 1)) ** 2
        self.layers = nn.Sequential(
            *layers, nn.Flatten(), nn.Dropout(0.3), nn.Linear(last, 128), nn.ReLU(), nn.Linear(128, len(KINDS))
        )

    def forward(self, pictures: Tensor) -> Tensor:
        return self.layers(pictures)


def log_chances(network: OutlineNet, masks: Sequence[np.ndarray]) -> np.ndarray:
    """(n, kinds) log-probabilities of the kinds, of each of n masks alone."""
    pictures = torch.from_numpy(np.stack([framed(m) for m in masks])[:, None].astype(np.float32))
    with torch.no_grad():
        return torch.log_softmax(network(pictures), 1).numpy()


def save(network: OutlineNet, file: Path) -> None:
    """Write the weights in half precision; whole or not at all."""
    tensors = {k: (v.half() if v.is_floating_point() else v).contiguous() for k, v in network.state_dict().items()}
    partial = file.with_suffix(".partial")
    save_file(tensors, partial)
    partial.replace(file)


def load(file: Path | None = None) -> OutlineNet:
    """The trained network; of None the shipped one, or what `instead` put in its place.

    Raises WeightsError when the file is missing or damaged.
    """
    return _loaded(file or _instead.get() or FILE)


@contextmanager
def instead(file: Path | None) -> Iterator[None]:
    """Within, another network is loaded than the shipped one, as one that did not see what is looked at."""
    before = _instead.set(file)
    try:
        yield
    finally:
        _instead.reset(before)


@lru_cache(maxsize=4)
def _loaded(file: Path) -> OutlineNet:
    network = OutlineNet()
    try:
        network.load_state_dict({k: v.float() if v.is_floating_point() else v for k, v in load_file(file).items()})
    except (OSError, SafetensorError, RuntimeError) as error:
        raise WeightsError(f"{file} does not hold the network of outlines ({error}): install anew") from error
    return network.eval()
