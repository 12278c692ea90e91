"""Tables: a rectangular or round top on six kinds of legs. Lengths are fractions of the height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels.parts.primitives import box, cylinder
from procmodels.shape import Part
from procmodels.space import Choice, Flag, Params, ParamSpace, Ratio, Scalar
from procmodels.units import WIDE, of_parameter

SPACE = ParamSpace(
    "table",
    (
        Ratio("width", 0.6, 4, 8, WIDE),
        Scalar("depth", 0.4, 1.0, 4),
        Scalar("top_thickness", 0.05, 0.25, 3),
        Scalar("leg_thickness", 0.11, 0.15, 3, unit=of_parameter("depth")),
        Flag("round_top"),
        Choice("legs", ("basic", "support", "round", "split", "square", "solid")),
    ),
)

# Of real ones: IKEA-Manuals-at-Work, and Sweet Home 3D's Scopia and BlendSwap-CC-0 catalogues.
USUAL_DEPTH = (-0.55, 0.33)

PLATE = 0.5  # width of a pedestal's plate
PLATE_HEIGHT = 0.02
STRETCHER = 0.2  # height of the stretchers above the floor
OVERHANG = 0.04  # of a rectangular top over its legs
INSCRIBED = 0.7  # a rectangle of this share of a round top's axes lies within it (just under 1 / sqrt 2)


@dataclass(frozen=True)
class _Room:
    """The room under the top: half its width and depth where legs may stand, its height, and a leg's thickness."""

    x: float
    y: float
    z: float
    leg: float
    depth: float  # of the whole top


def build(params: Params) -> list[Part]:
    """The parts of a table of height 1, standing on z = 0; its width runs along X."""
    w, d, thickness = float(params["width"]), float(params["depth"]), float(params["top_thickness"])
    z, leg = 1 - thickness, float(params["leg_thickness"]) * d
    if params["round_top"]:
        top, room = _round_top(w, d, z), _Room(INSCRIBED * w / 2, INSCRIBED * d / 2, z, leg, d)
    else:
        top = box("top", (-w / 2, -d / 2, z), (w / 2, d / 2, 1), bevel=0.01)
        room = _Room(w / 2 - OVERHANG, d / 2 - OVERHANG, z, leg, d)
    return [top, *_LEGS[str(params["legs"])](room)]


def _round_top(w: float, d: float, z: float) -> Part:
    disc = cylinder("top", 0.5, (0, 0, z), (0, 0, 1), segments=48)
    return disc.moved(np.diag([w, d, 1, 1]))


def _ends(room: _Room) -> list[tuple[str, float]]:
    """Left and right, with the x of a member one leg thick that ends flush."""
    x = room.x - room.leg / 2
    return [("left", x), ("right", -x)]


def _post(name: str, x: float, y: float, low: float, high: float, size: float) -> Part:
    h = size / 2
    return box(name, (x - h, y - h, low), (x + h, y + h, high))


def _basic_legs(room: _Room) -> list[Part]:
    y = room.y - room.leg / 2
    sides = [("front", -y), ("back", y)]
    return [_post(f"leg {f} {s}", x, v, 0, room.z, room.leg) for f, v in sides for s, x in _ends(room)]


def _support_legs(room: _Room) -> list[Part]:
    """Four legs, joined by an H of stretchers."""
    h, y = room.leg / 4, room.y - room.leg
    low, high = STRETCHER, STRETCHER + 2 * h
    sides = [box(f"stretcher {s}", (x - h, -y, low), (x + h, y, high)) for s, x in _ends(room)]
    inner = room.x - room.leg / 2 - h
    return [*_basic_legs(room), *sides, box("stretcher middle", (-inner, -h, low), (inner, h, high))]


def _plate_width(room: _Room) -> float:
    """A pedestal's plate stays under the top."""
    return min(PLATE, 0.9 * room.depth)


def _round_pedestal(room: _Room) -> list[Part]:
    return [
        cylinder("plate", _plate_width(room) / 2, (0, 0, 0), (0, 0, PLATE_HEIGHT), segments=32),
        cylinder("column", room.leg / 2, (0, 0, PLATE_HEIGHT), (0, 0, room.z)),
    ]


def _square_pedestal(room: _Room) -> list[Part]:
    h = _plate_width(room) / 2
    return [
        box("plate", (-h, -h, 0), (h, h, PLATE_HEIGHT)),
        _post("column", 0, 0, PLATE_HEIGHT, room.z, room.leg),
    ]


def _split_legs(room: _Room) -> list[Part]:
    """A board at each end."""
    h = room.leg / 2
    return [box(f"panel {s}", (x - h, -room.y, 0), (x + h, room.y, room.z)) for s, x in _ends(room)]


def _solid_legs(room: _Room) -> list[Part]:
    """Boards all round: those of the front and back stand between the ends'."""
    inner, y = room.x - room.leg, room.y
    front = box("panel front", (-inner, -y, 0), (inner, -y + room.leg, room.z))
    back = box("panel back", (-inner, y - room.leg, 0), (inner, y, room.z))
    return [*_split_legs(room), front, back]


_LEGS = {
    "basic": _basic_legs,
    "support": _support_legs,
    "round": _round_pedestal,
    "split": _split_legs,
    "square": _square_pedestal,
    "solid": _solid_legs,
}
