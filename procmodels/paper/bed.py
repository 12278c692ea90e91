"""Beds: a mattress on a platform with three kinds of legs, boards at both ends and pillows.

Lengths are fractions of a unit of which a bed is one and a quarter long (about 1.6 m on a real bed).
"""

from __future__ import annotations

from procmodels.parts.cushions import pillow
from procmodels.parts.primitives import box
from procmodels.shape import Part
from procmodels.space import Choice, Integer, Params, ParamSpace, Ratio, Scalar
from procmodels.units import MODEL, Unit

LENGTH = 1.25  # from the outside of the headboard to the outside of the footboard
_TEXT = f"of the bed's length / {LENGTH:g}"
_UNIT, _ABOVE = Unit(_TEXT, MODEL), Unit(f"{_TEXT}, above the platform", MODEL)

SPACE = ParamSpace(
    "bed",
    (
        Ratio("width", 0.6, 1.6, 5, _UNIT),
        Scalar("leg_height", 0.1, 0.3, 3, _UNIT),
        Scalar("headboard_height", 0, 0.55, 5, _ABOVE),
        Scalar("footboard_height", 0, 0.55, 5, _ABOVE),
        Scalar("mattress_height", 0.1, 0.25, 3, _UNIT),
        Choice("legs", ("basic", "split", "box")),
        Integer("pillows", 0, 2),
    ),
)

# Of real ones: IKEA-Manuals-at-Work, and Sweet Home 3D's Scopia and BlendSwap-CC-0 catalogues.
USUAL_DEPTH = (0.39, 0.25)

POST = 0.05  # posts, boards and the platform
INSET = 0.02  # of the mattress, from the platform's sides
BEVEL = 0.03  # of the mattress's edges
PILLOW = (0.5, 0.32, 0.12)  # width, depth and thickness, where there is room
SHARE = 0.8  # of its part of the bed's width that a pillow may take
GAP = 0.03  # between the pillows and the mattress's end
LEAST = 1e-5  # a lower board is left out
CLEARLY = 0.03  # by which a footboard is higher than the headboard when the bed is rather turned round


def build(params: Params) -> list[Part]:
    """The parts of a bed of length LENGTH, standing on z = 0, its foot towards -Y."""
    w, z = float(params["width"]), float(params["leg_height"])
    top = z + POST
    soft = top + float(params["mattress_height"])
    # The boards have their own places beyond the mattress's ends: even the lowest one shows.
    end = LENGTH / 2 - POST
    return [
        box("platform", (-w / 2, -LENGTH / 2, z), (w / 2, LENGTH / 2, top)),
        *_LEGS[str(params["legs"])](w, z),
        *_board("headboard", w, end, top, float(params["headboard_height"])),
        *_board("footboard", w, -end - POST, top, float(params["footboard_height"])),
        box("mattress", (INSET - w / 2, -end, top), (w / 2 - INSET, end, soft), bevel=BEVEL),
        *_pillows(int(params["pillows"]), w, end - GAP, soft),
    ]


def turned_round(params: Params) -> Params | None:
    """The values of the bed facing the other way when its footboard is the higher one: hardly any bed is built so."""
    head, foot = float(params["headboard_height"]), float(params["footboard_height"])
    return {**params, "headboard_height": foot, "footboard_height": head} if foot > head + CLEARLY else None


def _board(name: str, w: float, y: float, z: float, height: float) -> list[Part]:
    """A board on the platform, from y to y + POST."""
    return [box(name, (-w / 2, y, z), (w / 2, y + POST, z + height))] if height > LEAST else []


def _pillows(count: int, w: float, end: float, z: float) -> list[Part]:
    """Pillows side by side on the mattress's top z, reaching y = end, each in the middle of its part of the width."""
    width, depth, thickness = PILLOW
    width = min(width, SHARE * w / max(count, 1))
    middles = [((i + 0.5) / count - 0.5) * w for i in range(count)]
    return [pillow(f"pillow {i + 1}", (x, end - depth / 2, z), width, depth, thickness) for i, x in enumerate(middles)]


# Legs: from the floor to the platform's underside z.


def _basic_legs(w: float, z: float) -> list[Part]:
    parts = []
    for end, y in (("foot", -LENGTH / 2), ("head", LENGTH / 2 - POST)):
        for side, x in (("left", -w / 2), ("right", w / 2 - POST)):
            parts.append(box(f"leg {end} {side}", (x, y, 0), (x + POST, y + POST, z)))
    return parts


def _split_legs(w: float, z: float) -> list[Part]:
    ends = (("foot", -LENGTH / 2), ("head", LENGTH / 2 - POST))
    return [box(f"leg board {end}", (-w / 2, y, 0), (w / 2, y + POST, z)) for end, y in ends]


def _box_legs(w: float, z: float) -> list[Part]:
    # The boards along the sides fit between those at the ends.
    y = LENGTH / 2 - POST
    sides = (("left", -w / 2), ("right", w / 2 - POST))
    return _split_legs(w, z) + [box(f"leg board {side}", (x, -y, 0), (x + POST, y, z)) for side, x in sides]


_LEGS = {"basic": _basic_legs, "split": _split_legs, "box": _box_legs}
