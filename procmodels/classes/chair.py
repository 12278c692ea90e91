"""Chairs, armchairs, swivel chairs, stools, benches, loungers: 42 parameters, of which 27 do something at a time.

Lengths are fractions of the chair's height: its back ends at 1. Of the gauges that a normalised shape leaves open this
one varies least between kinds of chairs (a bar chair is as wide as 0.4 of its height, an easy chair as 0.9; of seat
heights it would be 0.5 and 2.2), it is the extent that pictures and meshes show best, and a real height turns all
values into centimetres. Metres would be one number too many: every shape would have a line of vectors, not one. A seat
without a back would leave its height open; it stands at SEAT_HEIGHT, where a usual chair's is, so that its other values
mean what they mean on chairs, and a change of `back` leaves the rest where it is. Lengths that must fit into others are
shares of them (a seat's thickness of its height, a gap of the back): every combination of values is a sound chair.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from procmodels.conditions import when
from procmodels.parameters import grouped
from procmodels.parts import arms as arm_parts
from procmodels.parts import backs, legs
from procmodels.parts.arms import Arms
from procmodels.parts.backs import Back
from procmodels.parts.boards import Side, end_boards, side_boards
from procmodels.parts.legs import Leg
from procmodels.parts.primitives import LEVEL, Plane
from procmodels.parts.seats import Seat
from procmodels.shape import Part
from procmodels.space import Choice, Flag, Geometric, Integer, Params, ParamSpace, Scalar
from procmodels.units import DEGREES, SHARE, Unit, of_parameter

SEAT_HEIGHT = 0.52
THICKEST, WIDEST = 0.08, 0.24  # legs, arms

FRAMED = ("vbars", "splat", "cross", "frame")

# When parameters do something.
FOUR, LEGGED = when("base").is_("four"), when("base").among("four", "sled", "fold")
TAPERED, BOARDED = when("base").among("four", "fold"), when("base").among("four", "panel")
STAR, COLUMN = when("base").is_("star"), when("base").among("star", "pedestal")
BARRED = when("stretchers").not_("none") | when("foot_ring").is_(True)
BACK, ARMS = when("back").not_("none"), when("arms").not_("none")
RAILED = when("back").among(*FRAMED)
GAPPED, TOPPED = when("back").not_("none", "shell"), when("back").among("panel", "shell", *FRAMED)
BARS, FILLED = when("back").among("hbars", "vbars"), when("back").among("hbars", "vbars", "splat", "cross")

OF_SEAT_HEIGHT, OF_DEPTH, OF_WIDTH = of_parameter("seat_height"), of_parameter("depth"), of_parameter("width")
OF_LESS_HIGH = Unit("of the seat's height or depth, whichever is less")
OF_LESS = Unit("of the seat before it or its width, whichever is less")
OF_SECTOR = Unit("of the angle between two arms")
OF_BELOW, OF_BACK = Unit("of the height below the seat"), Unit("of the back's height")
APRON = "boards under the seat; 0: none"

_SEAT = grouped(
    "seat",
    Geometric("width", 0.26, 1.6, usual=(0.58, 0.14), about="of the seat's front edge, over the arms"),
    Geometric("depth", 0.26, 1.15, usual=(0.56, 0.1), about="of the seat"),
    Scalar("seat_height", 0.2, 0.88, only_if=BACK, usual=(SEAT_HEIGHT, 0.07), about="its top, at the front"),
    Geometric("seat_thickness", 0.025, 0.32, unit=OF_SEAT_HEIGHT, usual=(0.1, 0.06), about="of the slab"),
    Scalar("seat_round", 0.0, 1.0, unit=SHARE, usual=(0.1, 0.25), about="from rectangle (0) to ellipse (1)"),
    Scalar("seat_taper", 0.6, 1.15, unit=OF_WIDTH, usual=(0.9, 0.1), about="width of the seat's rear edge"),
    Scalar(
        "seat_drop", 0.0, 0.32, unit=OF_LESS_HIGH, usual=(0.04, 0.06), about="how much lower the seat is at the rear"
    ),
    Scalar("seat_cushion", 0.0, 0.18, unit=OF_SEAT_HEIGHT, usual=(0.0, 0.08), absent=0.6, about="on the slab; 0: none"),
)
_BASE = grouped(
    "base",
    Choice("base", ("four", "star", "sled", "fold", "pedestal", "panel"), usual=(56, 30, 4, 4.5, 2, 3)),
    Geometric(
        "leg_thickness", 0.012, THICKEST, usual=(0.045, 0.015), about="of legs at the top, a column, side boards"
    ),
    Scalar("leg_taper", 0.35, 1.0, unit=SHARE, only_if=TAPERED, usual=(0.8, 0.2), about="foot beside upper end"),
    Scalar("splay_side", -3.0, 18.0, unit=DEGREES, only_if=LEGGED, usual=(3.0, 4.0), about="feet out to the sides"),
    Scalar("splay_front", -6.0, 18.0, unit=DEGREES, only_if=LEGGED, usual=(2.0, 4.0), about="front feet forwards"),
    Scalar("splay_rear", -6.0, 25.0, unit=DEGREES, only_if=LEGGED, usual=(7.0, 6.0), about="rear feet backwards"),
    Scalar("inset_side", 0.0, 0.5, unit=SHARE, only_if=FOUR, usual=(0.04, 0.08), about="legs from the sides inwards"),
    Scalar("inset_front", 0.0, 0.5, unit=SHARE, only_if=FOUR, usual=(0.04, 0.08), about="from front and rear inwards"),
    Scalar("apron", 0.0, 0.9, unit=OF_BELOW, only_if=BOARDED, usual=(0.0, 0.15), absent=0.65, about=APRON),
    Choice("stretchers", ("none", "sides", "H", "box"), FOUR, usual=(55, 12, 15, 18), about="bars between the legs"),
    Flag("foot_ring", COLUMN, usual=0.1, about="a ring round the column for the feet"),
    Scalar("stretcher_height", 0.08, 0.8, unit=OF_BELOW, only_if=BARRED, usual=(0.35, 0.15), about="or of the ring"),
    Flag("rear_posts", when("base").is_("sled"), usual=0.5, about="without them the seat hangs from the front"),
    Scalar("base_radius", 0.16, 0.42, only_if=COLUMN, usual=(0.3, 0.05), about="of the star or disc on the floor"),
    Integer("base_arms", 3, 6, STAR, usual=(2, 12, 80, 1), about="of the star"),
    Scalar(
        "base_turn", -0.5, 0.5, unit=OF_SECTOR, only_if=STAR, usual=(0.0, 0.25), about="of the star; 0: one to the rear"
    ),
    Flag("castors", STAR, usual=0.85, about="wheels under the star"),
)
_BACK = grouped(
    "back",
    Choice("back", ("none", "panel", "shell", "hbars", *FRAMED), usual=(8, 54, 10, 8, 9, 6, 1, 4)),
    Scalar("back_width", 0.45, 1.0, unit=SHARE, only_if=BACK, usual=(0.93, 0.08), about="of the seat's at the rear"),
    Scalar("back_flare", -0.3, 0.35, unit=SHARE, only_if=BACK, usual=(0.0, 0.08), about="how much wider its top is"),
    Scalar("back_rake", -2.0, 40.0, unit=DEGREES, only_if=BACK, usual=(10.0, 6.0), about="how far it leans"),
    Scalar("back_bend", -15.0, 20.0, unit=DEGREES, only_if=BACK, usual=(4.0, 6.0), about="how much more at the top"),
    Scalar("back_wrap", 0.0, 0.65, unit=OF_LESS, only_if=BACK, usual=(0.06, 0.1), about="its sides, forwards"),
    Scalar("back_gap", 0.0, 0.7, unit=OF_BACK, only_if=GAPPED, usual=(0.0, 0.25), absent=0.5, about="above the seat"),
    Scalar(
        "back_round", 0.0, 1.0, unit=SHARE, only_if=TOPPED, usual=(0.2, 0.25), about="square corners (0) to hoop (1)"
    ),
    Integer("back_bars", 1, 8, BARS, usual=(1, 2, 3, 3, 2, 2, 1, 1), about="number of bars"),
    Scalar("bar_width", 0.08, 0.8, unit=SHARE, only_if=FILLED, usual=(0.35, 0.15), about="of each bar's room"),
    Geometric(
        "back_rail", 0.03, 0.5, unit=SHARE, only_if=RAILED, usual=(0.12, 0.08), about="height of a frame's upper rail"
    ),
    Geometric("back_thickness", 0.02, 0.35, unit=OF_DEPTH, only_if=BACK, usual=(0.065, 0.05), about="and of its posts"),
    Scalar("back_cushion", 0.0, 0.25, unit=OF_DEPTH, only_if=BACK, usual=(0.0, 0.08), absent=0.8, about="0: none"),
)
_ARMS = grouped(
    "arms",
    Choice("arms", ("none", "posts", "pads", "panel", "wrap"), BACK, usual=(57, 8, 23, 8, 4)),
    Scalar("arm_height", 0.15, 1.0, unit=OF_BACK, only_if=ARMS, usual=(0.45, 0.12), about="above the seat"),
    Geometric("arm_size", 0.03, WIDEST, unit=OF_WIDTH, only_if=ARMS, usual=(0.08, 0.04), about="width of each arm"),
    Scalar("arm_length", 0.4, 1.0, unit=SHARE, only_if=ARMS, usual=(0.92, 0.12), about="of the seat before the back"),
)
SPACE = ParamSpace("chair", (*_SEAT, *_BASE, *_BACK, *_ARMS))

# Of real ones: IKEA-Manuals-at-Work, and Sweet Home 3D's Scopia and BlendSwap-CC-0 catalogues.
USUAL_DEPTH = (0.08, 0.2)
LEAST = 0.004  # lengths in shares: a thinner cushion or apron is none


def build(params: Params) -> list[Part]:
    """The parts of a chair of height 1, standing on z = 0, facing -Y."""
    p = SimpleNamespace(**SPACE.held(params))
    cushion = p.seat_cushion * p.seat_height if p.seat_cushion > LEAST else 0.0
    seat = _seat(p, cushion)
    parts = [seat.slab(), *_base(p, seat)]
    if cushion:
        parts.append(seat.cushion(cushion, p.arm_size * p.width if p.arms == "panel" else 0.0))
    if p.back != "none":
        back = _back(p, seat)
        parts += [*_BACKS[p.back](back, p), *_arms(p, seat, back)]
        if p.back_cushion > LEAST:
            parts.append(backs.cushion(back, p.back_cushion * p.depth, cushion / back.height))
    return parts


def _seat(p: Any, cushion: float) -> Seat:
    """The slab, below a cushion."""
    z, d = p.seat_height, p.depth
    drop = p.seat_drop * min(z, d)
    middle, slope = z - cushion - drop / 2, -drop / d
    top, under = Plane(middle, slope), Plane(middle - p.seat_thickness * z, slope)
    return Seat(p.width, d, p.seat_taper, p.seat_round, top, under)


def _base(p: Any, seat: Seat) -> list[Part]:
    """All below the seat."""
    under = seat.under
    side = Side((seat.corner_width(-p.depth / 2), -p.depth / 2), (seat.corner_width(p.depth / 2), p.depth / 2))
    # Under the narrowest seats the thickest legs would stand in each other.
    size = p.leg_thickness * min(1.0, 0.9 * min(side.front[0], side.rear[0]) / THICKEST)
    if p.base == "panel":
        boards = side_boards("board {}", side, size, LEVEL, under, side.rear[1])
        return boards + (end_boards(side, size, p.apron, under) if p.apron > LEAST else [])
    if p.base in ("star", "pedestal"):
        ring = p.stretcher_height if p.foot_ring else None
        if p.base == "star":
            return legs.star(p.base_radius, p.base_arms, p.base_turn, p.castors, size, under, ring)
        return legs.pedestal(p.base_radius, size, under, ring)
    insets = (p.inset_side, p.inset_front) if p.base == "four" else (0.0, 0.0)
    taper = p.leg_taper if p.base in ("four", "fold") else 1.0

    def leg(y: float, lean: float) -> Leg:
        """Below the seat's corner at y, or nearer to the middle; its foot leans so many degrees away from it."""
        y_in = size / 2 + (abs(y) - size) * (1 - insets[1])
        room = min(seat.corner_width(y), seat.corner_width(math.copysign(y_in, y)))  # the seat may widen away from it
        x = size / 2 + (room - size) * (1 - insets[0])
        slopes = (math.tan(math.radians(p.splay_side)), math.tan(math.radians(lean)))
        return Leg.under(under, (x, math.copysign(y_in, y)), slopes, size, taper)

    front, rear = leg(seat.front, p.splay_front), leg(seat.rear, p.splay_rear)
    if p.base == "sled":
        return legs.sled(front, rear, p.rear_posts, under)
    if p.base == "fold":
        return legs.fold(front, rear, under)
    bars = legs.stretchers(p.stretchers, front, rear, p.stretcher_height)
    return legs.four(front, rear, under) + bars + (legs.aprons(front, rear, p.apron, under) if p.apron > LEAST else [])


