"""How sure a result is: an interval for every scalar, and for every choice the chance that it is right.

Scalars: near the answer the blurred outlines change linearly with the parameters (J), so that their covariance is
s^2 (J^T J + P)^-1 with the residual's own variance s^2 and the ranges as a weak prior P (a uniform one has a variance
of 1/12). Neighbouring pixels are not independent and masks are wrong together along an outline, so that the spread is
multiplied by a factor (and never below a floor) measured on held-out shapes. What the outlines do not show keeps nearly
its whole range.

Choices: the gap in IoU between the answer and its best rival that differs in this choice, polished as well, as a share
of what is left unexplained; a logistic curve measured on held-out shapes turns it into a chance.

Both measurements are in calibration.json (python -m recon.evaluate calibration).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import stdtrit

from recon.fitting import moves
from recon.fitting.gauss_newton import descended

if TYPE_CHECKING:
    from recon.fitting.problem import Problem
    from recon.fitting.search import Search
    from recon.fitting.state import State

FILE = Path(__file__).with_name("calibration.json")
LEVEL = 0.9  # stated for intervals
PRIOR = 12.0  # 1 / variance of a scalar that may be anywhere in its range, in shares of the range
LEAST_LEFT = 0.01  # 1 - IoU that exact masks leave at most


@dataclass(frozen=True)
class Calibration:
    """Measured constants.

    spread, floor  a scalar's standard deviation is hypot(floor, spread x the linear one), in shares of its range
    slope, offset  chance = 1 / (1 + exp(-(slope log gap + offset)))
    tail           degrees of freedom of Student's distribution of the errors: most are small, a few are not
    """

    spread: float
    floor: float
    slope: float
    offset: float
    tail: float = np.inf


@dataclass(frozen=True)
class Choice:
    """One discrete parameter: how likely the answer is right, the best rival value and the IoU that it is behind."""

    chance: float
    rival: Any
    gap: float


@dataclass(frozen=True)
class Certainty:
    """By parameter name: intervals (low, high) that hold the truth in LEVEL of the cases, in the parameter's own
    values, and choices. spreads are the standard deviations before calibration, in shares of the range, and gaps the
    shares of the unexplained, for measuring the calibration itself."""

    intervals: dict[str, tuple[float, float]]
    choices: dict[str, Choice]
    spreads: dict[str, float]
    gaps: dict[str, float]


@lru_cache(maxsize=1)
def calibration() -> Calibration:
    """As measured."""
    values = json.loads(FILE.read_text())
    return Calibration(*(float(values[f.name]) for f in fields(Calibration)))


def run(search: Search, state: State, given: Calibration | None = None) -> Certainty:
    """The certainty of a polished state; costs about a Gauss-Newton step and a polish of one rival a choice."""
    use = given or calibration()
    problem = search.problem
    scalars = problem.scalars
    sigma = _spreads(problem, state)
    intervals, spreads = {}, {}
    for scalar, unit, spread in zip(scalars, state.units, sigma, strict=True):
        reach = quantile(LEVEL, use.tail) * deviation(spread, use)
        ends = np.clip([unit - reach, unit + reach], 0, 1)
        low, high = sorted(scalar.value_from_unit(float(u)) for u in ends)
        intervals[scalar.name], spreads[scalar.name] = (float(low), float(high)), float(spread)
    left = problem.loss(state) + LEAST_LEFT
    choices, gaps = {}, {}
    for name, (value, gap) in _rivals(search, state).items():
        gaps[name] = gap / left
        choices[name] = Choice(chance(gaps[name], use), value, gap)
    return Certainty(intervals, choices, spreads, gaps)


def quantile(level: float, tail: float) -> float:
    """Deviations on either side that hold this share of a Student distribution; inf degrees of freedom are normal."""
    # An import of scipy.stats takes a second; so many degrees of freedom are as good as infinitely many.
    return float(stdtrit(min(tail, 1e12), (1 + level) / 2))


def deviation(spread: float, use: Calibration) -> float:
    """Standard deviation of a scalar, in shares of its range, from its linear spread."""
    return float(np.hypot(use.floor, use.spread * spread))


def chance(gap: float, use: Calibration) -> float:
    """Chance that a choice is right whose rival is behind by this share of the unexplained."""
    return float(1 / (1 + np.exp(-(use.slope * np.log(max(gap, 1e-4)) + use.offset))))


def _spreads(problem: Problem, state: State) -> np.ndarray:
    """(n,) standard deviations of the scalars in shares of their ranges, before calibration."""
    level = problem.target.levels - 1
    here, found = problem.linearised(state, level)
    n = len(problem.scalars)
    # The outlines' surroundings alone say something: pixels that no change moves are no evidence.
    seen = (found.block != 0).any(1)
    J = found.block[seen]
    variance = max(float((here[found.rows[seen]] ** 2).sum() / max(len(J), 1)), 1e-8 / max(len(here), 1))
    prior = np.zeros(J.shape[1])
    prior[:n] = PRIOR
    hessian = J.T @ J / variance + np.diag(prior + 1e-9)
    return np.sqrt(np.clip(np.diag(np.linalg.inv(hessian))[:n], 0, 1 / PRIOR))


def _rivals(search: Search, state: State) -> dict[str, tuple[Any, float]]:
    """By discrete parameter: the other value that explains the target best after a short polish, and how much loss it
    is behind (never less than 0)."""
    problem = search.problem
    near: dict[str, list[State]] = {}
    for move in moves.choices(problem, state):
        ((name, _),) = move.values
        near.setdefault(name, []).append(move.applied(problem, state))
    out = {}
    for name, others in near.items():
        best = descended(problem, min(others, key=problem.loss), 2, (problem.target.levels - 1,))
        out[name] = (best.choices[name], max(0.0, problem.loss(best) - problem.loss(state)))
    return out
