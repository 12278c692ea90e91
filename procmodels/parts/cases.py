"""Cases of cupboards and bookcases: sides, top, bottom and back, what they stand on; and racks of boards on posts.

All stand on z = 0; the front is towards -Y, left is +X.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from procmodels.parts import legs
from procmodels.parts.legs import Leg, both
from procmodels.parts.primitives import Plane, box, upright
from procmodels.parts.sizes import inward, limited
from procmodels.shape import Part

Span = tuple[float, float]
TAPER = 0.75  # of legs: foot beside upper end
FRAME, BOARD, LEG = 0.12, 0.08, 0.12  # the thickest of each


@dataclass(frozen=True)
class Case:
    """A box of boards, open at the front; lengths in the model's units.

    half    half its outer width
    y       its front edges and its rear
    face    y of what is nearest to the viewer: fronts, or the same as the front edges
    low     z of the bottom board's underside; to_floor: the sides go on to the floor
    high    z of the topmost board's upper face; sides: z of their upper ends if they rise above it, else None
    frame   thickness of sides, top and bottom
    back    whether there is one
    split   faces of the board between its lower and its upper part, or None
    step    how far the upper part's front lies behind the lower one's
    """

    half: float
    y: Span
    face: float
    low: float
    to_floor: bool
    high: float
    sides: float | None
    frame: float
    back: bool
    split: Span | None
    step: float

    @property
    def inner(self) -> Span:
        """x between the sides."""
        return self.frame - self.half, self.half - self.frame

    @property
    def panel(self) -> float:
        """Thickness of the back; 0: none."""
        return min(0.4 * self.frame, 0.1 * (self.y[1] - self.y[0] - self.step)) if self.back else 0.0

    @property
    def rear(self) -> float:
        """y of the rear edges of boards."""
        return self.y[1] - self.panel

    @property
    def under_top(self) -> float:
        """z of the top board's underside."""
        return self.high - self.frame

    def rooms(self) -> list[Span]:
        """z of the room in the lower and the upper part, or of the only one."""
        low, high = self.low + self.frame, self.under_top
        return [(low, high)] if self.split is None else [(low, self.split[0]), (self.split[1], high)]

    def fields(self) -> list[Span]:
        """z that fronts cover, of the same parts: they lie before the edges of boards, half of one that two share."""
        if self.split is None:
            return [(self.low, self.under_top)]
        low, high = self.split if self.step else (sum(self.split) / 2,) * 2
        return [(self.low, low), (high, self.under_top)]

    def parts(self, overhang: float) -> list[Part]:
        """The boards; the top reaches beyond sides and fronts by `overhang`."""
        x, (front, rear), (left, right) = self.half, self.y, self.inner
        start = 0.0 if self.to_floor else self.low
        end = self.sides or self.under_top
        bottom = box("bottom", (left, front, self.low), (right, rear, self.low + self.frame))
        if self.sides:
            top = box("top", (left, front + self.step, self.under_top), (right, rear, self.high))
        else:
            low = (-x - overhang, self.face + self.step - overhang, self.under_top)
            top = box("top", low, (x + overhang, rear, self.high))
        parts = [bottom, top, *self._sides(start, end)]
        if self.split:
            low, high = (left, front, self.split[0]), (right, self.rear, self.split[1])
            if self.step:
                low, high = (-x, self.face, self.split[0]), (x, rear, self.split[1])
            parts.append(box("counter" if self.step else "board between", low, high))
        if self.back:
            # A counter goes through to the rear.
            spans = self.rooms() if self.split and self.step else [(self.low + self.frame, self.under_top)]
            for name, (a, b) in zip(("back", "back above"), spans, strict=False):
                parts.append(box(name, (left, self.rear, a), (right, rear, b)))
        return parts

    def _sides(self, start: float, end: float) -> list[Part]:
        (front, rear), x = self.y, self.half
        if not (self.split and self.step):
            return both("side {}", box("", (x - self.frame, front, start), (x, rear, end)))
        lower = box("", (x - self.frame, front, start), (x, rear, self.split[0]))
        upper = box("", (x - self.frame, front + self.step, self.split[1]), (x, rear, end))
        return both("side {}", lower) + both("upper side {}", upper)


def plinth(case: Case, inset: float) -> list[Part]:
    """A box below the case, in from its front and sides by a share of the way to the middle."""
    x, deep = case.half * (1 - inset), case.y[1] - case.y[0]
    return [box("plinth", (-x, case.y[0] + inset * deep / 2, 0), (x, case.y[1], case.low))]


def feet(case: Case, size: float, inset: float, splay: float) -> list[Part]:
    """Four legs below the case, in from its corners by a share of the way to the middle; splay in degrees."""
    middle, deep = (case.y[0] + case.y[1]) / 2, (case.y[1] - case.y[0]) / 2
    size = limited(size, 0.8 * min(case.half, deep), LEG)
    x, y = inward(case.half, size, inset), inward(deep, size, inset)
    under, lean = Plane(case.low), math.tan(math.radians(splay))
    front, rear = (Leg.under(under, (x, s * y), (lean, lean), size, TAPER) for s in (-1, 1))
    place = np.eye(4)
    place[1, 3] = middle
    return [part.moved(place) for part in legs.four(front, rear, under)]


def levels(z: Span, weights: list[float], board: float) -> list[Span]:
    """Openings between boards in the span, from the lowest, as high as their weights say."""
    board = limited(board, 0.5 * (z[1] - z[0]) / len(weights), BOARD)
    room = z[1] - z[0] - board * (len(weights) - 1)
    out, at = [], z[0]
    for w in weights:
        out.append((at, at + room * w / sum(weights)))
        at = out[-1][1] + board
    return out


@dataclass(frozen=True)
class Rack:
    """Boards one above the other, held by posts at their corners.

    width, depth  outer; lean: how much nearer to the rear the front is at the top, of the depth
    size          thickness of the posts
    z             the underside of the lowest board and the upper face of the highest
    """

    width: float
    depth: float
    lean: float
    size: float
    z: Span

    def front(self, z: float) -> float:
        """y of the front at a height."""
        return self.depth * (self.lean * z - 0.5)

    def boards(self, weights: list[float], board: float) -> list[Span]:
        """Lower and upper faces, one more than there are openings."""
        thick = limited(board, 0.4 * (self.z[1] - self.z[0]) / len(weights), BOARD)
        gaps = levels((self.z[0] + thick, self.z[1] - thick), weights, thick)
        edges = [self.z[0], *(z for gap in gaps for z in gap), self.z[1]]
        return [(edges[i], edges[i + 1]) for i in range(0, len(edges), 2)]

    def parts(self, boards: list[Span], back: bool) -> list[Part]:
        """Boards and posts, perhaps with a back between the rear ones."""
        half, x, rear = self.size / 2, (self.width - self.size) / 2, (self.depth - self.size) / 2
        section = (self.size, self.size)
        foot, head = ((x, self.front(z) + half) for z in (0.0, 1.0))
        parts = both("post front {}", upright("", foot, head, section, section, high=Plane(1.0)))
        parts += both("post rear {}", upright("", (x, rear), (x, rear), section, section, high=Plane(1.0)))
        for i, (low, high) in enumerate(boards):
            parts.append(box(f"board {i + 1}", (-x, self.front(low) + half, low), (x, rear, high)))
        if back:
            thick = 0.2 * self.size
            parts.append(box("back", (-x, rear, self.z[0]), (x, rear + thick, self.z[1])))
        return parts
