"""Small models for tests of the search: boards in a row, as many parameters as wanted, built in a blink."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from procmodels import Model
from procmodels.shape import Part
from procmodels.space import Choice, Flag, Params, ParamSpace, Scalar

FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def board(name: str, low: tuple[float, float, float], high: tuple[float, float, float]) -> Part:
    """A box between two corners."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    return Part(name, np.array(low) + corners * (np.array(high) - np.array(low)), FACES, convex=True)


def boards(scalars: int, flags: int = 0, kinds: int = 0) -> Model:
    """So many boards in a row, each as high as its scalar; flags add a knob on the floor before a board, and the one
    choice of `kinds` shapes a rail behind them."""
    heights = tuple(Scalar(f"height_{i}", 0.3, 1.0, 8) for i in range(scalars))
    knobs = tuple(Flag(f"knob_{i}") for i in range(flags))
    rail = (Choice("rail", tuple(f"kind_{i}" for i in range(kinds))),) if kinds else ()

    def build(params: Params) -> list[Part]:
        count = max(scalars, flags, 2)
        parts = [board("floor", (0, -0.3, -0.05), (1.2, 0.5, 0))]
        for i in range(count):
            x = (i + 0.1) / count
            top = float(params.get(f"height_{i}", 0.6))
            parts.append(board(f"board {i}", (x, 0, 0), (x + 0.7 / count, 0.1, top)))
            if params.get(f"knob_{i}"):
                parts.append(board(f"knob {i}", (x, -0.25, 0), (x + 0.5 / count, -0.15, 0.12)))
        if kinds:
            k = int(str(params["rail"]).split("_")[1])
            parts.append(board("rail", (0, 0.3, 0), ((k + 1) / kinds, 0.4, 0.2)))
        return parts

    return Model("boards", ParamSpace("boards", (*heights, *knobs, *rail)), build, Path("boards.safetensors"))
