"""Chairs, armchairs, swivel chairs, stools, benches, loungers: 38 parameters, of which 15 to 25 do something at a time.

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
from procmodels.units import DEGREES, SHARE, of_parameter

SEAT_HEIGHT = 0.52

FOUR, LEGGED = when("base").is_("four"), when("base").among("four", "sled", "fold")
COLUMN = when("base").among("star", "pedestal")
BACK, ARMS = when("back").not_("none"), when("arms").not_("none")
FRAMED = ("vbars", "splat", "cross", "frame")
OF_SEAT_HEIGHT, OF_DEPTH = of_parameter("seat_height"), of_parameter("depth")

SPACE = ParamSpace(
    "chair",
    (
        Geometric(
            "width", 0.24, 1.6, usual=(0.58, 0.14), about="of the seat's front edge, over the arms", group="seat"
        ),
        Geometric("depth", 0.26, 1.15, usual=(0.56, 0.1), about="of the seat", group="seat"),
        Scalar(
            "seat_height",
            0.2,
            0.88,
            only_if=BACK,
            usual=(SEAT_HEIGHT, 0.07),
            group="seat",
            about="top of the seat, with its cushion, at the front",
        ),
        Geometric(
            "seat_thickness", 0.025, 0.35, unit=OF_SEAT_HEIGHT, usual=(0.1, 0.06), group="seat", about="of the slab"
        ),
        Scalar(
            "seat_round",
            0.0,
            1.0,
            unit=SHARE,
            usual=(0.1, 0.25),
            group="seat",
            about="outline from rectangle (0) to ellipse (1)",
        ),
        Scalar(
            "seat_taper",
            0.6,
            1.15,
            unit=of_parameter("width"),
            usual=(0.9, 0.1),
            group="seat",
            about="width of the seat's rear edge",
        ),
        Scalar(
            "seat_drop",
            0.0,
            0.38,
            unit=SHARE,
            usual=(0.04, 0.06),
            group="seat",
            about="how much lower the seat is at the rear, of its height or depth, whichever is less",
        ),
        Scalar(
            "seat_cushion",
            0.0,
            0.22,
            unit=OF_SEAT_HEIGHT,
            usual=(0.0, 0.08),
            absent=0.6,
            group="seat",
            about="thickness of a cushion on the slab, 0: none",
        ),
        Choice(
            "base",
            ("four", "star", "sled", "fold", "pedestal", "panel"),
            usual=(56, 30, 4, 4.5, 2, 3),
            about="what the seat stands on",
            group="base",
        ),
        Geometric(
            "leg_thickness",
            0.012,
            0.09,
            usual=(0.045, 0.015),
            group="base",
            about="of legs at their upper ends, of a column, of side boards",
        ),
        Scalar(
            "leg_taper",
            0.35,
            1.2,
            unit=SHARE,
            only_if=when("base").among("four", "fold"),
            usual=(0.8, 0.2),
            about="thickness of a leg's foot beside its upper end",
            group="base",
        ),
        Scalar(
            "splay_side",
            -3.0,
            18.0,
            unit=DEGREES,
            only_if=LEGGED,
            usual=(3.0, 4.0),
            group="base",
            about="how far the feet stand out to the sides",
        ),
        Scalar(
            "splay_front",
            -6.0,
            18.0,
            unit=DEGREES,
            only_if=LEGGED,
            usual=(2.0, 4.0),
            group="base",
            about="how far the front feet stand forwards",
        ),
        Scalar(
            "splay_rear",
            -6.0,
            25.0,
            unit=DEGREES,
            only_if=LEGGED,
            usual=(7.0, 6.0),
            group="base",
            about="how far the rear feet stand backwards",
        ),
        Scalar(
            "leg_inset",
            0.0,
            0.5,
            unit=SHARE,
            only_if=FOUR,
            usual=(0.04, 0.08),
            group="base",
            about="of the legs from the seat's corners, of the way to its middle",
        ),
        Scalar(
            "apron",
            0.0,
            0.9,
            unit=SHARE,
            only_if=when("base").among("four", "panel"),
            usual=(0.0, 0.15),
            absent=0.65,
            about="boards under the seat, of the height below it, 0: none",
            group="base",
        ),
        Choice(
            "stretchers",
            ("none", "sides", "H", "box"),
            only_if=FOUR,
            usual=(55, 12, 15, 18),
            group="base",
            about="bars between the legs",
        ),
        Flag("foot_ring", only_if=COLUMN, usual=0.1, about="a ring round the column for the feet", group="base"),
        Scalar(
            "stretcher_height",
            0.08,
            0.8,
            unit=SHARE,
            usual=(0.35, 0.15),
            group="base",
            only_if=when("stretchers").not_("none") | when("foot_ring").is_(True),
            about="of stretchers or the foot ring, of the height below the seat",
        ),
        Flag(
            "rear_posts",
            only_if=when("base").is_("sled"),
            usual=0.5,
            group="base",
            about="rear posts on the runners; without them the seat hangs from the front (cantilever)",
        ),
        Scalar(
            "base_radius",
            0.16,
            0.42,
            only_if=COLUMN,
            usual=(0.3, 0.05),
            group="base",
            about="of the star or the disc on the floor",
        ),
        Integer(
            "base_arms",
            3,
            6,
            only_if=when("base").is_("star"),
            usual=(2, 12, 80, 1),
            group="base",
            about="arms of the star",
        ),
        Flag("castors", only_if=when("base").is_("star"), usual=0.85, about="wheels under the star", group="base"),
        Choice(
            "back",
            ("none", "panel", "shell", "hbars", "vbars", "splat", "cross", "frame"),
            usual=(8, 54, 10, 8, 9, 6, 1, 4),
            about="what the sitter leans on",
            group="back",
        ),
        Scalar(
            "back_width",
            0.45,
            1.0,
            unit=SHARE,
            only_if=BACK,
            usual=(0.93, 0.08),
            group="back",
            about="of the seat's width at the rear",
        ),
        Scalar(
            "back_rake",
            -2.0,
            40.0,
            unit=DEGREES,
            only_if=BACK,
            usual=(10.0, 6.0),
            group="back",
            about="how far its lower half leans",
        ),
        Scalar(
            "back_bend",
            -15.0,
            20.0,
            unit=DEGREES,
            only_if=BACK,
            usual=(4.0, 6.0),
            group="back",
            about="how much more its upper end leans",
        ),
        Scalar(
            "back_wrap",
            0.0,
            0.65,
            unit=OF_DEPTH,
            only_if=BACK,
            usual=(0.06, 0.1),
            group="back",
            about="how far its sides come forward",
        ),
        Scalar(
            "back_gap",
            0.0,
            0.7,
            unit=SHARE,
            only_if=BACK & when("back").not_("shell"),
            usual=(0.0, 0.25),
            absent=0.5,
            about="from the seat to its lower edge, of its height",
            group="back",
        ),
        Scalar(
            "back_round",
            0.0,
            1.0,
            unit=SHARE,
            only_if=when("back").among("panel", "shell", *FRAMED),
            usual=(0.2, 0.25),
            about="upper corners from square (0) to a hoop (1)",
            group="back",
        ),
        Integer(
            "back_bars",
            1,
            8,
            only_if=when("back").among("hbars", "vbars"),
            usual=(1, 2, 3, 3, 2, 2, 1, 1),
            about="number of bars",
            group="back",
        ),
        Scalar(
            "bar_width",
            0.08,
            0.8,
            unit=SHARE,
            only_if=when("back").among("hbars", "vbars", "splat"),
            usual=(0.35, 0.15),
            about="of the room that each bar has",
            group="back",
        ),
        Geometric(
            "back_thickness",
            0.02,
            0.35,
            unit=OF_DEPTH,
            only_if=BACK,
            usual=(0.065, 0.05),
            group="back",
            about="of its boards, posts and rails",
        ),
        Scalar(
            "back_cushion",
            0.0,
            0.25,
            unit=OF_DEPTH,
            only_if=BACK,
            usual=(0.0, 0.08),
            absent=0.8,
            group="back",
            about="thickness of a cushion before the back, 0: none",
        ),
        Choice(
            "arms",
            ("none", "posts", "pads", "panel", "wrap"),
            only_if=BACK,
            usual=(57, 8, 23, 8, 4),
            about="rails on posts, pads, boards, or walls that go on from the back",
            group="arms",
        ),
        Scalar(
            "arm_height",
            0.15,
            1.0,
            unit=SHARE,
            only_if=ARMS,
            usual=(0.45, 0.12),
            group="arms",
            about="above the seat, of the back's height",
        ),
        Geometric(
            "arm_size",
            0.03,
            0.24,
            unit=of_parameter("width"),
            only_if=ARMS,
            usual=(0.08, 0.04),
            group="arms",
            about="width of each arm",
        ),
        Scalar(
            "arm_length",
            0.4,
            1.0,
            unit=SHARE,
            only_if=ARMS,
            usual=(0.92, 0.12),
            group="arms",
            about="from the rear, of the seat's depth",
        ),
    ),
)

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
    under, size = seat.under, p.leg_thickness
    if p.base == "panel":
        side = _side(seat, -p.depth / 2, p.depth / 2)
        boards = side_boards("board {}", side, size, LEVEL, under, side.rear[1])
        return boards + (end_boards(side, size, p.apron, under) if p.apron > LEAST else [])
    if p.base in ("star", "pedestal"):
        ring = p.stretcher_height if p.foot_ring else None
        if p.base == "star":
            return legs.star(p.base_radius, p.base_arms, p.castors, size, under, ring)
        return legs.pedestal(p.base_radius, size, under, ring)
    inset = p.leg_inset if p.base == "four" else 0.0
    taper = p.leg_taper if p.base in ("four", "fold") else 1.0
    front = _leg(seat, seat.front, -p.splay_front, p, inset, taper)
    rear = _leg(seat, seat.rear, p.splay_rear, p, inset, taper)
    if p.base == "sled":
        return legs.sled(front, rear, p.rear_posts, under)
    if p.base == "fold":
        return legs.fold(front, rear, under)
    bars = legs.stretchers(p.stretchers, front, rear, p.stretcher_height)
    return legs.four(front, rear, under) + bars + (legs.aprons(front, rear, p.apron, under) if p.apron > LEAST else [])


def _leg(seat: Seat, y: float, lean: float, p: Any, inset: float, taper: float) -> Leg:
    """A leg below the seat's corner at y, or nearer to the middle; `lean`: degrees that its foot is to the rear."""
    half = p.leg_thickness / 2
    x = half + (seat.corner_width(y) - 2 * half) * (1 - inset)
    inner = half + (abs(y) - 2 * half) * (1 - inset)
    slopes = (math.tan(math.radians(p.splay_side)), math.tan(math.radians(lean)))
    return Leg.under(seat.under, (x, math.copysign(inner, y)), slopes, p.leg_thickness, taper)


