"""Sofas: straight ones, armchairs, corner sofas, chaises longues, tubs, daybeds: 31 parameters, of which 9 to 30 do
something at a time. From primitives alone; the geometry-node sofa is the paper's.

Lengths are fractions of the height of the back, which ends at 1: of the extents that a normalised shape leaves open it
is the one that pictures show best (the depth hides behind the front, widths differ by six times), and it varies by a
tenth. A seat without a back would leave it open; it stands at SEAT, where a usual sofa's is, so that its other values
mean what they mean on sofas. Cushions, rolls and flares may stand out over height and width. Lengths that must fit
into others are shares of them, or give way where there is no room: every combination of values is a sound sofa.

Beside the proposal that this follows: the back is a choice (a board, a tub round the seat, none), as a tub has neither
rolled arms nor cushions behind the sitter; arms may fall to the front and may be open; how far the back reaches over
the arms, the thickness of back cushions and the width of the corner part are parameters, as real sofas differ in them.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

from procmodels.conditions import when
from procmodels.parameters import grouped
from procmodels.parts import sofa_bases, upholstery
from procmodels.parts.primitives import box, mirrored, plate, rotation
from procmodels.parts.sofa_cushions import Seating
from procmodels.parts.sofa_plan import Plan
from procmodels.parts.upholstery import WAIST, Arm, Tub
from procmodels.shape import Part
from procmodels.space import Choice, Flag, Geometric, Integer, Params, ParamSpace, Scalar
from procmodels.units import DEGREES, OF_HEIGHT, SHARE, Unit, of_parameter

SEAT = 0.5  # height of a seat without a back
WIDEST, THICKEST, DEEPEST = 0.5, 0.4, 0.32  # arms; backs and their cushions, of the depth
SHORTEST, LONGEST = 0.5, 1.06  # arms, of the depth
OPEN = 0.35  # width of an open arm beside that of one with upholstery
LEAST = 0.01  # lengths in shares: a thinner cushion is none

# When parameters do something.
STRAIGHT, BACK = when("back").is_("straight"), when("back").not_("none")
TUB, BOTH, ANY_ARMS = when("back").is_("tub"), when("arms").is_("both"), when("arms").not_("none")
ARMS, CLOSED = TUB | ANY_ARMS, when("open_arms").is_(False)
NO_TUB, LEGS = when("back").not_("tub"), when("base").among("legs", "sled")
RAISED, CORNER = when("base").not_("skirt"), when("corner").not_("none")
SEATED, CUSHIONS = when("cushion").above(LEAST), when("back_cushion").above(LEAST)
# Arms along the sides: one across the end of a corner part is as long as that is wide.
ALONG = TUB | BOTH | ANY_ARMS & (when("corner").is_("none") | when("corner_back").is_(False))

OF_SEAT, OF_DEPTH, OF_WIDTH = of_parameter("seat_height"), of_parameter("depth"), of_parameter("width")
OF_BELOW, OF_ABOVE = Unit("of the height from legs to seat"), Unit("of the height above the seat")
OF_ROOM = Unit("of the room between the sides")

_SEAT = grouped(
    "seat",
    Geometric("width", 0.7, 4.6, unit=OF_HEIGHT, usual=(2.3, 0.6), about="over the arms"),
    Geometric("depth", 0.72, 1.75, unit=OF_HEIGHT, usual=(1.12, 0.14), about="of the straight part"),
    Scalar("seat_height", 0.32, 0.74, only_if=BACK, usual=(SEAT, 0.05), about="top of the seat cushions"),
    Integer("seats", 1, 5, NO_TUB & SEATED, usual=(30, 35, 28, 5, 2), about="seat cushions side by side"),
    Scalar("cushion", 0.0, 0.7, unit=OF_BELOW, usual=(0.4, 0.12), absent=0.05, about="their thickness; 0: none"),
    Scalar(
        "softness",
        0.0,
        1.0,
        unit=SHARE,
        only_if=SEATED | CUSHIONS,
        usual=(0.35, 0.2),
        about="of cushions: crisp edges (0) to plump (1)",
    ),
    Integer("pillows", 0, 4, BACK, usual=(60, 14, 18, 3, 5), about="loose ones before the back"),
)
_BASE = grouped(
    "base",
    Choice("base", ("legs", "skirt", "plinth", "sled"), usual=(56, 32, 7, 5), about="what it stands on"),
    Scalar("leg_height", 0.04, 0.6, unit=OF_SEAT, only_if=RAISED, usual=(0.25, 0.1), about="below base and arms"),
    Geometric("leg_thickness", 0.015, 0.14, unit=OF_HEIGHT, only_if=LEGS, usual=(0.055, 0.02), about="at the top"),
    Scalar("leg_splay", 0.0, 20.0, unit=DEGREES, only_if=when("base").is_("legs"), usual=(3.0, 5.0), about="outwards"),
)
_BACK = grouped(
    "back",
    Choice("back", ("straight", "tub", "none"), usual=(92, 5, 3), about="a tub goes round the seat"),
    Geometric("back_thickness", 0.04, THICKEST, unit=OF_DEPTH, only_if=BACK, usual=(0.17, 0.07), about="at the seat"),
    Scalar("back_rake", 0.0, 28.0, unit=DEGREES, only_if=BACK, usual=(7.0, 5.0), about="how far it leans"),
    Scalar("back_width", 0.0, 1.0, unit=SHARE, only_if=STRAIGHT & BOTH, usual=(0.2, 0.3), about="of arms, over them"),
    Scalar(
        "back_cushion", 0.0, DEEPEST, unit=OF_DEPTH, only_if=STRAIGHT, usual=(0.17, 0.05), absent=0.2, about="thick"
    ),
    Integer("back_cushions", 1, 5, CUSHIONS, usual=(12, 40, 34, 9, 5), about="side by side"),
    Scalar("back_cushion_rise", -0.5, 0.4, unit=OF_ABOVE, only_if=CUSHIONS, usual=(0.0, 0.12), about="over the back"),
)
_ARMS = grouped(
    "arms",
    Choice("arms", ("both", "left", "right", "none"), NO_TUB, usual=(86, 3, 3, 8)),
    Scalar(
        "arm_height", 0.08, 1.0, unit=OF_ABOVE, only_if=ARMS, usual=(0.45, 0.18), about="over the seat; 1: as the back"
    ),
    Geometric(
        "arm_width",
        0.03,
        WIDEST,
        unit=OF_HEIGHT,
        only_if=ARMS,
        usual=(0.22, 0.08),
        about="of each; open ones are thinner",
    ),
    Scalar("arm_length", SHORTEST, LONGEST, unit=OF_DEPTH, only_if=ALONG, usual=(0.99, 0.05), about="from the rear"),
    Flag("open_arms", ANY_ARMS, usual=0.07, about="a rail on posts"),
    Scalar("arm_fall", 0.0, 0.7, unit=SHARE, only_if=CLOSED, usual=(0.0, 0.2), absent=0.75, about="lower at the front"),
    Scalar(
        "arm_roll", 0.0, 1.0, unit=SHARE, only_if=CLOSED, usual=(0.0, 0.3), absent=0.7, about="board (0) to scroll (1)"
    ),
    Scalar("arm_flare", 0.0, 20.0, unit=DEGREES, only_if=CLOSED, usual=(0.0, 5.0), absent=0.6, about="outwards"),
    Scalar("tub_round", 0.1, 1.0, unit=SHARE, only_if=TUB, usual=(0.5, 0.25), about="of the rear corners"),
)
_CORNER = grouped(
    "corner",
    Choice("corner", ("none", "left", "right"), NO_TUB, usual=(84, 8, 8), about="a part that goes on to the front"),
    Geometric("corner_length", 0.2, 1.9, unit=OF_DEPTH, only_if=CORNER, usual=(0.65, 0.3), about="before the front"),
    Scalar("corner_width", 0.2, 0.75, unit=OF_ROOM, only_if=CORNER, usual=(0.38, 0.08), about="of its seat"),
    Flag("corner_back", CORNER & STRAIGHT, usual=0.45, about="with a back along its side; a chaise without"),
)
SPACE = ParamSpace("sofa", (*_SEAT, *_BASE, *_BACK, *_ARMS, *_CORNER))

# Of real ones: IKEA-Manuals-at-Work, and Sweet Home 3D's Scopia and BlendSwap-CC-0 catalogues.
USUAL_DEPTH = (-0.74, 0.25)

OTHER = {"left": "right", "right": "left"}


def build(params: Params) -> list[Part]:
    """The parts of a sofa whose back ends at 1, standing on z = 0, facing -Y."""
    p = SimpleNamespace(**SPACE.held(params))
    p.low = 0.0 if p.base == "skirt" else p.leg_height * p.seat_height
    p.soft = p.cushion > LEAST
    p.deck = p.seat_height - (p.cushion * (p.seat_height - p.low) if p.soft else 0.0)
    p.top = p.seat_height + p.arm_height * (1 - p.seat_height)
    p.lean = _slope(p.back_rake) if p.back != "none" else 0.0
    p.wall = p.back_thickness * p.depth if p.back != "none" else 0.0
    # Between the thickest arms or walls of the narrowest seats there would be no room.
    p.arm = (OPEN if p.open_arms else 1.0) * p.arm_width * min(1.0, 0.3 * p.width / WIDEST)
    p.seating = Seating(p.seat_height, p.deck, p.lean, p.softness)
    if p.back == "tub":
        return _tub(p)
    if p.corner != "right":
        return _straight(p)
    # All is built with the corner part at the left.
    p.arms = OTHER.get(p.arms, p.arms)
    return [mirrored(part, _other_side(part.name)) for part in _straight(p)]


def _other_side(name: str) -> str:
    return " ".join(OTHER.get(word, word) for word in name.split(" "))


def _slope(degrees: float) -> float:
    return math.tan(math.radians(degrees))


def _straight(p: Any) -> list[Part]:
    """A sofa with a back like a board, or none, and perhaps a corner part at the left."""
    plan = _plan(p)
    parts = [box(f"base {i + 1}", (a, c, p.low), (b, d, p.deck)) for i, (a, b, c, d) in enumerate(plan.areas())]
    parts += [*_stand(p, plan), *_arms(p, plan), *_walls(p, plan)]
    if p.soft:
        parts += p.seating.seats(plan.seats(p.seats))
    if p.back == "none":
        return parts
    thick = p.back_cushion * p.depth if p.back_cushion > LEAST else 0.0
    # Those along the side leave room on the corner part's seat.
    beside = thick * min(1.0, 0.6 * (plan.x_left - plan.x_seats) / (DEEPEST * p.depth)) if plan.side else 0.0
    if thick:
        top = p.seat_height + (1 - p.seat_height) * (1 + p.back_cushion_rise)
        parts += p.seating.backs(plan.backs(p.back_cushions, thick), top)
        parts += p.seating.side_backs(plan.side_backs(p.back_cushions, thick, beside), top)
    ends = (plan.x_right, plan.x_left - beside)
    return parts + p.seating.pillows(p.pillows, ends, plan.front, plan.y_back - thick)


def _plan(p: Any) -> Plan:
    """Where everything lies."""
    rear, half = p.depth / 2, p.width / 2
    right, left = (p.arm if p.arms in ("both", side) else 0.0 for side in ("right", "left"))
    plan = Plan(half, -rear, rear, p.wall, right, left, rear - p.arm_length * p.depth)
    if p.corner == "none":
        return plan
    length = p.corner_length * p.depth
    side = p.wall * min(1.0, 0.3 * p.width / (THICKEST * p.depth)) if p.corner_back and p.wall else 0.0
    x_left = half - (side or left)
    x = x_left - p.corner_width * (x_left - plan.x_right)
    # An arm across the front end leaves room for the seat.
    left = min(left, 0.5 * length) if side else left
    return Plan(half, -rear, rear, p.wall, right, left, plan.arm_front, (x, -rear - length), side)


def _stand(p: Any, plan: Plan) -> list[Part]:
    """All below base and arms."""
    if p.base == "skirt":
        return []
    if p.base == "plinth":
        return sofa_bases.plinths(plan.outer_areas(), p.low)
    feet = plan.feet(p.leg_thickness, 0.0 if p.open_arms else WAIST * p.arm_roll)
    if p.base == "sled":
        return sofa_bases.sled(feet, p.low, p.leg_thickness)
    return sofa_bases.legs(feet, p.low, p.leg_thickness, _slope(p.leg_splay))


def _arms(p: Any, plan: Plan) -> list[Part]:
    """The arms along the sides, and one across the front end of a corner part that has a wall along its side."""

    def arm(side: str, inner: float, width: float, front: float, rear: float, lean: float) -> list[Part]:
        shape = (p.arm_roll, _slope(p.arm_flare), 0.0 if p.open_arms else lean, p.arm_fall)
        made = Arm(inner, width, front, rear, p.low, p.top, p.seat_height, *shape)
        return made.open(f"arm {side}", p.arm) if p.open_arms else [made.wall(f"arm {side}")]

    parts: list[Part] = []
    if plan.right:
        made = arm("right", -plan.x_right, plan.right, plan.arm_front, plan.rear, p.lean)
        parts += [mirrored(part, part.name) for part in made]
    if plan.end and plan.corner:
        x, y = plan.corner
        made = arm("left", -y - plan.end, plan.end, x, plan.half - plan.side, 0.0)
        return parts + [part.moved(rotation("Z", -90)) for part in made]
    if not plan.left:
        return parts
    # Before a corner part there is no room for an arm that stands out over the front.
    share = (
        SHORTEST + (p.arm_length - SHORTEST) * (1 - SHORTEST) / (LONGEST - SHORTEST) if plan.corner else p.arm_length
    )
    return parts + arm("left", plan.x_left, plan.left, plan.rear - share * p.depth, plan.rear, p.lean)


def _walls(p: Any, plan: Plan) -> list[Part]:
    """The back, and the wall along the side of a corner part."""
    if not plan.wall:
        return []
    right = plan.x_right - p.back_width * plan.right if plan.right else -plan.half
    left = plan.half if plan.side or not plan.left else plan.x_left + p.back_width * plan.left
    heights = (p.low, p.seat_height, p.lean)
    parts = [upholstery.back("back", (right, left), plan.y_back, plan.rear, *heights)]
    if plan.side and plan.corner:
        ends = (-plan.y_back, -plan.corner[1])
        wall = upholstery.back("side back", ends, plan.half - plan.side, plan.half, *heights)
        parts.append(wall.moved(rotation("Z", -90)))
    return parts


def _tub(p: Any) -> list[Part]:
    """A sofa whose arms and back are one wall."""
    rear, half, length = p.depth / 2, p.width / 2, p.arm_length * p.depth
    radius = p.tub_round * min(half, 0.95 * length)
    tub = Tub(half, rear, p.arm, p.wall, rear - length, radius, p.low, p.seat_height, p.top, p.lean)
    floor = tub.floor(-rear)
    parts = [tub.part(), plate("base 1", floor, p.low, p.deck)]
    if p.base == "plinth":
        parts.append(plate("plinth 1", 0.9 * floor, 0.0, p.low))
    else:
        parts += _stand(p, Plan(half, -rear, rear, p.wall, p.arm, p.arm, rear - length, cut=0.3 * radius))
    if p.soft:
        parts.append(p.seating.whole(floor))
    back, x = tub.room()
    return parts + p.seating.pillows(p.pillows, (-x, x), -rear, back)
