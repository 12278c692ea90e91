"""The curves of recon.fitting.beliefs, fitted to gathered rows, and how often what they then state is right.

Weights have a prior, so that a few dozen objects give a usable table and hundreds give theirs; and a sign that cannot
turn: more misfit never makes an answer surer.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from recon.evaluate import calibration
from recon.evaluate.beliefs.rows import BeliefRow
from recon.evaluate.calibration import Sample
from recon.fitting import beliefs, evidence
from recon.fitting.beliefs import DENIED, DOUBTED, HELPS, HIGHEST, LOWEST, Beliefs

Weights = dict[str, float]
Checked = tuple[BeliefRow, dict[str, float], float]
Prior = Mapping[str, tuple[float, float]]  # mean and spread

# What weights are without any objects, and how far they may easily be from it.
CHOICES: Prior = {
    "base": (0.5, 3.0),
    "share": (0.5, 0.3),
    "misfit": (-0.5, 0.5),
    "missing": (-3.0, 3.0),
    "own": (-1.0, 1.5),
    "usual": (0.3, 0.3),
}
ANSWERS: Prior = {
    "base": (0.0, 10.0),
    "misfit": (-1.5, 1.0),
    "missing": (-8.0, 6.0),
    "idle": (-8.0, 6.0),
    "part": (-2.0, 2.0),
    "plain": (-3.0, 2.0),
    "unusual": (-0.5, 0.5),
    "edge": (-3.0, 3.0),
    "unlike": (-0.5, 0.5),
    "sure": (2.0, 2.0),
}
NAMES = 0.5  # spread of what a choice's name adds
# Misfits of an input that is met, as long as nothing was measured, and of one that is hardly met, by its kind.
FOUND = {"mesh": 0.01, "cloud": 0.01, "image": 0.05, "masks": 0.05}
LOST = {"mesh": 0.1, "cloud": 0.1, "image": 0.5, "masks": 0.5}
BINS, SUREST = 4, 0.8  # of misfits for the caps; chance from which a choice is one of the surest
GATE = 0.25  # confidence at the misfit that parts the class from others best: between denied and not even doubted
LABELLED = 12  # choices of real objects, fewer set no chances
FEWEST = 60  # scalars of known truth, fewer set no intervals
SHARES = (0.95, 0.9)  # of others to be denied, of the class not to be doubted


def fitted(rows: Sequence[BeliefRow], kind: str, names: bool = True) -> Beliefs:
    """The beliefs that some objects teach, all looked at as one kind of input.

    names  whether choices are told apart by name
    """
    own_names = sorted({n for r in rows for n in r.choices}) if names else []
    looked = [(r, n, t) for r in rows for n, t in r.choices.items() if t.right is not None]
    if sum(not r.own for r, *_ in looked) < LABELLED:  # what is right of own shapes alone says little of real ones
        looked = []
    numbers = [beliefs.of_choice(t.choice, r.evidence) for r, _, t in looked]
    table = [
        [x[k] for k in CHOICES if k != "base"] + [float(n == o) for o in own_names]
        for x, (_, n, _) in zip(numbers, looked, strict=True)
    ]
    prior = {**CHOICES, **{f"name {n}": (0.0, NAMES) for n in own_names}}
    found = _logistic(table, [bool(t.right) for *_, t in looked], prior)
    use = Beliefs({k: found[k] for k in CHOICES}, {}, {n: found[f"name {n}"] for n in own_names}, objects=len(rows))
    use = replace(use, caps=_caps(rows if looked else (), use, kind), intervals=_intervals(rows))
    return replace(use, answers=_answers(rows, use))


def _logistic(table: Sequence[Sequence[float]], right: Sequence[bool], prior: Prior, balanced: bool = False) -> Weights:
    """Weights of most likelihood with their prior. table (n, k) holds what prior names after "base".

    balanced: right and wrong ones count equally much in all, however many there are
    """
    names = list(prior)
    X = np.array([[1.0, *row] for row in table]).reshape(-1, len(names))
    y = np.array(right, float)
    mean, spread = np.array([prior[n] for n in names]).T
    share = np.clip(y.mean(), 1e-3, 1 - 1e-3) if len(y) else 0.5
    weight = np.where(y > 0.5, 0.5 / share, 0.5 / (1 - share)) if balanced else np.ones(len(y))

    def loss(w: np.ndarray) -> tuple[float, np.ndarray]:
        odds, off = X @ w, (w - mean) / spread
        value = (weight * (np.logaddexp(0, odds) - y * odds)).sum() + 0.5 * (off**2).sum()
        return float(value), X.T @ (weight * (1 / (1 + np.exp(-odds)) - y)) + off / spread

    found = minimize(loss, mean, jac=True, method="L-BFGS-B", bounds=[_sign(n) for n in names]).x
    return {n: float(w) for n, w in zip(names, found, strict=True)}


def _sign(name: str) -> tuple[float | None, float | None]:
    if name == "base" or name.startswith("name "):
        return None, None
    return (0.0, None) if name in HELPS else (None, 0.0)


def _intervals(rows: Sequence[BeliefRow]) -> tuple[float, float, float] | None:
    """Spread, floor and tail of the scalars' intervals; None for too few."""
    samples = [Sample(r.scalars, ()) for r in rows if r.scalars]
    if sum(len(s.scalars) for s in samples) < FEWEST:
        return None
    found = calibration.fitted(samples)
    return round(found.spread, 4), round(found.floor, 4), round(found.tail, 4)


