"""Stages of a run: finished ones whose options and inputs are unchanged are taken from the results folder."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from recon.scene import InputError
from recon.store import Store
from recon.system.digests import code_version, digest

log = logging.getLogger("recon")
LAST = "outputs"  # which is always written
T = TypeVar("T")


@dataclass(frozen=True)
class Redo:
    """Which finished stages are computed again: all of them, or those from `start` on."""

    force: bool = False
    start: str | None = None

    def check(self, names: tuple[str, ...]) -> None:
        """Raise InputError for a stage that this kind of input does not have."""
        if self.start is not None and self.start not in names:
            raise InputError(f"there is no stage {self.start!r} for this input; stages: {', '.join(names)}")


class Stages:
    """Runs stages through the store; a stage's key covers its options, and the keys and results of all before it.

    names    of all stages in order, LAST at the end
    known    the dataclasses that results are made of
    inputs   digests and options that everything depends on, beside the code's version
    seconds  what computing each stage took, by name
    """

    def __init__(
        self, work: Path, names: tuple[str, ...], known: Iterable[type], inputs: list[Any], redo: Redo
    ) -> None:
        self.names, self.store = names, Store(work, known)
        self.seconds: dict[str, float] = {}
        self.chain = digest(inputs, code_version())
        if redo.force or redo.start:
            self.store.forget(names[0 if redo.force else names.index(str(redo.start)) :])

    def run(self, name: str, options: Any, compute: Callable[[], T]) -> T:
        """One stage's result, computed or taken from the store."""
        self.chain = digest(self.chain, name, options if isinstance(options, list) else [options])
        if (stored := self.store.load(name, self.chain)) is not None:
            log.info("%s: unchanged, skipped", self._place(name))
            self.seconds[name], self.chain = stored.seconds, digest(self.chain, stored.content)
            return stored.result
        log.info("%s", self._place(name))
        self.store.forget([name])  # whose files are about to be replaced
        started = time.monotonic()
        result = compute()
        self.seconds[name] = round(time.monotonic() - started, 2)
        self.chain = digest(self.chain, self.store.save(name, self.chain, result, self.seconds[name]))
        return result

    def last(self) -> None:
        """Say that the outputs are being written."""
        log.info("%s", self._place(LAST))

    def _place(self, name: str) -> str:
        return f"[{self.names.index(name) + 1}/{len(self.names)}] {name}"
