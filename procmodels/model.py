"""What a class is: a parameter space, what builds its parts, and the network's weights that lie beside its file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procmodels.shape import Part, Shape, normalised
from procmodels.space import Params, ParamSpace


@dataclass(frozen=True)
class Model:
    """A procedural model: its parameter space, what builds its parts, and what keeps it live in .blend files.

    name          what the user asks for: "chair", "paper/chair", or the stem of a file
    weights       where its network lies, or is put by training: beside the model's file
    live_object   (params, material) -> a Blender object whose modifier builds the same mesh, its inputs the parameters
    turned_round  if these values look like an object seen from behind, the values of about the same shape facing the
                  other way; else None
    usual_depth   median and spread of log(depth / width) of real ones
    code          digest of the source that builds its shapes: results made by other source are stale
    """

    name: str
    space: ParamSpace
    build_parts: Callable[[Params], list[Part]]
    weights: Path
    live_object: Callable[[Params, Any], Any] | None = None
    turned_round: Callable[[Params], Params | None] | None = None
    usual_depth: tuple[float, float] | None = None
    code: str = ""

    def build(self, params: Mapping[str, Any]) -> Shape:
        """The shape in the canonical frame. Raises ParameterError for values outside the space."""
        return normalised(self.build_parts(self.space.validate(params)))

    def lengths(self, params: Mapping[str, Any], metres_per_unit: float) -> dict[str, float]:
        """Metres of the active parameters that are lengths, where a canonical unit is so many metres long."""
        values = self.space.validate(params)
        vertices = np.concatenate([p.vertices for p in self.build_parts(values)])
        return self.space.metres(values, metres_per_unit / float(np.ptp(vertices, axis=0).max()))
