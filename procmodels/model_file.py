"""Model files of users. Such a file is code that runs; what goes wrong in it is told in one line, with its place.

Nothing holds a file back that ends the process from below (os._exit, a crash of native code).
"""

from __future__ import annotations

import functools
import math
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

import numpy as np

from procmodels.shape import Part, Polygon

MOST_CHECKED = 4096
SECONDS = 60.0  # a file that takes longer to load, or to build a few shapes, is given up


class ModelError(ValueError):
    """An unknown or unusable procedural model: the user's input, by the command's exit codes."""

    exit_code = 2


class _TooLong(BaseException):
    """Not an Exception, so that a file's own handlers rarely swallow it."""


def run(path: Path, source: bytes) -> ModuleType:
    """The module that a file defines; no bytecode is left beside it. Raises ModelError."""
    module = ModuleType(f"procmodel_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # where dataclasses look up the names in their annotations
    with told(path):
        exec(compile(source, str(path), "exec"), module.__dict__)
    return module


@contextmanager
def told(path: Path, line: int | None = None) -> Iterator[None]:
    """Turns whatever the code of a model file raises into a ModelError that says where; `line` if nothing else does."""
    try:
        yield
    except ModelError:
        raise
    except (Exception, SystemExit, _TooLong) as error:
        raise ModelError(f"{_place(error, path, line)}: {_what(error)}") from error


def guarded(function: Callable[..., Any], path: Path) -> Callable[..., Any]:
    """A function of a model file whose errors are ModelErrors that say where."""

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        with told(path):
            return function(*arguments)

    return call


def building(build: Callable[..., Any], path: Path) -> Callable[..., list[Part]]:
    """A model file's `build`, guarded, and what it returns looked at."""

    line = build.__code__.co_firstlineno if hasattr(build, "__code__") else None

    @functools.wraps(build)
    def parts(params: Any) -> list[Part]:
        with told(path, line):
            return _usable(build(params))

    return parts


@contextmanager
def limited() -> Iterator[None]:
    """Ends the block after SECONDS by an exception, where that is possible: in the main thread, where signals are."""

    def end(number: int, frame: FrameType | None) -> None:
        raise _TooLong

    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return
    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, SECONDS, 1.0)  # again every second, in case it is swallowed
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _usable(parts: Any) -> list[Part]:
    """The parts, if they are some that enclose space. Raises ValueError."""
    if not isinstance(parts, list | tuple) or not parts or not all(isinstance(p, Part) for p in parts):
        raise ValueError(f"build(params) must return a list of Parts, not {_short(repr(parts))}")
    sound = []
    for part in parts:
        vertices = np.asarray(part.vertices, float)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not math.isfinite(vertices.sum()):
            raise ValueError(f"the vertices of part {part.name!r} must be (n, 3) numbers, none of them infinite or NaN")
        faces = _checked.get((id(part.faces), len(vertices)))
        if faces is not part.faces:
            faces = _faces(part, len(vertices))
        sound.append(Part(part.name, vertices, faces, part.convex))
    if not np.ptp(np.concatenate([p.vertices for p in sound]), axis=0).any():
        raise ValueError("the parts are a single point")
    return sound


# Faces that were looked at, by their address and the number of vertices: those of parts of one kind are made once.
_checked: dict[tuple[int, int], tuple[Polygon, ...]] = {}


def _faces(part: Part, count: int) -> tuple[Polygon, ...]:
    """The faces of a part of `count` vertices. Raises ValueError unless there are some and all name three or more."""
    tuples = isinstance(part.faces, tuple) and all(isinstance(f, tuple) for f in part.faces)
    faces = part.faces if tuples else tuple(map(tuple, part.faces))
    if not faces or not all(len(f) >= 3 and min(f) >= 0 and max(f) < count for f in faces):
        raise ValueError(f"the faces of part {part.name!r} must name three or more of its {count} vertices")
    if faces is part.faces:
        if len(_checked) >= MOST_CHECKED:
            _checked.clear()
        _checked[id(faces), count] = faces  # it is kept, so that its address is not given to another
    return faces


def _place(error: BaseException, path: Path, line: int | None) -> str:
    """The file with the line in it where the error arose, as far as that is known."""
    lines = [line] + [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines.append(error.lineno)
    return f"{path}, line {lines[-1]}" if lines and lines[-1] else str(path)


def _what(error: BaseException) -> str:
    if isinstance(error, SystemExit):
        return f"the model file ends the program ({_short(f'SystemExit: {error}')}); it may only define things"
    if isinstance(error, _TooLong):
        return f"the model file has not finished after {SECONDS:.0f} s"
    said = error.msg if isinstance(error, SyntaxError) else str(error)
    return _short(f"{type(error).__name__}: {said}" if said else type(error).__name__)


def _short(text: str) -> str:
    """One line of at most 200 characters."""
    text = " ".join(text.split())
    return text if len(text) <= 200 else text[:197] + "..."
