"""What was found for one object from one kind of input, as it is kept: a line of JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from datasets.part_labels import Seen
from procmodels import Model
from procmodels.space import Params
from recon.fitting.evidence import Evidence
from recon.fitting.uncertainty import Certainty, Choice
from recon.scene import InputError

OWN = "own"  # the source of the class's own shapes


@dataclass(frozen=True)
class Told:
    """One discrete parameter of an answer: what Choice says of it and whether it is right, None where none can tell."""

    choice: Choice
    value: Any
    right: bool | None


@dataclass(frozen=True)
class BeliefRow:
    """One object from one kind of input.

    name, word  of datasets.part_labels; the word is the class's for those that are of it
    belongs     whether the object is of the class
    choices     by name
    scalars     (error, spread) in shares of their ranges, where the truth is known
    """

    name: str
    word: str
    kind: str
    belongs: bool
    evidence: Evidence
    choices: Mapping[str, Told]
    scalars: tuple[tuple[float, float], ...]
    seconds: float

    @property
    def own(self) -> bool:
        """Whether it is one of the class's own shapes."""
        return self.name.startswith(OWN + "/")


def told(params: Params, certainty: Certainty | None, seen: Seen | None) -> dict[str, Told]:
    """The choices of an answer beside what people saw; None when nobody looked."""
    out = {}
    for name, choice in (certainty.choices if certainty else {}).items():
        values = (seen or {}).get(name)
        out[name] = Told(choice, params[name], None if values is None else params[name] in values)
    return out


def deviations(
    model: Model, params: Params, certainty: Certainty | None, true: Params | None
) -> tuple[tuple[float, float], ...]:
    """(error, spread before calibration) of the scalars that do something in the answer and in the truth."""
    if certainty is None or true is None:
        return ()
    both = model.space.active(params) & model.space.active(true)
    out = []
    for s in model.space.scalars:
        if s.name in both:
            here, there = (s.unit_from_value(float(p[s.name])) for p in (params, true))
            out.append((abs(here - there), certainty.spreads[s.name]))
    return tuple(out)


def read(file: Path) -> list[BeliefRow]:
    """The rows of a file, the last of each object and kind; a line that a killed run left unfinished is left out."""
    rows: dict[tuple[str, str], BeliefRow] = {}
    lines = file.read_text(encoding="utf-8").split("\n") if file.is_file() else []
    for i, line in enumerate(lines):
        if not line:
            continue
        try:
            row = _from_json(json.loads(line))
        except (ValueError, KeyError, TypeError) as error:
            if i == len(lines) - 1:  # not ended: the run was killed while it wrote
                continue
            what = f"{type(error).__name__}: {error}"
            raise InputError(f"{file}, line {i + 1}, is no row of this table ({what}); delete the file") from error
        rows[row.name, row.kind] = row
    return list(rows.values())


def append(file: Path, rows: Iterable[BeliefRow]) -> None:
    """Add rows at the end, on lines of their own."""
    file.parent.mkdir(parents=True, exist_ok=True)
    text = file.read_bytes() if file.is_file() else b""
    with file.open("ab") as to:
        if text and not text.endswith(b"\n"):  # what a killed run left is no row
            to.truncate(text.rfind(b"\n") + 1)
        for row in rows:
            to.write((json.dumps(asdict(row), default=_plain) + "\n").encode())


def _plain(value: Any) -> Any:
    """Numpy's scalars as Python's own."""
    return value.item()


def _from_json(values: dict[str, Any]) -> BeliefRow:
    choices = {
        name: Told(Choice(**{**v["choice"], "parts": tuple(v["choice"]["parts"])}), v["value"], v["right"])
        for name, v in values["choices"].items()
    }
    scalars = tuple((float(e), float(s)) for e, s in values["scalars"])
    found = {"evidence": Evidence(**values["evidence"]), "choices": choices, "scalars": scalars}
    return BeliefRow(**{**values, **found})
