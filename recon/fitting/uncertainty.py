"""How sure a result is: an interval for every scalar, and for every choice the chance that it is right.

Scalars: near the answer the blurred outlines change linearly with the parameters (J), so that their covariance is
s^2 (J^T J + P)^-1 with the residual's own variance s^2 and the ranges as a weak prior P (a uniform one has a variance
of 1/12). Neighbouring pixels are not independent and masks are wrong together along an outline, so that the spread is
multiplied by a factor (and never below a floor) measured on held-out shapes. What the outlines do not show keeps nearly
its whole range.

Choices: the gap in IoU between the answer and its best rival that differs in this choice, polished as well, as a share
of what is left unexplained; a logistic curve measured on held-out shapes turns it into a chance.

Both measurements are in calibration.json (python -m recon.evaluate calibration). They hold for objects that the class
can make; what an answer that explains its input badly may still claim is decided in recon.fitting.beliefs.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import stdtrit

from procmodels.shape import Part, Shape
from recon.fitting import moves

if TYPE_CHECKING:
    from recon.fitting.problem import Problem
    from recon.fitting.search import Neighbour, Search
    from recon.fitting.state import State

FILE = Path(__file__).with_name("calibration.json")
LEVEL = 0.9  # stated for intervals
ELSEWHERE = 0.05  # canonical units that a part's box must lie off its namesake's
PRIOR = 12.0  # 1 / variance of a scalar that may be anywhere in its range, in shares of the range


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
    """One discrete parameter: how likely the answer is right, the best rival value and the loss that it is behind.

    share  the gap as a share of what is left unexplained
    usual  log(share of objects that have the answer's value / that have the rival's), 0 where nothing is said of it
    parts  names of the parts that the answer has and the rival has not, or elsewhere
    """

    chance: float
    rival: Any
    gap: float
    share: float = 0.0
    usual: float = 0.0
    parts: tuple[str, ...] = ()


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


def run(
    search: Search, state: State, given: Calibration | None = None, neighbours: Sequence[Neighbour] | None = None
) -> Certainty:
    """The certainty of a polished state; costs about a Gauss-Newton step, and without its neighbours
    (Search.polished_neighbours) a polish of two rivals a choice."""
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
    near = search.polished_neighbours(state) if neighbours is None else neighbours
    choices = _choices(problem, state, near, use)
    return Certainty(intervals, choices, spreads, {name: c.share for name, c in choices.items()})


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


def _choices(problem: Problem, state: State, neighbours: Sequence[Neighbour], use: Calibration) -> dict[str, Choice]:
    """By discrete parameter: the answer beside the other value that explains the target best."""
    here = problem.loss(state)
    rivals: dict[str, State] = {}
    for move, other in neighbours:
        if isinstance(move, moves.Choose) and len(move.values) == 1:
            name = move.values[0][0]
            if name not in rivals or problem.loss(other) < problem.loss(rivals[name]):
                rivals[name] = other
    out = {}
    for name, rival in rivals.items():
        gap = max(0.0, problem.loss(rival) - here)  # never less than 0
        share = gap / (here + problem.target.noise)
        usual = problem.usual.log_ratio(name, state.choices[name], rival.choices[name])
        parts = _own(problem.shape(state), problem.shape(rival))
        out[name] = Choice(chance(share, use), rival.choices[name], gap, share, usual, parts)
    return out


def _own(shape: Shape, rival: Shape) -> tuple[str, ...]:
    """Names of the parts that a shape has and its rival has not, or elsewhere."""
    there: dict[str, list[np.ndarray]] = {}
    for part in rival.parts:
        there.setdefault(part.name, []).append(_box(part))
    own = {
        part.name
        for part in shape.parts
        if not any(np.abs(_box(part) - box).max() < ELSEWHERE for box in there.get(part.name, ()))
    }
    return tuple(sorted(own))


def _box(part: Part) -> np.ndarray:
    """(2, 3) lower and upper corner."""
    return np.stack([part.vertices.min(0), part.vertices.max(0)])
