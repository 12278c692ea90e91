"""Tables, desks, coffee and side tables, consoles, bar tables: 30 parameters, of which 7 to 24 do something at a time.

Lengths are fractions of the table's height, as the paper's class has it: it is what pictures and meshes show best, and
what a table is named by (a dining table is 0.74 m, a coffee table 0.4 m high); widths run from a bar table's 0.4 to a
coffee table's 5. What must fit into something else is a share of it: insets of half the top, aprons, shelves and blocks
of the height below the top, blocks of the room between the legs. Every combination of values is a sound table.

Ends that are frames (loops) are four legs whose stretchers at the sides lie on the floor, A-shaped trestles four legs
that are far in at the top and lean: neither needs a base of its own. Blocks of drawers come one a side with as many
drawers each, since the sampler gives every value of two numbers at least 5 %: half of all tables would have some.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from procmodels.conditions import when
from procmodels.parameters import grouped
from procmodels.parts import frames, fronts, legs, tops
from procmodels.parts.frames import Angle, Ends
from procmodels.parts.legs import Leg
from procmodels.parts.primitives import Plane, box, mirrored, rotation
from procmodels.parts.sizes import inward, limited
from procmodels.parts.tops import Top
from procmodels.shape import Part
from procmodels.space import Choice, Flag, Geometric, Integer, Params, ParamSpace, Scalar
from procmodels.units import DEGREES, SHARE, Unit, of_parameter

THICKEST = 0.3  # legs
LEAST = 0.004  # lengths in shares: a lower apron is none
GAP, FRONT = 0.008, 0.02  # between drawers, and their thickness

SHARES = {"four": 66, "three": 2, "panels": 8, "trestle": 8, "pedestal": 6, "cross": 4, "block": 6}
BARS = {"none": 82, "sides": 7, "H": 4, "box": 4, "X": 3}
LEGS, FEET, ON_FLOOR = "of legs at the top, boards and columns", "to the front and rear", "0: on the floor"

# When parameters do something.
BASE = when("base")
FOUR, PANELS, TRESTLE, PEDESTAL = (BASE.is_(b) for b in ("four", "panels", "trestle", "pedestal"))
CORNERED, SQUARE, ANGLED = FOUR | PANELS, when("round").is_(False), when("corner").not_("none")
# Of what may be L-shaped: what is not.
STRAIGHT = (CORNERED & when("round").is_(True)) | when("corner").is_("none")
ROUNDED = SQUARE & (BASE.not_("four", "panels") | when("corner").is_("none"))
TAPERED, LEANING = BASE.among("four", "three", "pedestal"), BASE.is_("three") | (FOUR & STRAIGHT)
OBLONG, ENDED, HUNG = BASE.not_("pedestal", "three"), CORNERED | TRESTLE, STRAIGHT & when("blocks").is_("none")
# Round tables have no corners that say where legs are.
TURNED = (when("round").is_(True) & (BASE.is_("three") | when("blocks").is_("none"))) | when("foot").not_("disc")
BARRED, SHELF, BLOCKS = when("stretchers").not_("none"), when("shelf").is_(True), when("blocks").not_("none")

OF_WIDTH, OF_DEPTH = of_parameter("width"), of_parameter("depth")
BELOW, ROOM = Unit("of the height below the top"), Unit("of the room between the legs")
HALF = Unit("of the way from the top's edge to its middle")

_TOP = grouped(
    "top",
    Geometric("width", 0.4, 5.5, usual=(1.8, 0.8), about="of the top"),
    Geometric("depth", 0.28, 4.2, usual=(1.05, 0.35), about="of the top"),
    Geometric("top_thickness", 0.01, 0.25, usual=(0.045, 0.03), about="of the top"),
    Flag("round", usual=0.14, about="a circle or an ellipse"),
    Scalar("corner_round", 0.0, 0.7, unit=SHARE, only_if=ROUNDED, usual=(0.0, 0.12), absent=0.6, about="0: square"),
    Choice("corner", ("none", "left", "right"), CORNERED & SQUARE, usual=(98, 1, 1), about="where an L comes forward"),
    Scalar("corner_width", 0.2, 0.6, unit=OF_WIDTH, only_if=ANGLED, usual=(0.4, 0.08), about="of the arm forwards"),
    Scalar("corner_depth", 0.25, 0.75, unit=OF_DEPTH, only_if=ANGLED, usual=(0.5, 0.1), about="of the arm behind"),
)
_BASE = grouped(
    "base",
    Choice("base", tuple(SHARES), usual=tuple(SHARES.values()), about="what the top stands on"),
    Geometric("leg_thickness", 0.012, THICKEST, only_if=BASE.not_("block"), usual=(0.075, 0.03), about=LEGS),
    Scalar("leg_taper", 0.3, 1.3, unit=SHARE, only_if=TAPERED, usual=(0.9, 0.2), about="foot beside upper end"),
    Scalar("splay_side", 0.0, 22.0, unit=DEGREES, only_if=LEANING, usual=(0.0, 5.0), absent=0.6, about="feet outwards"),
    Scalar("splay_front", 0.0, 24.0, unit=DEGREES, only_if=FOUR & STRAIGHT, usual=(0.0, 5.0), absent=0.6, about=FEET),
    Scalar("inset_side", 0.0, 0.85, unit=HALF, only_if=BASE.not_("pedestal"), usual=(0.06, 0.12), about="of legs"),
    Scalar("inset_front", 0.0, 0.85, unit=HALF, only_if=OBLONG, usual=(0.06, 0.12), about="of legs"),
    Scalar("turn", 0.0, 45.0, unit=DEGREES, only_if=TURNED, usual=(0.0, 15.0), absent=0.5, about="of legs or feet"),
    Scalar("post_width", 0.05, 0.9, unit=OF_DEPTH, only_if=TRESTLE, usual=(0.2, 0.15), about="of the ends' posts"),
    Choice(
        "foot", ("disc", "plate", "three", "four", "five"), PEDESTAL, usual=(45, 10, 10, 30, 5), about="of a column"
    ),
    Scalar("foot_radius", 0.3, 1.2, unit=HALF, only_if=PEDESTAL, usual=(0.6, 0.12), about="of a column's foot"),
)
_BETWEEN = grouped(
    "between the legs",
    Scalar("apron", 0.0, 0.35, unit=BELOW, only_if=HUNG, usual=(0.12, 0.05), absent=0.4, about="boards under the top"),
    Scalar("back_panel", 0.0, 1.0, unit=BELOW, only_if=ENDED, usual=(0.0, 0.4), absent=0.85, about="below an apron"),
    Choice("stretchers", tuple(BARS), FOUR & STRAIGHT, usual=tuple(BARS.values()), about="bars between the legs"),
    Scalar("stretcher_height", 0.0, 0.9, unit=BELOW, only_if=BARRED | TRESTLE, usual=(0.2, 0.15), about=ON_FLOOR),
    Scalar("stretcher_thickness", 0.3, 1.0, unit=SHARE, only_if=BARRED, usual=(0.6, 0.15), about="of the legs'"),
    Flag("shelf", STRAIGHT, usual=0.2, about="a board between the legs"),
    Scalar("shelf_height", 0.0, 0.85, unit=BELOW, only_if=SHELF, usual=(0.25, 0.15), about=ON_FLOOR),
    Geometric("shelf_thickness", 0.008, 0.12, only_if=SHELF, usual=(0.035, 0.02), about="of that board"),
)
_BLOCKS = grouped(
    "drawers",
    Choice("blocks", ("none", "left", "right", "both"), STRAIGHT, usual=(86, 4, 5, 5), about="drawers under the top"),
    Integer("drawers", 1, 5, BLOCKS, usual=(3, 2, 4, 2, 1), about="in each block"),
    Scalar("block_width", 0.15, 0.48, unit=ROOM, only_if=BLOCKS, usual=(0.32, 0.06), about="of each block"),
    Scalar("block_height", 0.12, 1.0, unit=BELOW, only_if=BLOCKS, usual=(0.8, 0.25), about="1: down to the floor"),
)
SPACE = ParamSpace("table", (*_TOP, *_BASE, *_BETWEEN, *_BLOCKS))

# Of real ones: IKEA-Manuals-at-Work, and Sweet Home 3D's Scopia and BlendSwap-CC-0 catalogues.
USUAL_DEPTH = (-0.55, 0.33)


def build(params: Params) -> list[Part]:
    """The parts of a table of height 1, standing on z = 0; its width runs along X, who sits at it looks to +Y."""
    p = SimpleNamespace(**SPACE.held(params))
    p.z = 1 - p.top_thickness
    p.apron = p.apron if p.apron > LEAST and p.blocks == "none" else 0.0
    p.back_panel = p.apron + p.back_panel * (1 - p.apron) if p.back_panel > LEAST else 0.0
    if p.corner != "none":
        return _angled(p)
    top = Top(p.width, p.depth, 1.0 if p.round else p.corner_round, p.z, 1.0)
    below = _BASES[p.base](p, top)
    if p.turn:
        below = _turned(below, p.turn, (1.0, 1.0) if p.base == "pedestal" else (p.width, p.depth))
    return [top.plate("top", p.z, 1.0), *below]


def _turned(parts: list[Part], degrees: float, axes: tuple[float, float]) -> list[Part]:
    """The parts turned about the vertical, below an ellipse of these axes along it: legs stay within the top."""
    stretched = np.diag([*axes, 1.0, 1.0])
    matrix = stretched @ rotation("Z", degrees) @ np.linalg.inv(stretched)
    return [part.moved(matrix) for part in parts]


def _size(p: Any, room: tuple[float, float]) -> float:
    """The legs' thickness: less where they would else stand in each other, below narrow tops."""
    return limited(p.leg_thickness, 0.9 * min(room), THICKEST)


