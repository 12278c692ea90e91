"""What a target leaves open once it is met: scalars take the middle of what is allowed, choices the likeliest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from recon.fitting import moves
from recon.fitting.problem import Problem
from recon.fitting.state import Posed, State
from recon.fitting.surface_target import Surface
from recon.geometry.triangles import Triangles

REACHES = (0.002, 0.008, 0.03, 0.12, 0.5, 1.0)  # shares of a scalar's range, tried in turn
ALIKE, COMBINED, POINTS = 20, 120, 500  # states that are compared at most, combinations tried for them, surface points


def centred(problem: Problem, state: State) -> State:
    """Every scalar in the middle of what the loss allows: pixels and voxels leave room, some views much."""
    for i in np.flatnonzero(problem.movable(state)):
        units = state.units.copy()
        units[i] = sum(_end(problem, state, int(i), way) for way in (-1, 1)) / 2
        middle = replace(state, units=units)
        if problem.loss(middle) <= problem.loss(state):
            state = middle
    return state


def _end(problem: Problem, state: State, i: int, way: int) -> float:
    """How far scalar i can go one way without a higher loss, to about a quarter of the way."""

    def at(unit: float) -> tuple[float, bool]:
        units = state.units.copy()
        units[i] = np.clip(unit, 0, 1)
        return float(units[i]), problem.loss(replace(state, units=units)) <= problem.loss(state)

    inside = outside = float(state.units[i])
    for size in REACHES:
        outside, allowed = at(state.units[i] + way * size)
        if not allowed:
            break
        inside = outside
    for _ in range(2 if inside not in (outside, state.units[i]) else 0):
        there, allowed = at((inside + outside) / 2)
        inside, outside = (there, outside) if allowed else (inside, there)
    return inside


def likely(problem: Problem, state: State) -> State:
    """Of the choices that the target cannot tell apart, the one whose shape is nearest to the others' on average."""
    equal = alike(problem, state)
    if len(equal) < 3:
        return state
    posed = [Posed(problem.shape(s), np.eye(4), np.zeros((0, 4, 4)), np.zeros((0, 3, 3))) for s in equal]
    surfaces = [Triangles.of(p.shape) for p in posed]
    targets = [Surface(t.at(t.places(POINTS))[0], (POINTS,), t) for t in surfaces]
    return equal[int(np.argmin([sum(target.loss(p) for target in targets) for p in posed]))]


def alike(problem: Problem, state: State) -> list[State]:
    """The state and others of no higher loss that differ in choices, in several at once where several are free; a
    sample where there are many."""
    loss = problem.loss(state)
    same = [s for m in moves.choices(problem, state) if problem.loss(s := m.applied(problem, state)) <= loss]
    free = [n for n in state.choices if any(s.choices[n] != state.choices[n] for s in same)]
    if len(free) < 2:
        return [state, *same]
    out = [state]
    for move in moves.combinations(problem, COMBINED, np.random.default_rng(0), free):
        other = move.applied(problem, state)
        if other.choices != state.choices and problem.loss(other) <= loss:
            out.append(other)
        if len(out) == ALIKE:
            break
    return out
