"""The input's points as dots, from the sides that the report shows the result from."""

from __future__ import annotations

import numpy as np

from procmodels.shape import Shape
from recon.outputs.contact_sheet import Tile
from recon.outputs.previews import ShadeOptions, view
from recon.outputs.result import ShapeEvidence

_PAPER, _NEAR, _FAR = np.array((244, 242, 238)), np.array((40, 70, 110)), np.array((170, 190, 215))  # RGB
FINE = 2  # drawn this much larger, then reduced


def tiles(
    met: ShapeEvidence, shape: Shape, count: int, width: int, options: ShadeOptions = ShadeOptions()
) -> list[Tile]:
    """`count` square pictures, `width` pixels wide, framed as the result's are."""
    out = []
    for i in range(count):
        azimuth = np.radians(options.first_azimuth + 360 * i / count)
        picture = dots(met.points, shape.vertices(), float(azimuth), width, options)
        out.append(Tile(f"input, view {i + 1}", picture, None, True))
    return out


def dots(points: np.ndarray, framed: np.ndarray, azimuth: float, width: int, options: ShadeOptions) -> np.ndarray:
    """(width, width, 3) uint8 RGB: points (n, 3) as dots, near ones darker and in front; `framed` fills the picture."""
    side = FINE * width
    eye, axes, focal, middle = view(framed, azimuth, (side, side), options)
    seen = (points - eye) @ axes.T
    place = (seen[:, :2] / seen[:, 2:] - middle) * focal + side / 2
    depth = (seen[:, 2] - seen[:, 2].min()) / max(float(np.ptp(seen[:, 2])), 1e-9)
    order = np.argsort(-depth)
    radius = 2 if len(points) > 5000 else 5
    picture = np.broadcast_to(_PAPER, (side, side, 3)).astype(np.uint8)
    colours = (_NEAR + depth[order, None] * (_FAR - _NEAR)).astype(np.uint8)
    columns, rows = np.floor(place[order]).astype(int).T
    for dx in range(-radius, radius + 1):
        for dy in range(-radius, radius + 1):
            if dx * dx + dy * dy <= radius * radius + 1:
                x, y = columns + dx, rows + dy
                inside = (x >= 0) & (x < side) & (y >= 0) & (y < side)
                picture[y[inside], x[inside]] = colours[inside]
    return picture.reshape(width, FINE, width, FINE, 3).mean((1, 3)).astype(np.uint8)
