"""Procedural furniture models. A new model is one new file in this folder (or anywhere: load("path/to/my_stool.py")).

A model file is code that runs, with all the rights of whoever runs it. It defines
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

import functools
import hashlib
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procmodels import model_file
from procmodels.model_file import ModelError
from procmodels.shape import Part, Shape, normalised
from procmodels.space import Params, ParamSpace

__all__ = ["Model", "ModelError", "load", "names"]
TRIALS = 8  # random shapes that a user's model must build before it is used


@dataclass(frozen=True)
class Model:
    """A procedural model: its parameter space, what builds its parts, and what keeps it live in .blend files.

    code  digest of the source that builds its shapes: results made by other source are stale
    """

    space: ParamSpace
    build_parts: Callable[[Params], list[Part]]
    live_object: Callable[[Params, Any], Any] | None = None
    turned_round: Callable[[Params], Params | None] | None = None
    usual_depth: tuple[float, float] | None = None
    code: str = ""

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

    Raises ModelError for a name that is neither, listing the known ones, for a file without SPACE or build, and with
    file and line for one that fails.
    """
    if name in names():
        return _model(name, vars(importlib.import_module(f"procmodels.{name}")), _own_code())
    if not name.endswith(".py"):
        raise ModelError(f"there is no model {name!r}; known: {', '.join(names())} (or the path of a model's .py file)")
    path = Path(name)
    try:
        if not path.is_file():
            raise ModelError(f"{path}: no such file")
        source = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{path} cannot be read: {error.strerror or error}") from error
    with model_file.told(path), model_file.limited():
        return _from_file(path, source)


def _model(name: str, defined: Mapping[str, Any], code: str) -> Model:
    """The model of what its file defined."""
    space, build = defined.get("SPACE"), defined.get("build")
    if not isinstance(space, ParamSpace) or not callable(build):
        raise ModelError(f"{name}: a model file defines SPACE (a ParamSpace) and build(params)")
    live_object, turned_round, depth = (defined.get(n) for n in ("live_object", "turned_round", "USUAL_DEPTH"))
    return Model(space, build, live_object, turned_round, depth, code)


def _from_file(path: Path, source: bytes) -> Model:
    """A user's model, its functions guarded, which builds a few random shapes first."""
    defined = dict(vars(model_file.run(path, source)))
    for function in ("live_object", "turned_round"):
        if callable(defined.get(function)):
            defined[function] = model_file.guarded(defined[function], path)
    if callable(defined.get("build")):
        defined["build"] = model_file.building(defined["build"], path)
    model = _model(str(path), defined, hashlib.sha256(source + _own_code().encode()).hexdigest())
    rng = np.random.default_rng(0)
    for _ in range(TRIALS):
        model.build(model.space.sample(rng))
    return model


@functools.cache
def _own_code() -> str:
    """Digest of this package's sources."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(p.read_bytes() for p in files)).hexdigest()