def _four(p: Any, top: Top) -> list[Part]:
    """Legs at the corners, and what is between them."""
    size = _size(p, top.room)
    widest = size * max(1.0, p.leg_taper)
    x, y = (inward(r, widest, i) for r, i in zip(top.room, (p.inset_side, p.inset_front), strict=True))
    lean = (math.tan(math.radians(p.splay_side)), math.tan(math.radians(p.splay_front)))
    under = Plane(p.z)
    front, rear = (Leg.under(under, (x, s * y), lean, size, p.leg_taper) for s in (-1, 1))
    parts = legs.four(front, rear, under) + legs.aprons(front, rear, p.apron, under, p.back_panel)
    floor = 0.0
    if p.stretchers != "none":
        bars = frames.bars(p.stretchers, front, rear, p.stretcher_height, p.stretcher_thickness)
        floor = float(bars[0].vertices[:, 2].max())
        parts += bars
    if p.shelf:
        low, high = _shelf(p)
        at = front.at((low + high) / 2)
        parts.append(top.plate("shelf", low, high, (at[0], -at[1])))
        floor = max(floor, high)
    behind = y - legs.apron_half(front, rear) if p.back_panel else y + size / 2
    return parts + _blocks(p, float(parts[0].vertices[:, 0].min()), (-y - size / 2, behind), floor)