def _side(seat: Seat, front: float, rear: float) -> Side:
    """The line through the seat's corners on the left, between two places along y."""
    return Side((seat.corner_width(front), front), (seat.corner_width(rear), rear))


def _back(p: Any, seat: Seat) -> Back:
    """The surface of the back, on the line through the seat's rear corners."""
    wrap = p.back_wrap * p.depth
    room = 2 * min(seat.corner_width(seat.rear), seat.corner_width(seat.rear - wrap))
    return Back(
        width=p.back_width * room,
        foot=seat.rear,
        floor=seat.top,
        top=1.0,
        rake=p.back_rake,
        bend=p.back_bend,
        wrap=wrap,
        thickness=p.back_thickness * p.depth,
        gap=p.back_gap if p.back != "shell" else 0.0,
        roundness=p.back_round,
    )


_BACKS: dict[str, Callable[[Back, Any], list[Part]]] = {
    "panel": lambda back, p: backs.panel(back),
    "shell": lambda back, p: backs.shell(back, p.depth),
    "hbars": lambda back, p: backs.hbars(back, p.back_bars, p.bar_width),
    "vbars": lambda back, p: backs.vbars(back, p.back_bars, p.bar_width),
    "splat": lambda back, p: backs.splat(back, p.bar_width),
    "cross": lambda back, p: backs.cross(back),
    "frame": lambda back, p: backs.frame(back),
}


def _arms(p: Any, seat: Seat, back: Back) -> list[Part]:
    """The arms, from the rear forwards."""
    if p.arms == "none":
        return []
    top = p.seat_height + p.arm_height * (1 - p.seat_height)
    front = seat.rear + p.arm_length * (seat.front - seat.rear)
    arms = Arms(top, p.arm_size * p.width, front, seat.top.at(front))
    if p.arms == "panel":
        return arm_parts.boards(arms, _side(seat, arms.front, seat.rear), back)
    return {"posts": arm_parts.posts, "pads": arm_parts.pads, "wrap": arm_parts.walls}[p.arms](arms, seat, back)
