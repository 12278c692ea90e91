"""Shelves: boards between two sides, crossed by dividers, open or filled. Lengths are fractions of the height.

`columns` counts the dividers, so one divider makes two bays: there is always one whose filling shows. Open and filled
must also differ in a grid of 64 voxels where a long shelf is barely two voxels deep. Hence open sides stand in from the
boards' ends, and open dividers are slim posts along the front that go on to the floor, as filled ones do not.
"""

from __future__ import annotations

from procmodels.parts.primitives import box
from procmodels.shape import Part
from procmodels.space import Flag, Integer, Params, ParamSpace, Ratio, Scalar
from procmodels.units import WIDE

SPACE = ParamSpace(
    "shelf",
    (
        Ratio("width", 0.2, 5, 8, WIDE),
        Scalar("depth", 0.1, 0.3, 3),
        Scalar("leg_height", 0, 0.2, 3),
        Integer("rows", 1, 5),
        Integer("columns", 1, 5),
        Flag("filled_back"),
        Flag("filled_sides"),
        Flag("filled_columns"),
    ),
)

# Of real ones: IKEA-Manuals-at-Work, and Sweet Home 3D's Scopia and BlendSwap-CC-0 catalogues.
USUAL_DEPTH = (-0.9, 0.5)

BOARD = 0.01  # thickness of boards and panels, and of the slim posts of open dividers
POST = 0.015  # corner posts of open sides
OVERHANG = 0.03  # how far boards reach beyond the corner posts, of the width: two voxels of the longest shelf
RECESS = 0.02  # of filled dividers behind the boards' front edges: rows show even where dividers stand close
SHORTEST = 1e-3  # legs shorter than this are left out

Span = tuple[float, float]


def build(params: Params) -> list[Part]:
    """The parts of a shelf of height 1, standing on z = 0, open to -Y."""
    w, d, z = float(params["width"]), float(params["depth"]), float(params["leg_height"])
    rows, columns = int(params["rows"]), int(params["columns"])
    z = z if z >= SHORTEST else 0.0
    levels = [z + i * (1 - BOARD - z) / rows for i in range(rows + 1)]  # undersides of the boards
    gaps = [(low + BOARD, high) for low, high in zip(levels, levels[1:], strict=False)]
    to_floor = ([(0.0, z)] if z else []) + gaps  # where a post shows that goes through all boards
    y = (-d / 2, d / 2 - BOARD if params["filled_back"] else d / 2)
    half = w / 2 - BOARD if params["filled_sides"] else w / 2  # of the boards' length

    parts = [box(f"board {i + 1}", (-half, y[0], low), (half, y[1], low + BOARD)) for i, low in enumerate(levels)]
    if params["filled_back"]:
        parts.append(box("back panel", (-half, y[1], z), (half, d / 2, 1)))
    if params["filled_sides"]:
        parts.append(box("side left", (half, -d / 2, 0), (w / 2, d / 2, 1)))
        parts.append(box("side right", (-w / 2, -d / 2, 0), (-half, d / 2, 1)))
    else:
        parts += _corner_posts(w, y, to_floor)
    for i in range(columns):
        centre = w * ((i + 1) / (columns + 1) - 0.5)
        x = (centre - BOARD / 2, centre + BOARD / 2)
        if params["filled_columns"]:
            parts += _upright(f"divider {i + 1}", x, (y[0] + RECESS, y[1]), gaps)
        else:
            parts += _upright(f"divider {i + 1}", x, (y[0], y[0] + BOARD), to_floor)
    return parts


def _upright(name: str, x: Span, y: Span, heights: list[Span]) -> list[Part]:
    """The pieces of an upright that boards interrupt, from the lowest to the highest."""
    return [box(f"{name} {i + 1}", (x[0], y[0], a), (x[1], y[1], b)) for i, (a, b) in enumerate(heights)]


def _corner_posts(w: float, y: Span, heights: list[Span]) -> list[Part]:
    outer = w * (0.5 - OVERHANG)
    parts = []
    for end, span in (("front", (y[0], y[0] + POST)), ("back", (y[1] - POST, y[1]))):
        parts += _upright(f"post {end} left", (outer - POST, outer), span, heights)
        parts += _upright(f"post {end} right", (-outer, POST - outer), span, heights)
    return parts