def _panels(p: Any, top: Top) -> list[Part]:
    """Boards at the ends, and what is between them."""
    ends = _ends(p, top)
    parts, floor = ends.panels() + ends.aprons(p.apron, p.back_panel), 0.0
    if p.shelf:
        low, floor = _shelf(p)
        parts.append(box("shelf", (-ends.inner, -ends.half, low), (ends.inner, ends.half, floor)))
    rear = ends.half - ends.board if p.back_panel else ends.half
    return parts + _blocks(p, ends.inner, (-ends.half, rear), floor)


def _shelf(p: Any) -> tuple[float, float]:
    """z of its faces."""
    thick = min(p.shelf_thickness, 0.3 * p.z)
    low = p.shelf_height * (p.z - thick)
    return low, low + thick


def _blocks(p: Any, x: float, y: tuple[float, float], floor: float) -> list[Part]:
    """Blocks of drawers under the top, at the inside of legs or panels at x, above z = floor."""
    z = (p.z - p.block_height * (p.z - floor), p.z)
    parts = []
    for side, sign in (("left", 1), ("right", -1)):
        if p.blocks in (side, "both"):
            wide = sorted((sign * (1 - 2 * p.block_width) * x, sign * x))
            parts += fronts.block(f"{{}} {side}", (wide[0], wide[1]), y, z, p.drawers, FRONT, GAP)
    return parts


def _ends(p: Any, top: Top) -> Ends:
    size = _size(p, top.room)
    return Ends(inward(top.room[0], size, p.inset_side), size, top.room[1] * (1 - 0.9 * p.inset_front), p.z)


def _three(p: Any, top: Top) -> list[Part]:
    size = _size(p, top.room)
    widest = size * max(1.0, p.leg_taper)
    (_, rear), (x, y) = top.towards(90), top.towards(-30)
    heads = [(0.0, inward(rear, widest, p.inset_side))]
    heads.append((inward(x, widest, p.inset_side), -inward(-y, widest, p.inset_side)))
    return frames.three((heads[0], heads[1]), size, p.leg_taper, math.tan(math.radians(p.splay_side)), p.z)


def _pedestal(p: Any, top: Top) -> list[Part]:
    half = min(p.width, p.depth) / 2
    radius = p.foot_radius * half
    size = _size(p, (half, radius / max(1.0, p.leg_taper)))
    return frames.pedestal(p.foot, radius, size, p.leg_taper, p.z)


def _block(p: Any, top: Top) -> list[Part]:
    """A body from the floor to the top, round as the top."""
    x, y = (r * (1 - 0.9 * i) for r, i in zip(top.room, (p.inset_side, p.inset_front), strict=True))
    return [top.plate("block", 0.0, p.z, (x, y))]


def _angled(p: Any) -> list[Part]:
    """An L on five legs, or on boards at its ends; built at the left."""
    arm = (p.corner_depth * p.depth, p.corner_width * p.width)
    size = _size(p, (arm[1] / 2, arm[0] / 2))
    edges = [i * (a - size) / 2 for i, a in ((p.inset_side, arm[1]), (p.inset_front, arm[0]))]
    reach = (p.width / 2 - edges[0], p.depth / 2 - edges[1])
    below = Angle(reach, (arm[0] - 2 * edges[1], arm[1] - 2 * edges[0]), p.z)
    parts = [tops.angled("top", p.width, p.depth, arm, p.z, 1.0)]
    parts += below.legs(size, p.leg_taper) if p.base == "four" else below.panels(size)
    if p.back_panel:
        parts += below.back(size, p.back_panel)
    return parts if p.corner == "left" else [mirrored(q, q.name) for q in parts]


_BASES: dict[str, Callable[[Any, Top], list[Part]]] = {
    "four": _four,
    "three": _three,
    "panels": _panels,
    "trestle": lambda p, top: _ends(p, top).trestles(p.post_width, p.stretcher_height, p.back_panel),
    "pedestal": _pedestal,
    "cross": lambda p, top: _ends(p, top).crosses(),
    "block": _block,
}
