"""Rows of an evaluation: what was measured, the value, the bound, and whether it holds."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import Any, TextIO, TypeVar

from recon.scene import InputError
from recon.system.user_files import read_json

T = TypeVar("T")


@dataclass(frozen=True)
class Row:
    """`bound` reads like ">= 0.9" or "<= 150"; None for a figure that is told and not bounded."""

    what: str
    value: float
    bound: str | None = None

    @property
    def holds(self) -> bool:
        """Whether the value meets the bound."""
        if self.bound is None:
            return True
        relation, number = self.bound.split()
        return self.value >= float(number) if relation == ">=" else self.value <= float(number)


def machine() -> str:
    """The machine and date a table was measured on."""
    return f"{os.cpu_count()} cores, {_processor()}, {date.today().isoformat()}"


def _processor() -> str:
    """The processor's name where the system tells it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def print_table(rows: list[Row], to: TextIO) -> None:
    """A Markdown table."""
    to.write(f"Measured on {machine()}.\n\n| what | value | bound | holds |\n|---|---|---|---|\n")
    for row in rows:
        verdict = "" if row.bound is None else ("yes" if row.holds else "NO")
        to.write(f"| {row.what} | {row.value:.4g} | {row.bound or ''} | {verdict} |\n")


def write_json(rows: list[Row], path: Path) -> None:
    """A list of {what, value, bound, holds}; written whole or not at all."""
    partial = path.with_suffix(path.suffix + ".partial")
    partial.parent.mkdir(parents=True, exist_ok=True)
    partial.write_text(json.dumps([{**asdict(r), "holds": r.holds} for r in rows], indent=1) + "\n")
    partial.replace(path)


def read_json_rows(path: Path, from_json: Callable[[dict[str, Any]], T]) -> list[T]:
    """The rows of a table that was written as JSON. Raises InputError when the file holds others, or none."""
    try:
        return [from_json(values) for values in read_json(path, "rows of this table")]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path} does not hold rows of this table ({type(error).__name__}: {error})") from error
