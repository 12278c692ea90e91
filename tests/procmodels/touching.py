"""Whether the parts of a shape hold together."""

from __future__ import annotations

from collections.abc import Sequence

from procmodels.shape import Part


def all_touch(parts: Sequence[Part], slack: float = 2e-3) -> bool:
    """Whether every part is reached from the first over touching parts: bounding boxes grown by `slack` must meet."""
    boxes = [(p.vertices.min(0) - slack, p.vertices.max(0) + slack) for p in parts]
    reached, todo = {0}, [0]
    while todo:
        low, high = boxes[todo.pop()]
        near = {i for i, (a, b) in enumerate(boxes) if (a <= high).all() and (b >= low).all()} - reached
        reached |= near
        todo += near
    return len(reached) == len(boxes)
