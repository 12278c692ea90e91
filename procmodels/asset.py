"""A built shape with all that files for other programs say about it.

Files hold the object standing on the floor plane, in metres when its real size is known and otherwise with its longest
side 1. Axes: .blend as in the canonical frame (X right, faces -Y, Z up); GLB as glTF demands, and OBJ as its readers
assume (Y up, the object faces +Z).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from procmodels.look import Look
from procmodels.shape import Shape
from procmodels.space import Params, ParamSpace

COLOUR = (0.60, 0.43, 0.27)  # linear RGB of a shape without a look: light oak
ROUGHNESS = 0.6
Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class Asset:
    """A shape with all that the files say about it.

    metres_per_unit       metres per canonical unit, None when the real size is not known
    world_from_canonical  (4, 4) float similarity into the frame of the photos' cameras, None without photos
    live_object           the model's function of that name, None when it has none
    lengths               metres of the parameters that are lengths and do something, by name
    look                  colours and picture, None: one plain material
    """

    shape: Shape
    space: ParamSpace
    params: Params
    metres_per_unit: float | None = None
    world_from_canonical: np.ndarray | None = None
    live_object: Callable[[Params, Any], Any] | None = None
    lengths: Mapping[str, float] = field(default_factory=dict)
    look: Look | None = None

    def __post_init__(self) -> None:
        if self.look is not None:
            self.look.check(self.shape.parts)

    @property
    def unit(self) -> str:
        return "longest side = 1" if self.metres_per_unit is None else "metres"

    @property
    def colours(self) -> np.ndarray:
        """(P, 3) float, linear RGB of every part."""
        return np.tile(COLOUR, (len(self.shape.parts), 1)) if self.look is None else self.look.colours

    @property
    def mesh_from_canonical(self) -> np.ndarray:
        """(4, 4) similarity into the frame of the files, before glTF's change of axes."""
        matrix = np.diag([self.metres_per_unit or 1.0] * 3 + [1.0])
        matrix[2, 3] = -matrix[2, 2] * self.shape.bounds()[0, 2]
        return matrix
