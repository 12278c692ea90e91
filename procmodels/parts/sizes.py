"""Lengths that must fit into others, smoothly: a parameter that comes near its limit still does something."""

from __future__ import annotations

import math


def limited(size: float, most: float, largest: float) -> float:
    """The size up to half of `most`, and beyond that less, so that the largest that can be asked for becomes `most`."""
    half = most / 2
    if size <= half or largest <= most:
        return size
    return float(half * (size / half) ** (math.log(2) / math.log(largest / half)))


def inward(room: float, size: float, inset: float) -> float:
    """The middle of a member of a size that reaches to `room` from the middle, or lies nearer by a share."""
    return size / 2 + (room - size) * (1 - inset)