def _caps(rows: Sequence[BeliefRow], use: Beliefs, kind: str) -> tuple[tuple[float, float], ...]:
    """(misfit, share of right ones among the surest choices) in bins of misfit, never growing with it; at LOST, where
    the input is hardly met at all, a choice may be right or wrong."""
    sure = sorted(
        (r.evidence.misfit, bool(t.right))
        for r in rows
        for n, t in r.choices.items()
        if t.right is not None and beliefs.chance(n, t.choice, r.evidence, use) >= SUREST
    )
    good, lost = FOUND[kind], LOST[kind]
    out: list[tuple[float, float]] = []
    for part in np.array_split(np.arange(len(sure)), BINS) if len(sure) >= 2 * BINS else ():
        some = [sure[i] for i in part]
        middle = float(np.exp(np.mean([np.log(max(m, evidence.FINEST)) for m, _ in some])))
        # One right and a twentieth of a wrong one are thrown in: few that were all right do not prove it of all.
        share = (sum(r for _, r in some) + 1) / (len(some) + 1.05)
        highest = min(out[-1][1] if out else HIGHEST, share, HIGHEST)
        out.append((round(middle, 4), round(max(highest, LOWEST), 4)))
    out = [(m, c) for m, c in out or [(good, HIGHEST)] if m < lost]
    return (*out, (lost, min(0.5, out[-1][1]) if out else 0.5))


def _answers(rows: Sequence[BeliefRow], use: Beliefs) -> Weights:
    """The curve of the whole answer, moved so that the gate lies where it parts best."""
    table, belongs = [], []
    for r in rows:
        chances = {n: beliefs.chance(n, t.choice, r.evidence, use) for n, t in r.choices.items()}
        numbers = beliefs.of_answer(r.evidence, chances)
        table.append([numbers[k] for k in ANSWERS if k != "base"])
        belongs.append(r.belongs)
    found = _logistic(table, belongs, ANSWERS, balanced=True)
    real = np.array([not r.own for r in rows], bool)  # own shapes fit better than any real object
    if len({b for b, r in zip(belongs, real, strict=True) if r}) < 2:
        return found
    order = [found[k] for k in ANSWERS if k != "base"]
    odds = np.array(table) @ order
    found["base"] = float(np.log(GATE / (1 - GATE))) - _gate(odds[real], np.array(belongs)[real], -found["base"])
    return found


def _gate(odds: np.ndarray, belongs: np.ndarray, even: float) -> float:
    """The odds at which the share of others below and of the class above come nearest to what is wanted of both; where
    several are as near, that next to what the curve itself takes for even."""
    low, high = (float(np.log(p / (1 - p)) - np.log(GATE / (1 - GATE))) for p in (DENIED, DOUBTED))
    places = np.unique(np.concatenate([odds - low, odds - high, [odds.min() - 1]]))
    places = np.concatenate([places, (places[1:] + places[:-1]) / 2])
    denied = np.array([(odds[~belongs] < at + low).mean() for at in places]) / SHARES[0]
    kept = np.array([(odds[belongs] >= at + high).mean() for at in places]) / SHARES[1]
    worst = np.minimum(denied, kept)
    best = places[worst >= worst.max() - 1e-9]
    return float(np.clip(even, best.min(), best.max()))


def checked(rows: Sequence[BeliefRow], parts: int = 5, names: bool = True) -> list[Checked]:
    """Every row with the chances of its choices and its confidence, by beliefs that other objects taught."""
    out = []
    group = {name: zlib.crc32(name.encode()) % parts for name in {r.name for r in rows}}
    for part in range(parts):
        rest = [r for r in rows if group[r.name] != part]
        use = fitted(rest, rows[0].kind, names)
        for r in rows:
            if group[r.name] == part:
                chances = {n: beliefs.chance(n, t.choice, r.evidence, use) for n, t in r.choices.items()}
                out.append((r, chances, beliefs.confidence(r.evidence, chances, use)))
    return out