def _back(p: Any, seat: Seat) -> Back:
    """The surface of the back, on the line through the seat's rear corners."""
    thickness = p.back_thickness * p.depth
    before = seat.rear - seat.front - thickness * math.hypot(1, math.tan(math.radians(p.back_rake)))
    wrap = p.back_wrap * min(before, p.back_width * 2 * seat.corner_width(seat.rear))
    room = 2 * min(seat.corner_width(seat.rear), seat.corner_width(seat.rear - wrap))
    return Back(
        width=p.back_width * room,
        foot=seat.rear,
        floor=seat.top,
        top=1.0,
        rake=p.back_rake,
        bend=p.back_bend,
        wrap=wrap,
        thickness=thickness,
        gap=p.back_gap if p.back != "shell" else 0.0,
        roundness=p.back_round,
        top_rail=p.back_rail,
        flare=p.back_flare,
    )


_BACKS: dict[str, Callable[[Back, Any], list[Part]]] = {
    "panel": lambda back, p: backs.panel(back),
    "shell": lambda back, p: backs.shell(back, p.depth),
    "hbars": lambda back, p: backs.hbars(back, p.back_bars, p.bar_width),
    "vbars": lambda back, p: backs.vbars(back, p.back_bars, p.bar_width),
    "splat": lambda back, p: backs.splat(back, p.bar_width),
    "cross": lambda back, p: backs.cross(back, p.bar_width),
    "frame": lambda back, p: backs.frame(back),
}


def _arms(p: Any, seat: Seat, back: Back) -> list[Part]:
    """The arms, from the rear forwards."""
    if p.arms == "none":
        return []
    top = p.seat_height + p.arm_height * (1 - p.seat_height)
    front = back.side + p.arm_length * (seat.front - back.side)
    # Between the widest arms of the narrowest seats there would be no room.
    room = min(1.0, 0.9 * min(seat.corner_width(seat.front), seat.corner_width(seat.rear)) / (WIDEST * p.width))
    arms = Arms(top, p.arm_size * p.width * room, front, seat.top.at(front))
    if p.arms == "panel":
        side = Side((seat.corner_width(front), front), (seat.corner_width(seat.rear), seat.rear))
        return arm_parts.boards(arms, side, back)
    return {"posts": arm_parts.posts, "pads": arm_parts.pads, "wrap": arm_parts.walls}[p.arms](arms, seat, back)
