"""Beds with frames, boxes and upholstered heads, daybeds, loft beds, bunks: 27 parameters, of which 7 to 23 do
something at a time.

Lengths are fractions of the bed's length, from the outside of its head to the outside of its foot: people are much of
one length, so that beds of all kinds differ in it by a tenth, where their widths differ by three times and heights by
five. A leaning head and bedclothes stand out over it. As the paper's, a bed lies along Y, its foot towards -Y. Lengths
that must fit into others are shares of them, or give way where there is no room: every combination is a sound bed.

Beside the proposal that this follows: the foot is of the head's kind; a round-cornered frame with bars, a hoop, is a
value of `head_round`, not a kind of its own; head and foot may go down to the floor (`base` boards). Left out, as
each is rare: canopies, four-posters, cribs with two sides, drawers and desks under lofts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from procmodels.conditions import when
from procmodels.parameters import grouped
from procmodels.parts import bedding, bedsteads, bunks, heads
from procmodels.parts.bedding import Clothes, Mattress
from procmodels.parts.bedsteads import HAIR, Deck
from procmodels.parts.heads import Head
from procmodels.parts.primitives import mirrored
from procmodels.shape import Part
from procmodels.space import Choice, Geometric, Integer, Params, ParamSpace, Scalar
from procmodels.units import DEGREES, MODEL, SHARE, Unit, of_parameter

UNIT, ABOVE = Unit("of length", MODEL), Unit("of length, above the deck", MODEL)
OF_DECK, OF_WIDTH = of_parameter("deck"), of_parameter("width")
OF_HEAD, OF_BELOW = Unit("of the head's height"), Unit("of the height below the mattress's top")

HOLDING = 0.02  # a foot that is lower does not hold the bedclothes
LEAST = 0.004  # what is thinner or lower is not there
THICKEST = 0.09  # legs
LOWEST, TALLEST = 0.05, 0.62  # head above the deck

# When parameters do something.
LOW, HIGH = when("storeys").is_("low"), when("storeys").not_("low")
DECK, RAIL = when("storeys").not_("loft"), when("base").not_("box") | HIGH
LEGS, INSET = when("base").is_("posts") | HIGH, when("base").among("posts", "recessed")
HEAD, BARRED = when("head").not_("none"), when("head").among("vbars", "hbars")
FREE = HEAD & LOW  # a head that stands free, not between the posts of a bunk
SIDE, SOFT = when("sides").not_("none"), when("mattress").above(LEAST)
MADE, CLOTHES = SOFT & when("sides").is_("none"), when("bedclothes").above(LEAST)

_FRAME = grouped(
    "frame",
    Choice("storeys", ("low", "loft", "bunk"), usual=(88, 5, 7), about="one deck near the floor, one high up, two"),
    Geometric("width", 0.36, 1.12, unit=UNIT, usual=(0.68, 0.17), about="of the frame"),
    Scalar("deck", 0.05, 0.32, unit=UNIT, only_if=DECK, usual=(0.15, 0.04), about="height of its top"),
    Scalar(
        "rail", 0.1, 0.95, unit=OF_DECK, only_if=RAIL, usual=(0.5, 0.2), about="height of the boards round the deck"
    ),
    Choice(
        "base", ("posts", "box", "recessed", "boards"), LOW, usual=(58, 25, 5, 12), about="what the frame stands on"
    ),
    Geometric("leg_thickness", 0.008, THICKEST, unit=UNIT, only_if=LEGS, usual=(0.03, 0.012), about="or of posts"),
    Scalar(
        "leg_inset", 0.0, 0.5, unit=SHARE, only_if=INSET, usual=(0.03, 0.06), about="from the corners to the middle"
    ),
)
_ENDS = grouped(
    "head and foot",
    Choice("head", ("none", "panel", "vbars", "hbars"), usual=(14, 58, 18, 10), about="and foot"),
    Scalar("head_height", LOWEST, TALLEST, unit=ABOVE, only_if=HEAD, usual=(0.28, 0.09), about="of its highest place"),
    Geometric("head_thickness", 0.006, 0.17, unit=UNIT, only_if=FREE, usual=(0.026, 0.018), about="of the head"),
    Scalar("head_rake", 0.0, 25.0, unit=DEGREES, only_if=FREE, usual=(2.0, 4.0), about="how far it leans"),
    Scalar("head_width", 0.85, 1.7, unit=OF_WIDTH, only_if=FREE, usual=(1.01, 0.04), about="of head and foot"),
    Scalar(
        "head_arch", 0.0, 0.6, unit=OF_HEAD, only_if=HEAD, usual=(0, 0.15), absent=0.65, about="its sides are lower"
    ),
    Scalar(
        "head_round", 0.0, 1.0, unit=SHARE, only_if=HEAD, usual=(0.05, 0.15), about="square corners (0) to hoop (1)"
    ),
    Integer("bars", 2, 12, BARRED, usual=(2, 4, 5, 4, 3, 3, 3, 2, 2, 1, 1), about="in the head, as many in the foot"),
    Scalar("bar_width", 0.08, 0.8, unit=SHARE, only_if=BARRED, usual=(0.3, 0.15), about="of each bar's room"),
    Scalar("foot_height", 0.0, 0.4, unit=ABOVE, only_if=FREE, usual=(0.06, 0.08), absent=0.4, about="0: no foot"),
)
_SIDES = grouped(
    "sides",
    Choice("sides", ("none", "left", "right"), LOW, usual=(92, 4, 4), about="the board along a daybed, like its head"),
    Scalar("side_height", 0.04, 0.42, unit=ABOVE, only_if=SIDE, usual=(0.22, 0.06), about="of that board"),
)
_BEDDING = grouped(
    "bedding",
    Scalar("mattress", 0.0, 0.2, unit=UNIT, usual=(0.09, 0.03), about="thickness above the deck; 0: none"),
    Scalar("mattress_inset", -0.02, 0.05, unit=UNIT, only_if=SOFT, usual=(0.006, 0.01), about="from the frame's sides"),
    Integer("pillows", 0, 4, SOFT, usual=(30, 22, 34, 4, 10), about="a second row from the third on"),
    Scalar("bedclothes", 0.0, 1.0, unit=OF_BELOW, only_if=MADE, usual=(0.35, 0.2), absent=0.4, about="hang; 0: none"),
    Scalar("bedclothes_spread", 0.0, 0.12, unit=UNIT, only_if=CLOTHES, usual=(0.02, 0.015), about="out from the sides"),
)
_UPPER = grouped(
    "upper deck",
    Scalar("headroom", 0.3, 0.62, unit=UNIT, only_if=HIGH, usual=(0.44, 0.05), about="from a lower deck to the upper"),
    Scalar("guard", 0.05, 0.22, unit=UNIT, only_if=HIGH, usual=(0.13, 0.03), about="height of the bars at its sides"),
    Choice("ladder", ("none", "end", "left", "right"), HIGH, usual=(10, 20, 35, 35), about="where it stands"),
)
SPACE = ParamSpace("bed", (*_FRAME, *_ENDS, *_SIDES, *_BEDDING, *_UPPER))

# Of real ones: IKEA-Manuals-at-Work, and Sweet Home 3D's Scopia and BlendSwap-CC-0 catalogues.
USUAL_DEPTH = (0.39, 0.25)

FOOT = 0.05  # the most that a foot or a side is thick
CLEARLY = 0.03  # by which the foot is higher than the head when the bed is rather turned round


def build(params: Params) -> list[Part]:
    """The parts of a bed of length 1, standing on z = 0, its foot towards -Y."""
    p = SimpleNamespace(**SPACE.held(params))
    # In the narrowest beds the thickest legs would stand in each other.
    p.leg_thickness *= min(1.0, 0.4 * p.width / THICKEST)
    return _low(p) if p.storeys == "low" else _high(p)


def turned_round(params: Params) -> Params | None:
    """The values of the bed facing the other way when its foot is the higher end: hardly any bed is built so."""
    head, foot = float(params["head_height"]), float(params["foot_height"])
    if "foot_height" not in SPACE.active(params) or foot <= head + CLEARLY:
        return None
    return {**params, "head_height": foot, "foot_height": head}


def _low(p: Any) -> list[Part]:
    """One deck between head and foot."""
    rail = 0.0 if p.base == "box" else (1 - p.rail) * p.deck
    parts, inner, bare = [], [-0.5, 0.5], []
    for name, away, height in (("foot", -1, p.foot_height), ("head", 1, p.head_height)):
        if p.head == "none" or height < LEAST:
            bare.append(name)
            continue
        thick = p.head_thickness if away > 0 else min(p.head_thickness, FOOT)
        inner[away > 0] -= away * thick
        end = Head(
            width=p.width * p.head_width,
            inner=inner[away > 0],
            away=away,
            thickness=thick,
            low=0.0 if p.base in ("box", "boards") else rail,
            rail=rail,
            deck=p.deck,
            top=p.deck + height,
            slope=math.tan(math.radians(p.head_rake)) if away > 0 else 0.0,
            **_outline(p, p.leg_thickness),
        )
        parts += heads.build(p.head, name, end, p.bars, p.bar_width)
    deck = Deck(p.width / 2, inner[0], inner[1], rail, p.deck, tuple(bare))
    side, room = _side(p, deck)
    return [*parts, *deck.parts(), *_BASES[p.base](deck, p), *side, *_bedding(p, deck, room)]


_BASES: dict[str, Callable[[Deck, Any], list[Part]]] = {
    "posts": lambda deck, p: bedsteads.legs(deck, p.leg_thickness, p.leg_inset),
    "box": lambda deck, p: [],
    "recessed": lambda deck, p: bedsteads.plinth(deck, p.leg_inset),
    "boards": lambda deck, p: bedsteads.end_boards(deck, p.head_thickness),
}


def _outline(p: Any, post: float) -> dict[str, Any]:
    """What head, foot and side have in common."""
    return {"arch": p.head_arch, "roundness": p.head_round, "post": post}


def _side(p: Any, deck: Deck) -> tuple[list[Part], tuple[float, float]]:
    """A board along a side of the deck, and from where to where along X it leaves room for the mattress."""
    if p.sides == "none":
        return [], (-deck.half, deck.half)
    thick, length = min(p.head_thickness, FOOT, 0.2 * p.width), deck.rear - deck.front
    inner, top = deck.half - thick, p.deck + p.side_height
    side = Head(length - HAIR, inner, 1, thick, p.deck, p.deck - HAIR, p.deck, top, **_outline(p, p.leg_thickness))
    kind = "panel" if p.head == "none" else p.head
    bars = round(p.bars * length / p.width) if kind == "vbars" else p.bars
    parts = heads.turned(heads.build(kind, "side", side, bars, p.bar_width), (deck.front + deck.rear) / 2)
    if p.sides == "left":
        return parts, (-deck.half, inner)
    return [mirrored(part, part.name) for part in parts], (-inner, deck.half)


def _bedding(p: Any, deck: Deck, room: tuple[float, float], name: str = "") -> list[Part]:
    """Mattress, pillows and bedclothes; room: along X."""
    if p.mattress < LEAST:
        return []
    ends = (deck.front, deck.rear, deck.top, deck.top + p.mattress)
    mattress = Mattress(room[0] + p.mattress_inset, room[1] - p.mattress_inset, *ends)
    parts = [mattress.part(f"{name}mattress"), *bedding.pillows(p.pillows, mattress, f"{name}pillow")]
    if p.storeys == "low" and p.sides == "none" and p.bedclothes > LEAST:
        height = 0.0 if "foot" in deck.ends else p.foot_height
        foot = (-0.5, deck.top + height) if height < min(HOLDING, 0.5 * p.mattress) else None
        free, side = bedding.before_pillows(p.pillows, mattress), (deck.half, deck.top)
        parts.append(Clothes(free, p.bedclothes, p.bedclothes_spread, side, foot).part(mattress))
    return parts


def _high(p: Any) -> list[Part]:
    """One or two decks between four posts."""
    half, size = p.width / 2, p.leg_thickness
    rail = p.rail * min(p.deck, 0.3 * p.headroom)
    upper, height = p.deck + p.headroom, p.guard
    if p.head != "none":
        room = min(1.0, (0.8 * (p.headroom - rail) - LOWEST) / (TALLEST - LOWEST))
        height = LOWEST + room * (p.head_height - LOWEST)
    kind, bars = (p.head, p.bars) if p.head != "none" else ("hbars", 2)
    parts = bunks.posts(half, size, upper + max(height * (1 - p.head_arch), p.guard))
    thick, width = 0.7 * size, 2 * (half - size + HAIR)
    for name, top in (("", p.deck), ("upper ", upper)):
        if not name and p.storeys == "loft":
            continue
        low = top - rail
        parts += Deck(half, thick - 0.5, 0.5 - thick, low, top).parts(name)
        for end, away in (("foot", -1), ("head", 1)):
            inner, outline = away * (0.5 - thick), _outline(p, 0.5 * size)
            board = Head(width, inner, away, thick, low, low, top, top + height, **outline)
            parts += heads.build(kind, f"{name}{end}", board, bars, p.bar_width)
        room = half - (bunks.BAR if name else 0.0)
        parts += _bedding(p, Deck(half, size - 0.5, 0.5 - size, low, top), (-room, room), name)
    parts += bunks.guards(half, size - 0.5, 0.5 - size, upper, p.guard)
    if p.ladder != "none":
        parts += bunks.ladder(p.ladder, half, upper - rail, upper + p.guard)
    return parts
