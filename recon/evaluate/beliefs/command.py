"""python -m recon.evaluate beliefs: what an answer may be sure of, measured on labelled objects; sets the table.

    python -m recon.evaluate beliefs --class chair --data ../shared/data/ikea_dev --data ../shared/data/pix3d_dev

Debian's catalogues (package sweethome3d-furniture) are looked at where they lie, beside --data. A mesh takes about 10 s
of processor time, a mask 50 s; every row is kept at once, and a run that is started again goes on.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from procmodels import Model
from recon.evaluate.beliefs import fit, gather
from recon.evaluate.beliefs.gather import GatherOptions
from recon.evaluate.beliefs.rows import BeliefRow
from recon.evaluate.rows import Row
from recon.fitting.beliefs import DEFAULT, DENIED, DOUBTED, FILE, Beliefs
from recon.scene import InputError
from recon.system.whole_files import write_bytes

SURE = 0.9  # stated chance from which a choice is one of the sure ones
FEWEST = 8  # objects of a kind, fewer teach nothing


@dataclass(frozen=True)
class BeliefOptions:
    """What is looked at, and where the table lies; table None measures alone, default: whether other classes go by
    this one."""

    gather: GatherOptions
    table: Path | None = FILE
    default: bool = False


def run(model: Model, options: BeliefOptions) -> list[Row]:
    """Gather, fit, write the table (unless it is None); rows of what was stated of objects that did not teach it."""
    kinds = gather.possible(model, options.gather.kinds)
    found = gather.run(model, replace(options.gather, kinds=kinds))
    by_kind = {kind: [r for r in found if r.kind == kind] for kind in kinds}
    by_kind = {kind: rows for kind, rows in by_kind.items() if len(rows) >= FEWEST}
    if not by_kind:
        raise InputError(f"fewer than {FEWEST} objects were looked at of any kind of input; --limit wants more")
    if options.table is not None:
        learnt = {kind: fit.fitted(rows, kind) for kind, rows in by_kind.items()}
        write(options.table, model.space.hash, model.name, learnt)
        if options.default:
            write(
                options.table, DEFAULT, DEFAULT, {kind: fit.fitted(rows, kind, False) for kind, rows in by_kind.items()}
            )
    return [row for kind, rows in by_kind.items() for row in summary(kind, rows)]


def summary(kind: str, rows: Sequence[BeliefRow]) -> list[Row]:
    """What is stated of real objects by beliefs that others taught, and how often it is right."""
    stated = [(r, chances, sure) for r, chances, sure in fit.checked(rows) if not r.own]
    told = [(chances[n], t.right) for r, chances, _ in stated for n, t in r.choices.items() if t.right is not None]
    sure_ones = [right for chance, right in told if chance >= SURE]
    others = [sure < DENIED for r, _, sure in stated if not r.belongs]
    mine = [sure >= DOUBTED for r, _, sure in stated if r.belongs]
    out = [
        Row(f"{kind}: choices with a label that were stated", len(told)),
        Row(f"{kind}: share of them that is right", _mean([bool(r) for _, r in told])),
        Row(f"{kind}: stated with {SURE:.0%} or more", len(sure_ones)),
        Row(f"{kind}: share of these that is right", _mean([bool(r) for r in sure_ones]), ">= 0.85"),
        Row(f"{kind}: {len(others)} things that are none, share with less than {DENIED}", _mean(others), ">= 0.95"),
        Row(f"{kind}: {len(mine)} that are one, share with {DOUBTED} or more", _mean(mine), ">= 0.9"),
    ]
    return [row for row in out if row.value == row.value]


def write(file: Path, key: str, name: str, learnt: dict[str, Beliefs]) -> None:
    """Put what was learnt of a class into the table, in place of what it held of these kinds of input."""
    table = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {"classes": {}}
    kinds = table["classes"].setdefault(key, {"name": name, "kinds": {}})["kinds"]
    kinds |= {kind: _rounded(b.as_json()) for kind, b in learnt.items()}
    write_bytes(file, (json.dumps(table, indent=1) + "\n").encode())


def _rounded(values: dict[str, Any]) -> dict[str, Any]:
    return {k: {n: round(w, 4) for n, w in v.items()} if isinstance(v, dict) else v for k, v in values.items()}


def _mean(values: Sequence[bool]) -> float:
    return sum(values) / len(values) if values else float("nan")
