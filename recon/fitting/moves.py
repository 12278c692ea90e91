"""Moves of a search, as values: other choices, another front, a scalar somewhere else, several choices at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from procmodels.space import Params, Value
from recon.fitting.problem import Problem
from recon.fitting.state import State


class Move(Protocol):
    """A change of a state. `str` says it to people."""

    def applied(self, problem: Problem, state: State) -> State: ...


@dataclass(frozen=True)
class Choose:
    """Other values for some integers, choices or flags."""

    values: tuple[tuple[str, Value], ...]

    def applied(self, problem: Problem, state: State) -> State:
        return problem.held(replace(state, choices={**state.choices, **dict(self.values)}))

    def __str__(self) -> str:
        return ", ".join(f"{name} = {value}" for name, value in self.values)


@dataclass(frozen=True)
class Face:
    """Front number `front`, so many quarter turns from the present one."""

    front: int
    quarters: int

    def applied(self, problem: Problem, state: State) -> State:
        place = problem.placement.turned(state.place, state.front, self.front)
        return replace(state, place=place, front=self.front)

    def __str__(self) -> str:
        return f"front turned by {90 * self.quarters} degrees"


@dataclass(frozen=True)
class Jump:
    """Scalar number `scalar` elsewhere in its range: a part that the target hardly shows does not pull from afar."""

    scalar: int
    unit: float

    def applied(self, problem: Problem, state: State) -> State:
        units = state.units.copy()
        units[self.scalar] = self.unit
        return problem.held(replace(state, units=units))

    def __str__(self) -> str:
        return f"scalar {self.scalar} at {100 * self.unit:.0f} % of its range"


@dataclass(frozen=True)
class Graft:
    """One group of parameters as another shape has it: that back on this seat."""

    group: str
    units: np.ndarray  # of that shape's scalars
    choices: Params

    def applied(self, problem: Problem, state: State) -> State:
        names = {p.name for p in problem.model.space.groups[self.group]}
        units = np.where([s.name in names for s in problem.scalars], self.units, state.units)
        choices = {name: self.choices[name] if name in names else value for name, value in state.choices.items()}
        return problem.held(replace(state, units=units, choices=choices))

    def __str__(self) -> str:
        return f"another {self.group}"


@dataclass(frozen=True)
class Both:
    """One move after the other."""

    first: Move
    second: Move

    def applied(self, problem: Problem, state: State) -> State:
        return self.second.applied(problem, self.first.applied(problem, state))

    def __str__(self) -> str:
        return f"{self.first}, {self.second}"


def choices(problem: Problem, state: State) -> Iterator[Choose]:
    """Every change of one choice that does something."""
    active = problem.active(state)
    for p in problem.model.space.discrete:
        for i in range(p.grid_steps if p.name in active else 0):
            if (value := p.grid_value(i)) != state.choices[p.name]:
                yield Choose(((p.name, value),))


def woken(problem: Problem, state: State, units: Sequence[float]) -> Iterator[Move]:
    """Every change of one choice that lets others do something which did nothing, with one of these elsewhere: a
    stretcher at the wrong height looks worse than none, as do five bars where there are six."""
    before, moving = problem.active(state), problem.movable(state)
    for choice in choices(problem, state) if units else ():
        after = choice.applied(problem, state)
        fresh = problem.active(after) - before
        for p in problem.model.space.discrete:
            for i in range(p.grid_steps if p.name in fresh else 0):
                if (value := p.grid_value(i)) != after.choices[p.name]:
                    yield Choose((*choice.values, (p.name, value)))
        for i in np.flatnonzero(problem.movable(after) & ~moving):
            for unit in units:
                yield Both(choice, Jump(int(i), unit))


def fronts(problem: Problem, state: State) -> Iterator[Face]:
    """Every other front."""
    count = problem.placement.fronts
    for k in range(1, count):
        yield Face((state.front + k) % count, k)


def jumps(problem: Problem, state: State, units: Sequence[float]) -> Iterator[Jump]:
    """Every scalar that does something, elsewhere in its range."""
    for i in np.flatnonzero(problem.movable(state)):
        for unit in units:
            yield Jump(int(i), unit)


def grafts(problem: Problem, donors: Iterable[State]) -> Iterator[Graft]:
    """Every group of every donor."""
    for donor in donors:
        for group in problem.model.space.groups:
            yield Graft(group, donor.units, donor.choices)


def combinations(
    problem: Problem, limit: int, rng: np.random.Generator, names: Sequence[str] | None = None
) -> Iterator[Choose]:
    """Values for all choices, or those named: every combination if there are at most `limit`, else so many drawn."""
    wanted = [p for p in problem.model.space.discrete if names is None or p.name in names]
    steps = [p.grid_steps for p in wanted]
    total = int(np.prod(steps, dtype=object)) if steps else 0
    drawn = rng.permutation(total).tolist() if 0 < total <= limit else None
    seen: set[tuple[int, ...]] = set()
    for i in range(min(limit, total)):
        if drawn is not None:
            digits = tuple(int(d) for d in np.unravel_index(drawn[i], steps))
        else:
            digits = tuple(int(rng.integers(s)) for s in steps)
        if digits not in seen:
            seen.add(digits)
            yield Choose(tuple((p.name, p.grid_value(d)) for p, d in zip(wanted, digits, strict=True)))


def differing(a: Params, b: Params) -> list[str]:
    """Names of the choices in which two states differ."""
    return [name for name in a if a[name] != b[name]]
