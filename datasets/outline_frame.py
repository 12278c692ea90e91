"""Outlines as they are compared with each other: of one size, in the middle of a small picture."""

from __future__ import annotations

import cv2
import numpy as np

KINDS = ("bed", "chair", "shelf", "sofa", "table", "other")  # of things, told by their outlines
SIDE, FILLED = 64, 56  # px of the pictures, and of the outline's longer side in them


def framed(mask: np.ndarray) -> np.ndarray:
    """(64, 64) bool: what is white in a mask (H, W), as large as the frame and in its middle; empty masks stay so."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    out = np.zeros((SIDE, SIDE), bool)
    if not len(rows):
        return out
    part = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(np.float32)
    height, width = (max(1, round(FILLED * n / max(part.shape))) for n in part.shape)
    small = cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA) >= 0.5
    top, left = (SIDE - height) // 2, (SIDE - width) // 2
    out[top : top + height, left : left + width] = small
    return out
