"""How a shape looks: a base colour a part, and perhaps one picture for all of them."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from procmodels.shape import Part

QUALITY = 92  # of the picture as a JPEG file


@dataclass(frozen=True)
class Look:
    """Colours of a shape's parts, in the order of its parts.

    colours  (P, 3) float, linear RGB 0..1, base colour of every part
    picture  (S, S, 3) uint8 sRGB, row 0 at the top, or None
    uv       P arrays (c, 2) float of every part's corners, face after face: 0..1, u to the right and v up in the
             picture; () without a picture
    """

    colours: np.ndarray
    picture: np.ndarray | None = None
    uv: tuple[np.ndarray, ...] = ()

    def __post_init__(self) -> None:
        if self.colours.ndim != 2 or self.colours.shape[1] != 3:
            raise ValueError(f"colours must be (P, 3), got {self.colours.shape}")
        if len(self.uv) != (0 if self.picture is None else len(self.colours)):
            raise ValueError("a picture needs uv of every part, and no picture needs none")

    def check(self, parts: tuple[Part, ...]) -> None:
        """Raises ValueError when this is the look of another shape."""
        corners = [sum(map(len, p.faces)) for p in parts]
        if len(parts) != len(self.colours) or (self.uv and [len(u) for u in self.uv] != corners):
            raise ValueError("the look is that of another shape")


def encoded(picture: np.ndarray) -> bytes:
    """A picture (H, W, 3) uint8 as a JPEG file."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(picture).save(out, format="JPEG", quality=QUALITY, subsampling=0)
    return out.getvalue()


def srgb(linear: np.ndarray) -> np.ndarray:
    """Linear light 0..1 as sRGB 0..1 (IEC 61966-2-1)."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def linear(srgb: np.ndarray) -> np.ndarray:
    """sRGB 0..1 as linear light 0..1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0) + 0.055) / 1.055) ** 2.4)
