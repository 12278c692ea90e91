"""A small picture of a result: from its front, and the input beside it, out of the pictures that report.html holds."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import cv2
import numpy as np

SIDE = 240  # px, height and width of each of the two pictures
QUALITY = 85
PAPER = (246, 249, 250)  # BGR
_PICTURE = re.compile(r'<img src="data:image/jpeg;base64,([A-Za-z0-9+/=]+)"')


def thumbnail(report: Path) -> bytes:
    """A JPEG of SIDE x 2 SIDE pixels of a results folder's report.html: the result, and the first view of the input.

    Raises ValueError when the file holds no pictures.
    """
    head, _, views = report.read_text(encoding="utf-8").partition("<div class=views>")
    found = [_PICTURE.search(part) for part in (head, views)]
    pictures = [_fitted(cv2.imdecode(np.frombuffer(base64.b64decode(m[1]), np.uint8), 1)) for m in found if m]
    if not pictures:
        raise ValueError(f"{report} holds no picture")
    ok, data = cv2.imencode(".jpg", np.concatenate(pictures, 1), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not ok:
        raise ValueError(f"the pictures of {report} cannot be stored")
    return data.tobytes()


def _fitted(image: np.ndarray) -> np.ndarray:
    """(SIDE, SIDE, 3) with the whole picture in its middle."""
    height, width = image.shape[:2]
    scale = SIDE / max(height, width)
    w, h = (max(1, round(v * scale)) for v in (width, height))
    out = np.full((SIDE, SIDE, 3), PAPER, np.uint8)
    x, y = (SIDE - w) // 2, (SIDE - h) // 2
    out[y : y + h, x : x + w] = cv2.resize(image, (w, h), interpolation=cv2.INTER_AREA)
    return out
