"""What a mattress lies on: a deck between boards, and what stands under its corners."""

from __future__ import annotations

from dataclasses import dataclass

from procmodels.parts.legs import both
from procmodels.parts.primitives import box
from procmodels.shape import Part

RAIL, SLAB = 0.014, 0.012  # thickness of the boards round a deck, and of the deck
HAIR = 5e-4


@dataclass(frozen=True)
class Deck:
    """A level deck: half its width, y of its ends, z of the lower edge of its boards and of its top.

    ends  those that have no board of their own, "foot" and "head": the deck brings one
    """

    half: float
    front: float
    rear: float
    rail: float
    top: float
    ends: tuple[str, ...] = ()

    @property
    def under(self) -> float:
        """z of the slab's underside."""
        return self.top - min(SLAB, 0.8 * (self.top - self.rail))

    def parts(self, name: str = "") -> list[Part]:
        """The slab and the boards round it; name: before theirs."""
        side = box("", (self.half - RAIL, self.front, self.rail), (self.half, self.rear, self.top))
        parts, inner = both(f"{name}rail {{}}", side), self.half - RAIL
        for end, y in (("foot", self.front), ("head", self.rear - RAIL)):
            if end in self.ends:
                parts.append(box(f"{name}rail {end}", (-inner, y, self.rail), (inner, y + RAIL, self.top)))
        front, rear = self.front + RAIL * ("foot" in self.ends), self.rear - RAIL * ("head" in self.ends)
        return [box(f"{name}deck", (-inner, front, self.under), (inner, rear, self.top)), *parts]


def plinth(deck: Deck, inset: float) -> list[Part]:
    """A box under the deck; inset: from the boards to the middle, a share."""
    x, y = (h - RAIL - inset * (h - 2 * RAIL) for h in (deck.half, 0.5))
    return [box("plinth", (-x, -y, 0.0), (x, y, deck.under))]


def end_boards(deck: Deck, thickness: float) -> list[Part]:
    """Boards from the floor to the deck at the ends that have none."""
    places = [(end, -0.5 if end == "foot" else 0.5 - thickness) for end in deck.ends]
    size = (deck.half, thickness, deck.rail)
    return [box(f"board {end}", (-size[0], y, 0.0), (size[0], y + size[1], size[2])) for end, y in places]


def legs(deck: Deck, size: float, inset: float) -> list[Part]:
    """Square legs in the corners, behind the boards; inset: from there to the middle, a share."""
    x, y = (size / 2 + (h - HAIR - size) * (1 - inset) for h in (deck.half, 0.5))
    parts = []
    for end, middle in (("foot", -y), ("head", y)):
        leg = box("", (x - size / 2, middle - size / 2, 0.0), (x + size / 2, middle + size / 2, deck.under))
        parts += both(f"leg {end} {{}}", leg)
    return parts
