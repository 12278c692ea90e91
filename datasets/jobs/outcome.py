"""What becomes of a job, and what does jobs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

Job = Any  # what JSON knows


class JobError(Exception):
    """Jobs cannot be done at all: the message says why, and what to do."""

    exit_code = 2


@dataclass(frozen=True)
class Outcome:
    """number  of the job, from 0 in the order they were given
    value    what the function returned; None when it never did
    error    what the last accident was, None when the job was done
    details  the traceback of that accident, where there is one
    tries    how often it was begun
    """

    number: int
    value: Any = None
    error: str | None = None
    details: str = ""
    tries: int = 1


class Backend(Protocol):
    """What does jobs."""

    def map(self, function: Callable[[Any], Any], jobs: Iterable[Job]) -> Iterator[Outcome]:
        """The outcome of every job, as they are done. Raises JobError when nothing can be done."""
        ...


def in_order(outcomes: Iterable[Outcome]) -> Iterator[Outcome]:
    """The outcomes by number: those that come early are held back."""
    early: dict[int, Outcome] = {}
    wanted = 0
    for outcome in outcomes:
        early[outcome.number] = outcome
        while wanted in early:
            yield early.pop(wanted)
            wanted += 1


def name_of(function: Callable[[Any], Any]) -> str:
    """ "module:function", by which a worker finds it. Raises JobError for what no other process can import."""
    module = function.__module__
    if module == "__main__":  # python -m PACKAGE.MODULE: a worker finds it under its own name
        spec = getattr(sys.modules["__main__"], "__spec__", None)
        module = spec.name if spec is not None else module
    name = getattr(function, "__qualname__", "")
    if module == "__main__" or not name.isidentifier():
        raise JobError(f"{name or function} of {module} cannot be imported by a worker: use a function of a module")
    return f"{module}:{name}"
