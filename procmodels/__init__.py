"""Procedural furniture models. A new model is one new file in this folder (or anywhere: load("path/to/my_stool.py")).

A model file defines
    SPACE             a ParamSpace
    build(params)     a list of Parts, standing on z = 0, facing -Y, in any unit
and may define
    live_object(params, material)   a Blender object whose modifier builds the same mesh, its inputs the parameters
    turned_round(params)            if these values look like an object seen from behind, the values of about the same
                                    shape facing the other way; else None
    USUAL_DEPTH                     median and spread of log(depth / width) of real ones: what decides when a single
                                    picture leaves the depth open
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from procmodels.shape import Part, Shape, normalised
from procmodels.space import Params, ParamSpace


class ModelError(ValueError):
    """An unknown or unusable procedural model."""


@dataclass(frozen=True)
class Model:
    """A procedural model: its parameter space, what builds its parts, and what keeps it live in .blend files."""

    space: ParamSpace
    build_parts: Callable[[Params], list[Part]]
    live_object: Callable[[Params, Any], Any] | None = None
    turned_round: Callable[[Params], Params | None] | None = None
    usual_depth: tuple[float, float] | None = None

    @property
    def name(self) -> str:
        return self.space.name

    def build(self, params: Mapping[str, Any]) -> Shape:
        """The shape in the canonical frame. Raises ParameterError for values outside the space."""
        return normalised(self.build_parts(self.space.validate(params)))


def names() -> list[str]:
    """The models of this folder: the files that define a SPACE (found without running them)."""
    files = Path(__file__).parent.glob("*.py")
    return sorted(p.stem for p in files if "\nSPACE = ParamSpace(" in p.read_text())


def load(name: str) -> Model:
    """The model called `name`, or the one in the Python file `name` (which is then run).

    Raises ModelError for a name that is neither, listing the known ones, and for a file without SPACE or build.
    """
    if name in names():
        module = importlib.import_module(f"procmodels.{name}")
    elif name.endswith(".py"):
        module = _module_from(Path(name))
    else:
        raise ModelError(f"there is no model {name!r}; known: {', '.join(names())} (or the path of a model's .py file)")
    space, build = getattr(module, "SPACE", None), getattr(module, "build", None)
    if not isinstance(space, ParamSpace) or not callable(build):
        raise ModelError(f"{name}: a model file defines SPACE (a ParamSpace) and build(params)")
    optional = ("live_object", "turned_round", "USUAL_DEPTH")
    return Model(space, build, *(getattr(module, name, None) for name in optional))


def _module_from(path: Path) -> ModuleType:
    if not path.is_file():
        raise ModelError(f"{path}: no such file")
    spec = importlib.util.spec_from_file_location(f"procmodel_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ModelError(f"{path} cannot be loaded as Python")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
