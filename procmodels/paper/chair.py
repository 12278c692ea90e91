"""Chairs: a seat on four kinds of legs, with four kinds of arms and backs. Lengths are fractions of the height."""

from __future__ import annotations

import math

from procmodels.parts.primitives import box, cylinder, rotation
from procmodels.shape import Part
from procmodels.space import Choice, Params, ParamSpace, Scalar

SPACE = ParamSpace(
    "chair",
    (
        Scalar("width", 0.3, 1.0, 6),
        Scalar("depth", 0.4, 0.6, 3),
        Scalar("leg_height", 0.3, 0.5, 5),
        Choice("legs", ("basic", "round", "support", "office")),
        Choice("arms", ("none", "basic", "solid", "office")),
        Choice("back", ("basic", "hbar", "vbar", "office")),
    ),
)

# Of real ones: IKEA-Manuals-at-Work, and Sweet Home 3D's Scopia and BlendSwap-CC-0 catalogues.
USUAL_DEPTH = (0.08, 0.2)

POST = 0.02  # posts, panels and bars
SEAT = 0.1  # thickness of the seat slab
ARM = 0.2  # top of the armrests above the seat
RAIL = 0.06  # height of the back's horizontal bars
TILT = 10.0  # degrees that an office back leans


def build(params: Params) -> list[Part]:
    """The parts of a chair of height 1, standing on z = 0, facing -Y."""
    w, d, z = float(params["width"]), float(params["depth"]), float(params["leg_height"])
    seat = box("seat", (-w / 2, -d / 2, z), (w / 2, d / 2, z + SEAT), bevel=0.01)
    top = z + SEAT
    return [
        seat,
        *_LEGS[str(params["legs"])](w, d, z),
        *_ARMS[str(params["arms"])](w, d, top),
        *_BACKS[str(params["back"])](w, d, top),
    ]


def _sides(w: float, inset: float) -> list[tuple[str, float]]:
    """Left and right (the sitter's), with the x of a member of width 2 * inset that ends flush with the seat."""
    return [("left", w / 2 - inset), ("right", -w / 2 + inset)]


def _post(name: str, x: float, y: float, low: float, high: float, size: float = POST) -> Part:
    h = size / 2
    return box(name, (x - h, y - h, low), (x + h, y + h, high))


# Legs: from the floor to the seat's underside z.


def _basic_legs(w: float, d: float, z: float) -> list[Part]:
    ends = [("front", -d / 2 + POST / 2), ("back", d / 2 - POST / 2)]
    return [_post(f"leg {e} {s}", x, y, 0, z) for e, y in ends for s, x in _sides(w, POST / 2)]


def _support_legs(w: float, d: float, z: float) -> list[Part]:
    h, low = POST / 2, 0.35 * z
    stretchers = [
        box(f"stretcher {s}", (x - h, -d / 2 + POST, low), (x + h, d / 2 - POST, low + 2 * POST))
        for s, x in _sides(w, h)
    ]
    return _basic_legs(w, d, z) + stretchers


def _round_legs(w: float, d: float, z: float) -> list[Part]:
    return [
        cylinder("plate", 0.2, (0, 0, 0), (0, 0, 0.025), segments=32),
        cylinder("column", 0.03, (0, 0, 0.025), (0, 0, z)),
    ]


def _office_legs(w: float, d: float, z: float) -> list[Part]:
    parts = [cylinder("column", 0.025, (0, 0, 0.05), (0, 0, z))]
    for i in range(5):
        # The first arm points backwards, so that the star is symmetric left to right.
        angle = 90 + 72 * i
        turn = rotation("Z", angle)
        parts.append(box(f"star arm {i + 1}", (0, -0.015, 0.05), (0.25, 0.015, 0.08), matrix=turn))
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        x, y = 0.235 * c, 0.235 * s
        side = 0.0125
        parts.append(
            cylinder(
                f"castor {i + 1}",
                0.025,
                (x - side * s, y + side * c, 0.025),
                (x + side * s, y - side * c, 0.025),
                segments=12,
            )
        )
    return parts


# Arms: from the seat's top z upwards.


def _basic_arms(w: float, d: float, z: float) -> list[Part]:
    parts = []
    for side, x in _sides(w, POST / 2):
        for end, y in (("front", -d / 2 + POST / 2), ("back", d / 2 - POST / 2)):
            parts.append(_post(f"arm post {end} {side}", x, y, z, z + ARM - POST))
        h = POST / 2
        parts.append(box(f"armrest {side}", (x - h, -d / 2, z + ARM - POST), (x + h, d / 2, z + ARM)))
    return parts


def _solid_arms(w: float, d: float, z: float) -> list[Part]:
    h = POST / 2
    return [box(f"arm panel {s}", (x - h, -d / 2, z), (x + h, d / 2, z + ARM)) for s, x in _sides(w, h)]


def _office_arms(w: float, d: float, z: float) -> list[Part]:
    parts = []
    for side, x in _sides(w, 0.025):
        parts.append(_post(f"arm post {side}", x, 0, z, z + ARM - POST, 0.03))
        pad = ((x - 0.025, -0.3 * d, z + ARM - POST), (x + 0.025, 0.3 * d, z + ARM))
        parts.append(box(f"armrest {side}", *pad))
    return parts


# Backs: from the seat's top z to 1, at the seat's rear edge.


def _basic_back(w: float, d: float, z: float) -> list[Part]:
    return [box("back panel", (-w / 2, d / 2 - POST, z), (w / 2, d / 2, 1))]


def _back_posts(w: float, d: float, z: float) -> list[Part]:
    return [_post(f"back post {s}", x, d / 2 - POST / 2, z, 1) for s, x in _sides(w, POST / 2)]


def _hbar_back(w: float, d: float, z: float) -> list[Part]:
    parts = _back_posts(w, d, z)
    for i in range(3):
        # The highest bar ends at the top; the lowest leaves a gap above the seat.
        high = 1 - i * (1 - z) / 3
        parts.append(box(f"back bar {i + 1}", (-w / 2 + POST, d / 2 - POST, high - RAIL), (w / 2 - POST, d / 2, high)))
    return parts


def _vbar_back(w: float, d: float, z: float) -> list[Part]:
    parts = _back_posts(w, d, z)
    parts.append(box("back rail", (-w / 2 + POST, d / 2 - POST, 1 - RAIL), (w / 2 - POST, d / 2, 1)))
    for i in range(4):
        x = (w - POST) * ((i + 1) / 5 - 0.5)
        parts.append(_post(f"back bar {i + 1}", x, d / 2 - POST / 2, z, 1 - RAIL))
    return parts


def _office_back(w: float, d: float, z: float) -> list[Part]:
    hinge = (0.0, d / 2 - POST, z)
    lean = rotation("X", -TILT, hinge)
    # Tilting lowers the top edge; the panel is made longer so that it still ends at z = 1.
    length = (1 - z) / math.cos(math.radians(TILT))
    gap = 0.2 * length
    panel = box("back panel", (-w / 2, d / 2 - POST, z + gap), (w / 2, d / 2, z + length), matrix=lean)
    stem = box("back stem", (-0.03, d / 2 - POST, z - SEAT / 2), (0.03, d / 2, z + gap), matrix=lean)
    return [panel, stem]


_LEGS = {"basic": _basic_legs, "round": _round_legs, "support": _support_legs, "office": _office_legs}
_ARMS = {"none": lambda w, d, z: [], "basic": _basic_arms, "solid": _solid_arms, "office": _office_arms}
_BACKS = {"basic": _basic_back, "hbar": _hbar_back, "vbar": _vbar_back, "office": _office_back}
