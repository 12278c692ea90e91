"""PLY splats packed by chunks of 256 Gaussians, as SuperSplat writes them.

Every chunk keeps the range of its positions and of its scales' logarithms; a Gaussian is four words of 32 bits:
position and scale 11 + 10 + 11 bits in that range, a quaternion without its largest part, and colour with opacity.
"""

from __future__ import annotations

import numpy as np

from recon.files.quaternions import from_smallest_three
from recon.files.shape import Gaussians

PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_CHUNK = 256


def unpacked(vertex: dict[str, np.ndarray], chunk: dict[str, np.ndarray]) -> Gaussians:
    """The Gaussians of a packed file's two tables. Raises IndexError when there are too few chunks."""
    position, turn, scale, colour = (vertex[name].astype(np.uint32) for name in PACKED)
    mine = np.arange(len(position)) // _CHUNK
    low, size = _range(chunk, "", mine)
    low_scale, size_scale = _range(chunk, "scale_", mine)
    parts = np.stack([turn >> 20 & 1023, turn >> 10 & 1023, turn & 1023], 1)
    return Gaussians(
        low + size * _shares(position),
        (colour & 255) / 255,
        np.exp(np.clip(low_scale + size_scale * _shares(scale), -50, 50)),
        from_smallest_three((parts / 1023 - 0.5) * np.sqrt(2), turn >> 30),
    )


def _range(chunk: dict[str, np.ndarray], what: str, mine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    low, high = (np.stack([chunk[f"{end}_{what}{a}"] for a in "xyz"], 1)[mine] for end in ("min", "max"))
    return low, high - low


def _shares(word: np.ndarray) -> np.ndarray:
    """(n, 3) in 0..1."""
    return np.stack([(word >> 21) / 2047, (word >> 11 & 1023) / 1023, (word & 2047) / 2047], 1)
