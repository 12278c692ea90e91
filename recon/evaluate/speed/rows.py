"""Rows of `speed`: two times side by side, the options of a run, and how the sides take turns."""

from __future__ import annotations

import json
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from nnproc.latent_fit import FitOptions
from recon.evaluate.rows import read_json_rows

GROWTH, LIMIT, STAGE = "growth, ", "limit, ", "stage, "  # how the rows of each kind begin


@dataclass(frozen=True)
class SpeedOptions:
    """What is measured and how often. Sizes are in pixels along a side of an image."""

    repeats: int = 5
    threads: int = 1  # of torch, on both sides; two that wait for each other would count their waiting
    least: float = 0.1  # seconds: a quicker call is made again within its turn
    size: int = 128  # of the four views; at most 128
    samples: tuple[int, ...] = (96, 150)  # a ray, of ray marching; the last for whole fits
    fit: FitOptions = field(default_factory=lambda: FitOptions(bank=0, starts=4, keep=2, prune_at=4, steps=8))
    published_steps: int = 5  # measured of the published protocol's 100
    latents: int = 8  # of one gradient step
    view_size: int = 64
    views: tuple[int, ...] = (1, 4, 16, 50, 100, 200)
    sides: tuple[int, ...] = (32, 64, 128, 256)
    starts: tuple[int, ...] = (1, 4, 8, 16, 32)
    grids: tuple[int, ...] = (32, 64, 128)
    jacobian_views: int = 32  # as many, and as large, as refinement compares
    jacobian_size: int = 112
    copied_mb: int = 256  # far more than any cache holds
    matrix: int = 2048  # side of the matrices that are multiplied
    command: bool = True  # also run the whole command on the shipped photos
    work: Path = Path(".cache/evaluate")  # holds the bank of known shapes
    data: Path = Path(".cache/data")


def quick(options: SpeedOptions) -> SpeedOptions:
    """The same comparisons in under a minute: fewer repeats, nothing large, no photos."""
    return replace(
        options,
        repeats=min(options.repeats, 2),
        fit=replace(options.fit, starts=1, keep=1, steps=3),
        published_steps=2,
        views=options.views[:3],
        sides=options.sides[:3],
        command=False,
    )


@dataclass(frozen=True)
class SpeedRow:
    """Two times side by side. memory_mb: arrays that one step of `what` holds, where that was counted."""

    what: str
    against: str
    seconds: float
    against_seconds: float
    memory_mb: float | None = None

    @property
    def ratio(self) -> float:
        """How many times as long `against` takes."""
        return self.against_seconds / self.seconds

    @staticmethod
    def from_json(values: dict[str, Any]) -> SpeedRow:
        """The inverse of as_json."""
        return SpeedRow(**{k: v for k, v in values.items() if k != "ratio"})

    def as_json(self) -> dict[str, Any]:
        """The row as written to files; memory_mb only where there is one."""
        values = {"what": self.what, "against": self.against, "ratio": self.ratio}
        values |= {"seconds": self.seconds, "against_seconds": self.against_seconds}
        return values if self.memory_mb is None else {**values, "memory_mb": self.memory_mb}


@dataclass(frozen=True)
class Side:
    """One side of a comparison: a call, what its time is multiplied with, and what warms it up (itself)."""

    call: Callable[[], object]
    scale: float = 1.0
    warm: Callable[[], object] | None = None


def in_turn(sides: Sequence[Side], repeats: int, least: float) -> list[float]:
    """Median seconds of processor time of every side. A turn lasts at least `least` seconds; a first round warms up.

    The median is over turns, each the mean of its calls: a quick call must not outvote the load of a whole turn.
    """
    for side in sides:
        (side.warm or side.call)()
    turns: list[list[float]] = [[] for _ in sides]
    for _ in range(repeats):
        for side, taken in zip(sides, turns, strict=True):
            calls, started = 0, time.process_time()
            while calls == 0 or time.process_time() - started < least:
                side.call()
                calls += 1
            taken.append(side.scale * (time.process_time() - started) / calls)
    return [statistics.median(t) for t in turns]


def write_rows(rows: Sequence[SpeedRow], path: Path) -> None:
    """A list of {what, against, ratio, seconds, against_seconds[, memory_mb]}; written whole or not at all."""
    partial = path.with_suffix(path.suffix + ".partial")
    partial.parent.mkdir(parents=True, exist_ok=True)
    partial.write_text(json.dumps([r.as_json() for r in rows], indent=1) + "\n")
    partial.replace(path)


def read_rows(path: Path) -> list[SpeedRow]:
    """The inverse of write_rows."""
    return read_json_rows(path, SpeedRow.from_json)
