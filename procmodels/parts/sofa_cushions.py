"""Cushions and pillows of sofas: on the seat, leaning on the back, loose before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels.parts.cushions import cushion, pillow, square
from procmodels.parts.primitives import rotation
from procmodels.parts.sofa_plan import Area
from procmodels.shape import Part

SINK = 0.01  # how deep what stands on the seat presses into it
PRESS = (
    0.2  # how much deeper pillows press into plump cushions, which are lower towards their edges, of their thickness
)
PILLOW = (0.42, 0.4, 0.13)  # width, height and thickness, where there is room
SLANT = 0.25  # how much more than the back a pillow leans, for every unit of height
PILLOW_ROOM = 0.3  # of the seat before the back, that a pillow of that size takes


@dataclass(frozen=True)
class Seating:
    """seat: z of the seat's top; deck: of what its cushions lie on; lean: of the back, for every unit of height;
    softness of the cushions."""

    seat: float
    deck: float
    lean: float
    softness: float

    def seats(self, areas: list[Area]) -> list[Part]:
        """A cushion on each area of the deck."""
        return [
            cushion(
                f"seat cushion {i + 1}", square((x0, y0), (x1, y1), self.softness), self.deck, self.seat, self.softness
            )
            for i, (x0, x1, y0, y1) in enumerate(areas)
        ]

    def whole(self, outline: np.ndarray) -> Part:
        """One cushion of an outline (n, 2)."""
        return cushion("seat cushion 1", outline, self.deck, self.seat, self.softness)

    def backs(self, areas: list[Area], top: float) -> list[Part]:
        """Cushions up to z = top that stand on areas of the seat and lean on the back behind them."""
        return [self._leaning(f"back cushion {i + 1}", a, top) for i, a in enumerate(areas)]

    def side_backs(self, areas: list[Area], top: float) -> list[Part]:
        """The same that lean on a wall at their left."""
        parts = [self._leaning(f"side cushion {i + 1}", (-d, -c, a, b), top) for i, (a, b, c, d) in enumerate(areas)]
        return [p.moved(rotation("Z", -90)) for p in parts]

    def _leaning(self, name: str, area: Area, top: float) -> Part:
        x0, x1, front, rear = area
        outline = square((x0, self.seat - SINK), (x1, top), self.softness)
        lying = cushion(name, outline, 0.0, rear - front, self.softness)
        return self._set_up(lying, rear, self.seat, self.lean)

    def pillows(self, count: int, ends: tuple[float, float], front: float, back: float) -> list[Part]:
        """Loose pillows between two x, from the left, the seat's front and what they lean on."""
        if not count:
            return []
        scale = min(1.0, (back - front) / PILLOW_ROOM)
        width, height, thickness = (scale * side for side in PILLOW)
        width = min(width, 0.9 * (ends[1] - ends[0]) / count)
        places = np.linspace(ends[1] - width / 2, ends[0] + width / 2, count)
        foot = self.seat - SINK - PRESS * self.softness * (self.seat - self.deck)
        parts = []
        for i, x in enumerate(places):
            lying = pillow(f"pillow {i + 1}", (float(x), foot + height / 2, 0.0), width, height, thickness)
            parts.append(self._set_up(lying, back - SLANT * height, self.seat, self.lean + SLANT))
        return parts

    @staticmethod
    def _set_up(lying: Part, rear: float, seat: float, lean: float) -> Part:
        """What lies with its top towards +Y, upright, its underside at y = rear on the seat, leaning backwards."""
        x, z, y = lying.vertices.T
        return Part(lying.name, np.stack([x, rear - y + lean * (z - seat), z], 1), lying.faces, lying.convex)
