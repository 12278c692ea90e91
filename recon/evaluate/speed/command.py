"""How fast it is: our ways beside the usual and the published ones, growth with size, shares of the machine's limits.

    python -m recon.evaluate speed [--quick] [--repeats N] [--json docs/results/speed.json]

Everything is measured in one run on one machine. The sides of a comparison take turns within every repeat (A, B, A, B,
...), so that other work on the machine slows both, and a figure is the median of its repeats. Times are processor times
with one thread, which other work changes least; only the command's stages are told by the clock.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TextIO

import torch
from tqdm import tqdm

from recon.evaluate.rows import machine
from recon.evaluate.speed import derivatives, growth, limits, pairs
from recon.evaluate.speed.rows import GROWTH, STAGE, SpeedOptions, SpeedRow

HEAD = "| what | against | times as fast | s | s against | MB |\n|---|---|---|---|---|---|\n"
PARTS = (*pairs.PARTS, *derivatives.PARTS, *growth.PARTS, *limits.PARTS)


def run(options: SpeedOptions) -> Iterator[SpeedRow]:
    """All rows, one after another. Raises ModelError, WeightsError, and ReconstructionError of the command."""
    parts = (*PARTS, limits.stages) if options.command else PARTS
    subject = pairs.subject(options)
    threads = torch.get_num_threads()
    torch.set_num_threads(options.threads)
    try:
        for part in tqdm(parts, desc="speed", unit="part", disable=None):
            yield from part(subject, options)
    finally:
        torch.set_num_threads(threads)


def heading(options: SpeedOptions) -> str:
    """The machine, the date and how times were taken, as a sentence."""
    return f"Measured on {machine()}; processor time, {options.threads} thread(s), median of {options.repeats}."


def markdown(rows: Sequence[SpeedRow]) -> str:
    """The rows as a table."""
    return HEAD + "".join(map(_line, rows))


def _line(row: SpeedRow) -> str:
    memory = "" if row.memory_mb is None else f"{row.memory_mb:.0f}"
    figures = (_three_digits(x) for x in (row.ratio, row.seconds, row.against_seconds))
    return "| " + " | ".join([row.what, row.against, *figures, memory]) + " |\n"


def compact(rows: Sequence[SpeedRow]) -> str:
    """The table of docs/results.md: every comparison and limit, of each kind of growth the largest; no stages."""
    kept = []
    for row, after in zip(rows, [*rows[1:], None], strict=True):
        last = after is None or after.against != row.against
        if not row.what.startswith(STAGE) and (last or not row.what.startswith(GROWTH)):
            kept.append(row)
    return markdown(kept)


def print_rows(rows: Iterable[SpeedRow], options: SpeedOptions, to: TextIO) -> list[SpeedRow]:
    """The whole table under its heading, each row as soon as it is measured; returns the rows."""
    to.write(f"{heading(options)}\n\n{HEAD}")
    kept = []
    for row in rows:
        to.write(_line(row))
        to.flush()
        kept.append(row)
    return kept


def _three_digits(value: float) -> str:
    """Three significant digits, never in powers of ten."""
    return f"{value:.0f}" if value >= 100 else f"{value:#.3g}" if value >= 1e-3 else f"{value:.6f}"
