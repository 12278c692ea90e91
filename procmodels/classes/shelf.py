"""Bookcases, racks, cupboards, chests of drawers, sideboards, TV units, wardrobes: 30 parameters, of which 10 to 25 do
something at a time.

Lengths are fractions of the height, as the paper's class has it: of a bookcase and a wardrobe it is the longest side,
and low ones (a TV unit is up to six times as wide as high) are measured by it as well. What must fit into something
else is a share of it: the lower part of the height inside, recesses and steps of the depth, gaps of the boards behind.

A case is cut at most once, into an upper and a lower part; each is open or closed by a grid of fronts: bookcases,
chests, sideboards (drawers over doors), wardrobes (doors over drawers), bedside tables (a drawer over an open part) and
hutches are values of two choices, where numbers of rows with doors and of rows with drawers would have to fit each
other. Whether a front is a door or a drawer is no parameter: from outside one cannot tell, but for what is higher than
wide, which is called a door. Nothing behind fronts is modelled, nobody sees it.
A shelf on a spine in its middle (1 of 17 counted) is left out: the sampler would make 8 % of them.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from procmodels.conditions import when
from procmodels.parameters import grouped
from procmodels.parts import cases
from procmodels.parts.bays import Bays, Field
from procmodels.parts.cases import BOARD, FRAME, LEG, Case, Rack
from procmodels.parts.sizes import limited
from procmodels.shape import Part
from procmodels.space import Choice, Flag, Geometric, Integer, Params, ParamSpace, Scalar
from procmodels.units import DEGREES, SHARE, Unit, of_parameter

LEAST = 0.004  # lengths in shares: what is lower is none
FRONT = 0.02  # thickness of fronts, where frame and depth allow it

# When parameters do something.
FILLED, POSTS, UPPER, LOWER = when("sides").is_("filled"), when("sides").is_("posts"), when("upper"), when("lower")
UPPER_OPEN, LOWER_OPEN, SPLIT = UPPER.is_("open"), LOWER.is_("open"), LOWER.not_("none")
UPPER_CLOSED, LOWER_CLOSED = UPPER.is_("fronts"), LOWER.is_("fronts")
FRONTS, OPENED = UPPER_CLOSED | LOWER_CLOSED, when("open_bays").not_("none")
COLUMNS, THREE, SEVERAL = when("columns").above(1), when("columns").above(2), when("rows").above(1)
ROWS = POSTS | UPPER_OPEN | (UPPER_CLOSED & OPENED)
RATED = SEVERAL | (UPPER_CLOSED & when("front_rows").above(1))
DIVIDED = COLUMNS & (UPPER_OPEN | LOWER_OPEN)
INNER = (UPPER_OPEN & SEVERAL) | (LOWER_OPEN & when("rows_below").above(1)) | DIVIDED
BOARDS = POSTS | (UPPER_OPEN & SEVERAL) | SPLIT | COLUMNS
ALL_OPEN = FILLED & UPPER_OPEN & LOWER.among("none", "open")
HEADED, RAISED = POSTS | ALL_OPEN, FILLED & when("base_height").above(LEAST)
TOPPED = FILLED & (FRONTS | when("headroom").below(LEAST))
ON_LEGS, INSET = when("base").is_("legs"), when("base").among("legs", "plinth")

OF_DEPTH, ABOVE_BASE = of_parameter("depth"), Unit("of the height above the base")
INSIDE, BEHIND = Unit("of the height inside"), Unit("of the boards behind")
HALF = Unit("of the way from the edge to the middle")

_BODY = grouped(
    "body",
    Geometric("width", 0.15, 6.0, usual=(0.75, 0.5), about="outer"),
    Geometric("depth", 0.1, 1.3, usual=(0.3, 0.15), about="outer"),
    Choice("sides", ("filled", "posts"), usual=(90, 10), about="what holds the boards"),
    Geometric("frame", 0.006, FRAME, usual=(0.018, 0.01), about="thickness of sides, top and bottom, or of posts"),
    Geometric("board", 0.005, BOARD, only_if=BOARDS, usual=(0.014, 0.008), about="thickness of boards and dividers"),
    Flag("back", POSTS | ALL_OPEN, usual=0.65, about="a board along the rear"),
    Scalar("top_overhang", 0.0, 0.08, only_if=TOPPED, usual=(0.0, 0.015), absent=0.65, about="beyond sides and front"),
    Scalar("headroom", 0.0, 0.3, unit=ABOVE_BASE, only_if=HEADED, usual=(0.0, 0.06), absent=0.85, about="over the top"),
    Scalar("recess", 0.0, 0.5, unit=OF_DEPTH, only_if=INNER, usual=(0.0, 0.08), absent=0.6, about="of boards inside"),
    Scalar("lean", 0.0, 0.7, unit=OF_DEPTH, only_if=POSTS, usual=(0.0, 0.2), absent=0.8, about="less deep at the top"),
)
_BASE = grouped(
    "base",
    Scalar("base_height", 0.0, 0.4, usual=(0.05, 0.05), absent=0.25, about="of the lowest board; 0: on the floor"),
    Choice("base", ("plinth", "legs", "sides"), RAISED, usual=(50, 28, 22), about="what carries the lowest board"),
    Scalar("base_inset", 0.0, 0.6, unit=HALF, only_if=INSET, usual=(0.04, 0.08), about="of legs or plinth"),
    Geometric("leg_thickness", 0.01, LEG, only_if=ON_LEGS, usual=(0.04, 0.02), about="at the top"),
    Scalar("leg_splay", 0.0, 20.0, unit=DEGREES, only_if=ON_LEGS, usual=(0.0, 6.0), absent=0.6, about="feet outwards"),
)
_ROOM = grouped(
    "compartments",
    Integer("columns", 1, 5, FILLED, usual=(80, 10, 6, 3, 1), about="bays beside each other"),
    Geometric("column_ratio", 0.4, 2.5, unit=SHARE, only_if=COLUMNS, usual=(1.0, 0.3), about="inner or left bays"),
    Choice("divider", ("filled", "posts", "alternating"), DIVIDED, usual=(85, 5, 10), about="between open bays"),
    Integer("rows", 1, 7, ROWS, usual=(10, 18, 24, 24, 14, 7, 3), about="openings above each other"),
    Geometric(
        "row_ratio", 0.5, 2.5, unit=SHARE, only_if=RATED, usual=(1.1, 0.3), about="of the lowest and the top row"
    ),
    Choice("upper", ("open", "fronts"), FILLED, usual=(58, 42), about="the upper or only part"),
    Integer("front_rows", 1, 6, UPPER_CLOSED, usual=(50, 10, 15, 14, 8, 3), about="doors or drawers above each other"),
    Integer("leaves", 1, 2, UPPER_CLOSED, usual=(55, 45), about="doors beside each other in a bay"),
    Choice("lower", ("none", "open", "fronts"), FILLED, usual=(64, 6, 30), about="the lower part"),
    Scalar("lower_height", 0.1, 0.85, unit=INSIDE, only_if=SPLIT, usual=(0.35, 0.15), about="of the lower part"),
    Integer("rows_below", 1, 5, SPLIT, usual=(45, 28, 17, 6, 4), about="openings or fronts of the lower part"),
    Integer("leaves_below", 1, 2, LOWER_CLOSED, usual=(55, 45), about="doors of the lower part"),
    Scalar("step", 0.0, 0.7, unit=OF_DEPTH, only_if=SPLIT, usual=(0.0, 0.2), absent=0.8, about="upper part less deep"),
    Choice("open_bays", ("none", "inner", "outer"), FRONTS & THREE, usual=(60, 30, 10), about="no fronts"),
    Scalar("front_gap", 0.08, 0.8, unit=BEHIND, only_if=FRONTS, usual=(0.25, 0.12), about="between doors or drawers"),
)
SPACE = ParamSpace("shelf", (*_BODY, *_BASE, *_ROOM))

# Of real ones: IKEA-Manuals-at-Work, and Sweet Home 3D's Scopia and BlendSwap-CC-0 catalogues.
USUAL_DEPTH = (-0.9, 0.5)


def build(params: Params) -> list[Part]:
    """The parts of a shelf of height 1, standing on z = 0, its front towards -Y."""
    p = SimpleNamespace(**SPACE.held(params))
    p.base_height = p.base_height if p.base_height > LEAST else 0.0
    p.headroom = p.headroom if p.headroom > LEAST else 0.0
    return _cupboard(p) if p.sides == "filled" else _rack(p)


def _rack(p: Any) -> list[Part]:
    """Boards on posts."""
    size = limited(p.frame, 0.3 * min(p.width, p.depth * (1 - p.lean)), FRAME)
    rack = Rack(p.width, p.depth, p.lean, size, (p.base_height, 1 - p.headroom * (1 - p.base_height)))
    return rack.parts(rack.boards(_weights(p.rows, p.row_ratio), p.board), p.back)


def _weights(count: int, ratio: float) -> list[float]:
    """Heights of rows from the lowest, relative: the lowest is `ratio` times the highest."""
    return [ratio ** -(i / (count - 1)) for i in range(count)] if count > 1 else [1.0]


def _columns(count: int, ratio: float) -> list[float]:
    """Widths of bays from the right, relative: the left one of two, or the inner ones, `ratio` times the others."""
    return [1.0, ratio] if count == 2 else [ratio if 0 < i < count - 1 else 1.0 for i in range(count)]


def _cupboard(p: Any) -> list[Part]:
    """A case, what it stands on, and what is in its parts."""
    case = _case(p)
    parts = case.parts(p.top_overhang if not case.sides else 0.0)
    if p.base_height and p.base != "sides":
        plinth = p.base == "plinth"
        legs = (p.leg_thickness, p.base_inset, p.leg_splay)
        parts += cases.plinth(case, p.base_inset) if plinth else cases.feet(case, *legs)
    kinds = [("", p.upper, p.rows, p.front_rows, p.row_ratio, p.leaves, case.step)]
    if case.split:
        kinds.insert(0, ("lower ", p.lower, p.rows_below, p.rows_below, 1.0, p.leaves_below, 0.0))
    columns = _columns(p.columns, p.column_ratio)
    for (name, kind, rows, closed, ratio, leaves, step), z, field in zip(
        kinds, case.rooms(), case.fields(), strict=True
    ):
        y = (case.y[0] + step, case.rear)
        bays = Bays(name, case.inner, y, z, columns, _weights(rows, ratio), p.board)
        if kind == "open":
            parts += bays.open(p.divider, p.recess * (y[1] - y[0]))
        else:
            gap = p.front_gap * min(case.frame, bays.divider)
            cover = Field(case.half, field, case.face + step, _weights(closed, ratio), leaves, gap)
            parts += bays.closed(cover, p.open_bays)
    return parts


def _case(p: Any) -> Case:
    """The boards round everything."""
    frame = limited(p.frame, 0.2 * min(p.width, 1 - p.base_height), FRAME)
    closed = "fronts" in (p.upper, p.lower)
    front = min(FRONT, frame, 0.1 * p.depth) if closed else 0.0
    headroom = 0.0 if closed else p.headroom
    high = 1 - headroom * (1 - p.base_height)
    split = None
    if p.lower != "none":
        board = limited(p.board, 0.1 * (high - p.base_height), BOARD)
        low = p.base_height + frame
        at = low + p.lower_height * (high - frame - low - board)
        split = (at, at + board)
    return Case(
        half=p.width / 2,
        y=(front - p.depth / 2, p.depth / 2),
        face=-p.depth / 2,
        low=p.base_height,
        to_floor=p.base == "sides",
        high=high,
        sides=1.0 if headroom else None,
        frame=frame,
        back=p.back or closed,
        split=split,
        step=p.step * p.depth if split and p.step > LEAST else 0.0,
    )
