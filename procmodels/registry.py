"""Which models there are, and where: a new class is one new file in `classes/`, its weights and their card beside it.

`paper/` holds the five spaces of the paper's Table 1. A class that `classes/` lacks, or has no network for yet, is the
paper's; its file can be loaded by its path.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import pkgutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from procmodels import model_file
from procmodels.model import Model
from procmodels.model_file import ModelError
from procmodels.space import ParamSpace

HERE = Path(__file__).parent
PAPER = "paper/"  # before the names of the paper's classes
TRIALS = 8  # random shapes that a user's model must build before it is used


def names() -> list[str]:
    """The classes that a user may want, one of each kind; `paper/NAME` is known to `load` as well."""
    return sorted({*_class_names(), *paper_names()})


def paper_names() -> list[str]:
    """The classes of the paper, without the folder's name."""
    return _own("paper")


def _class_names() -> list[str]:
    """The richer classes: of those that the paper has too, the ones whose networks are trained."""
    return [n for n in _own("classes") if n not in paper_names() or weights_of(HERE / "classes" / f"{n}.py").is_file()]


def load(name: str) -> Model:
    """The model called `name`, or the one in the Python file `name` (which is then run).

    Raises ModelError for a name that is neither, listing the known ones, for a file without SPACE or build, and with
    file and line for one that fails.
    """
    if name in _class_names():
        return _shipped(name, "classes", name)
    short = name.removeprefix(PAPER)
    if short in paper_names():
        return _shipped(name, "paper", short)
    if not name.endswith(".py"):
        known = ", ".join([*names(), *(PAPER + n for n in paper_names())])
        raise ModelError(f"there is no model {name!r}; known: {known} (or the path of a model's .py file)")
    path = Path(name)
    try:
        if not path.is_file():
            raise ModelError(f"{path}: no such file")
        source = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{path} cannot be read: {error.strerror or error}") from error
    with model_file.told(path), model_file.limited():
        return _from_file(path, source)


def weights_of(file: Path) -> Path:
    """Where the network of a model file lies: stool.safetensors beside stool.py."""
    return file.with_suffix(".safetensors")


@functools.cache
def _own(folder: str) -> list[str]:
    """The modules of one of this package's folders that define a model."""
    if not (HERE / folder).is_dir():
        return []
    found = [m.name for m in pkgutil.iter_modules([str(HERE / folder)])]
    return sorted(n for n in found if hasattr(importlib.import_module(f"procmodels.{folder}.{n}"), "SPACE"))


def _shipped(name: str, folder: str, module: str) -> Model:
    defined = vars(importlib.import_module(f"procmodels.{folder}.{module}"))
    return _model(name, HERE / folder / f"{module}.py", defined, _own_code())


def _model(name: str, file: Path, defined: Mapping[str, Any], code: str) -> Model:
    """The model of what its file defined."""
    space, build = defined.get("SPACE"), defined.get("build")
    if not isinstance(space, ParamSpace) or not callable(build):
        raise ModelError(f"{file}: a model file defines SPACE (a ParamSpace) and build(params)")
    live_object, turned_round, depth = (defined.get(n) for n in ("live_object", "turned_round", "USUAL_DEPTH"))
    return Model(name, space, build, weights_of(file), live_object, turned_round, depth, code)


def _from_file(path: Path, source: bytes) -> Model:
    """A user's model, its functions guarded, which builds a few random shapes first."""
    defined = dict(vars(model_file.run(path, source)))
    for function in ("live_object", "turned_round"):
        if callable(defined.get(function)):
            defined[function] = model_file.guarded(defined[function], path)
    if callable(defined.get("build")):
        defined["build"] = model_file.building(defined["build"], path)
    code = hashlib.sha256(source + _own_code().encode()).hexdigest()
    space = defined.get("SPACE")
    model = _model(space.name if isinstance(space, ParamSpace) else path.stem, path, defined, code)
    rng = np.random.default_rng(0)
    for _ in range(TRIALS):
        model.build(model.space.sample(rng))
    return model


@functools.cache
def _own_code() -> str:
    """Digest of this package's sources."""
    files = sorted(HERE.rglob("*.py"))
    return hashlib.sha256(b"".join(p.read_bytes() for p in files)).hexdigest()
