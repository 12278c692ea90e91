"""How sure an answer may be: chances of its choices by the misfit that is left, and whether the object is of the class.

What a choice's rivals leave behind (recon.fitting.uncertainty) says little once much of the input is unexplained. So
the chance of a choice is a logistic curve of the gap to its rival as a share of what is left, of what is left itself,
of what is seen and not explained, of the choice's own parts that stand where nothing is seen, and of how usual the
answer's value is beside the rival's. No chance is higher than the share of right ones among the surest at that misfit.

The confidence in the whole answer is such a curve, too, of the evidence (recon.fitting.evidence) and of the chances:
high for objects that the class can make, low for things that are none of it. Below DENIED the answer is "not a ...".

Both are measured on labelled real objects, those of the class and others: `python -m recon.evaluate beliefs`. The
table, beliefs.json, holds them by class (the hash of its space) and kind of input; a class without goes by DEFAULT.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from procmodels.space import ParamSpace
from recon.fitting import uncertainty
from recon.fitting.evidence import FINEST, Evidence
from recon.fitting.uncertainty import Calibration, Certainty, Choice

FILE = Path(__file__).with_name("beliefs.json")
DEFAULT = "default"
KINDS = ("mesh", "cloud", "image", "masks")  # of input: surfaces dense or sparse; one outline; several, cameras known
DENIED, DOUBTED = 0.2, 0.3  # confidence below which an object is said to be none of the class; and may be none
LOWEST, HIGHEST = 0.02, 0.99  # chances that are stated
LEAST_SHARE = 1e-4
UNLIKE = 1.5  # log-odds of outlines of another kind that are worth a word

# What the curves are of; every one is worse the larger it is, but for "share", "usual" and "sure".
OF_CHOICES = ("share", "misfit", "missing", "own", "usual")
OF_ANSWERS = ("misfit", "missing", "idle", "part", "plain", "unusual", "edge", "unlike", "sure")
HELPS = ("share", "usual", "sure")


@dataclass(frozen=True)
class Beliefs:
    """What was measured for one class and kind of input.

    choices, answers  weights of OF_CHOICES and OF_ANSWERS in log-odds, each with "base", which stands alone
    names             what a choice of this name adds to its log-odds
    caps              (misfit, highest chance) by growing misfit: of what is no better than that
    intervals         spread, floor and tail of a Calibration of scalars; None: uncertainty's own
    objects           how many it was measured on
    """

    choices: Mapping[str, float]
    answers: Mapping[str, float]
    names: Mapping[str, float] = field(default_factory=dict)
    caps: tuple[tuple[float, float], ...] = ()
    intervals: tuple[float, float, float] | None = None
    objects: int = 0

    def as_json(self) -> dict[str, Any]:
        """As it is kept."""
        return asdict(self)

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> Beliefs:
        """As `as_json` made it. Raises KeyError or TypeError for anything else."""
        weights = {k: {n: float(v) for n, v in values[k].items()} for k in ("choices", "answers", "names")}
        caps = tuple((float(m), float(c)) for m, c in values["caps"])
        intervals = None
        if values["intervals"] is not None:
            spread, floor, tail = map(float, values["intervals"])
            intervals = spread, floor, tail
        return Beliefs(**weights, caps=caps, intervals=intervals, objects=int(values["objects"]))


def table(space: ParamSpace, kind: str, file: Path = FILE) -> Beliefs:
    """What was measured for a class and kind of input; for another class or kind, what is there instead."""
    known = _tables(file)
    mine = known.get(space.hash, {})
    return mine.get(kind) or known[DEFAULT][kind]


@lru_cache(maxsize=4)
def _tables(file: Path) -> dict[str, dict[str, Beliefs]]:
    """By hash of a space, or DEFAULT, and kind of input."""
    values = json.loads(file.read_text())
    return {
        key: {kind: Beliefs.from_json(row) for kind, row in entry["kinds"].items()}
        for key, entry in values["classes"].items()
    }


def calibration_of(use: Beliefs) -> Calibration:
    """For the intervals of scalars."""
    usual = uncertainty.calibration()
    if use.intervals is None:
        return usual
    spread, floor, tail = use.intervals
    return replace(usual, spread=spread, floor=floor, tail=tail)


def of_choice(choice: Choice, evidence: Evidence) -> dict[str, float]:
    """The numbers of OF_CHOICES."""
    return {
        "share": float(np.log(max(choice.share, LEAST_SHARE))),
        "misfit": _log(evidence.misfit),
        "missing": evidence.missing,
        "own": max((evidence.parts.get(part, 0.0) for part in choice.parts), default=0.0),
        "usual": choice.usual,
    }


def of_answer(evidence: Evidence, chances: Mapping[str, float]) -> dict[str, float]:
    """The numbers of OF_ANSWERS; `chances` are those of the choices as stated."""
    sure = float(np.mean(list(chances.values()))) if chances else 0.5
    numbers = evidence.numbers()
    return {**numbers, "misfit": _log(evidence.misfit), "sure": sure}


def chance(name: str, choice: Choice, evidence: Evidence, use: Beliefs) -> float:
    """That a choice is right."""
    odds = _odds(of_choice(choice, evidence), use.choices) + use.names.get(name, 0.0)
    return float(np.clip(_logistic(odds), LOWEST, min(HIGHEST, cap(evidence.misfit, use))))


def cap(misfit: float, use: Beliefs) -> float:
    """The highest chance of a choice at this misfit; between the measured ones, in equal factors."""
    if not use.caps:
        return HIGHEST
    at, highest = np.array(use.caps).T
    return float(np.interp(_log(misfit), [_log(m) for m in at], highest))


def confidence(evidence: Evidence, chances: Mapping[str, float], use: Beliefs) -> float:
    """That the answer is what the object is."""
    return float(_logistic(_odds(of_answer(evidence, chances), use.answers)))


@dataclass(frozen=True)
class Stated:
    """The certainty with chances as they may be stated, and the confidence in the whole answer."""

    certainty: Certainty | None
    confidence: float


def stated(certainty: Certainty | None, evidence: Evidence, use: Beliefs) -> Stated:
    """What may be said of an answer."""
    choices = {} if certainty is None else certainty.choices
    chances = {name: chance(name, choice, evidence, use) for name, choice in choices.items()}
    sure = confidence(evidence, chances, use)
    if certainty is None:
        return Stated(None, sure)
    told = {name: replace(choice, chance=chances[name]) for name, choice in choices.items()}
    return Stated(replace(certainty, choices=told), sure)


def words(class_name: str, confidence: float, evidence: Evidence) -> tuple[str, ...]:
    """The warning that an object is no CLASS, or may be none; nothing when it seems to be one."""
    if confidence >= DOUBTED:
        return ()
    why = _why(evidence)
    article = "an" if class_name[0] in "aeiou" else "a"
    if confidence < DENIED:
        return (
            f"this is not {article} {class_name}, or one unlike any that can be made{why}. What is shown is the "
            f"nearest {class_name}: its parameters and their chances say little; another --class may fit",
        )
    return (
        f"this may not be {article} {class_name}{why}: compare the result with the input before you use it, "
        "or try another --class",
    )


def _why(evidence: Evidence) -> str:
    """What speaks most plainly against an answer."""
    said = []
    if evidence.missing > 0.05:
        said.append(f"{evidence.missing:.0%} of what is seen has nothing of the result near it")
    if evidence.idle > 0.05:
        said.append(f"{evidence.idle:.0%} of the result lies where nothing is seen")
    if evidence.unlike > UNLIKE:
        said.append("its outlines look like those of another kind of thing")
    if not said and evidence.plain > 0.8:
        said.append("any plain body explains what is seen as well")
    if not said and evidence.unusual > 1.5:
        said.append("its proportions are unusual")
    return f" ({' and '.join(said)})" if said else ""


def _log(misfit: float) -> float:
    return float(np.log(max(misfit, FINEST)))


def _odds(numbers: Mapping[str, float], weights: Mapping[str, float]) -> float:
    return weights["base"] + sum(weights[name] * numbers[name] for name in weights if name != "base")


def _logistic(odds: float) -> float:
    return 1 / (1 + np.exp(-np.clip(odds, -30, 30)))
