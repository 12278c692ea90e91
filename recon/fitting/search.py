"""The search for the state that a target is met best by: starts, one change at a time, Gauss-Newton in between."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from recon.fitting import moves
from recon.fitting.gauss_newton import descended, polish, settled
from recon.fitting.moves import Both, Move
from recon.fitting.problem import Problem
from recon.fitting.state import State

Neighbour = tuple[Move, State]


@dataclass(frozen=True)
class Schedule:
    """How wide and how long is searched."""

    looked: int = 32  # starts of a batch that are compared as they are
    starts: int = 4  # of these, of different choices and fronts, that are polished coarsely
    each: int = 10**6  # of these, at most, that face one way: another may only need a polish
    kept: int = 2  # of these, whose choices are searched, until one is good
    behind: float = 1e9  # times the best one's loss: others are given up
    batches: int = 1  # of starts, as long as the answer is lost
    sweeps: int = 5  # rounds over the moves
    tries: int = 4  # most promising moves of a round that are polished
    gain: float = 1e-3  # share of the loss that a round must win
    fronts: bool = True  # other fronts are among the moves
    jumps: tuple[float, ...] = ()  # where else in its range a scalar is tried
    woken: tuple[float, ...] = (0.2, 0.5, 0.8)  # where one is tried that a choice lets do something
    far: int = 0  # tries among combinations, when the answer is not good
    combined: int = 256  # combinations of choices that are looked at for it, where parameters are not grouped
    levels: tuple[int, ...] | None = None  # of the target, on the way; None for all
    steps: tuple[int, int, int] = (3, 2, 8)  # of a start, of a move, of the last polish at each level
    settle: tuple[float, ...] = ()  # sizes of the last steps, by the loss itself (gauss_newton.settled)
    good: float = 0.0  # loss that leaves few doubts
    lost: float = np.inf  # loss of an answer that is not even near: it is looked for among further starts
    coarse: bool = False  # moves are compared by the coarsest residuals, instead of by the loss


@dataclass(frozen=True)
class Solution:
    """The best state, its loss, that of the best start, and other states, by the move that leads there, best first."""

    state: State
    loss: float
    start: float
    ranked: tuple[tuple[Move, float], ...] = ()


class Search:
    """A problem and a schedule."""

    def __init__(self, problem: Problem, schedule: Schedule) -> None:
        self.problem, self.schedule = problem, schedule
        self._coarse: dict[tuple, float] = {}

    def cost(self, state: State) -> float:
        """What states on the way are compared by."""
        if not self.schedule.coarse:
            return self.problem.loss(state)
        if state.key not in self._coarse:
            self._coarse[state.key] = self.problem.smooth(state, 0)
        return self._coarse[state.key]

    def ranked(self, states: Iterable[State]) -> list[State]:
        """Best first."""
        listed = list(states)
        costs = [self.cost(s) for s in listed]
        return [listed[i] for i in sorted(range(len(listed)), key=costs.__getitem__)]

    def step(self, state: State, steps: int) -> State:
        """A few steps on the way: at the coarsest level, or through several where the loss compares."""
        if self.schedule.coarse:
            return polish(self.problem, state, 0, steps)
        return descended(self.problem, state, steps, self.schedule.levels)

    def begun(self, starts: list[State]) -> list[State]:
        """The most promising starts, polished, best first."""
        chosen: dict[tuple, State] = {}
        facing: Counter[int] = Counter()
        for s in self.ranked(starts):
            if (s.front, *s.choices.values()) not in chosen and facing[s.front] < self.schedule.each:
                chosen[s.front, *s.choices.values()] = s
                facing[s.front] += 1
        some = list(chosen.values())[: self.schedule.starts]
        polished = self.ranked(self.step(s, self.schedule.steps[0]) for s in some)
        near = self.schedule.behind * self.cost(polished[0])
        return [s for s in polished[: self.schedule.kept] if self.cost(s) <= near]

    def moves(self, state: State) -> Iterator[Move]:
        """What is tried in a round."""
        yield from moves.choices(self.problem, state)
        yield from moves.woken(self.problem, state, self.schedule.woken)
        if self.schedule.fronts:
            yield from moves.fronts(self.problem, state)
        yield from moves.jumps(self.problem, state, self.schedule.jumps)

    def best_of(self, state: State, tried: Iterable[Move], tries: int) -> State:
        """The best of the most promising moves, polished; the state itself if there are none."""
        changed = {s.key: s for s in (m.applied(self.problem, state) for m in tried) if s.key != state.key}
        others = self.ranked(changed.values())[:tries]
        return min((self.step(s, self.schedule.steps[1]) for s in others), key=self.cost, default=state)

    def improved(self, state: State) -> State:
        """One move after the other, as long as they help."""
        for _ in range(self.schedule.sweeps):
            best = self.best_of(state, self.moves(state), self.schedule.tries)
            if self.cost(best) >= self.cost(state) * (1 - self.schedule.gain):
                break
            state = best
        return state

    def distant(self, state: State, starts: list[State]) -> Iterator[Move]:
        """Single groups of parameters as other starts have them; where parameters are not grouped, combinations of
        choices, and one choice together with a scalar elsewhere."""
        if len(self.problem.model.space.groups) > 1:
            yield from moves.grafts(self.problem, starts)
            return
        yield from moves.combinations(self.problem, self.schedule.combined, np.random.default_rng(0))
        for choice in moves.choices(self.problem, state):
            for jump in moves.jumps(self.problem, state, self.schedule.jumps):
                yield Both(choice, jump)

    def finished(self, state: State) -> State:
        """The last polish."""
        out = descended(self.problem, state, self.schedule.steps[2])
        return settled(self.problem, out, self.schedule.settle)

    def from_batch(self, starts: list[State], best: State) -> State:
        """The best found from some starts, or the one before."""
        loss, begun = self.problem.loss, self.begun(starts)
        # Cheap answers first: most starts need no other choices, few need them all.
        if self.schedule.good > 0:
            best = min(best, self.finished(begun[0]), key=loss)
        for s in begun:
            if loss(best) > self.schedule.good or self.schedule.good <= 0:
                best = min(best, self.finished(self.improved(s)), key=loss)
        if self.schedule.far and loss(best) > self.schedule.good:
            far = self.best_of(best, self.distant(best, starts), self.schedule.far)
            best = min(best, self.finished(self.improved(far)), key=loss)
        return best

    def neighbours(self, state: State) -> Iterator[Neighbour]:
        """Every change of one choice, and every other front if fronts are among the moves."""
        near: list[Move] = [*moves.choices(self.problem, state)]
        if self.schedule.fronts:
            near += moves.fronts(self.problem, state)
        for move in near:
            yield move, move.applied(self.problem, state)

    def polished_neighbours(self, state: State, each: int = 2) -> list[Neighbour]:
        """The neighbours, polished a little: every front, and the `each` best other values of every choice; further
        values as they are."""
        fronts, values = [], dict[str, list[Neighbour]]()
        for move, other in self.neighbours(state):
            if isinstance(move, moves.Choose):
                values.setdefault(move.values[0][0], []).append((move, other))
            else:
                fronts.append((move, self.step(other, self.schedule.steps[1])))
        out = fronts
        for others in values.values():
            others.sort(key=lambda pair: self.problem.loss(pair[1]))
            out += [(move, self.near(other)) for move, other in others[:each]] + others[each:]
        return out

    def near(self, state: State) -> State:
        """Two steps at the finest level: what a neighbour needs to be compared."""
        return descended(self.problem, state, 2, (self.problem.target.levels - 1,))

    def compared(self, state: State, rounds: int = 3) -> tuple[State, list[Neighbour]]:
        """The state, or a neighbour that beats it once it is polished, and its own neighbours: what is told beside an
        answer must not be better than the answer."""
        neighbours = self.polished_neighbours(state)
        for _ in range(rounds):
            best = min((other for _, other in neighbours), key=self.problem.loss, default=state)
            if self.problem.loss(best) >= self.problem.loss(state):
                break
            state = self.finished(best)
            neighbours = self.polished_neighbours(state)
        return state, neighbours

    def behind(self, state: State, neighbours: Iterable[Neighbour]) -> tuple[tuple[Move, float], ...]:
        """By how much loss neighbours are behind the state, best first. What was turned down for another reason than
        its loss, as a front that is less likely, counts as equal."""
        here = self.problem.loss(state)
        scored = [(move, max(0.0, self.problem.loss(other) - here)) for move, other in neighbours]
        return tuple(sorted(scored, key=lambda pair: pair[1]))


def solve(problem: Problem, starts: Iterable[State], schedule: Schedule = Schedule()) -> Solution:
    """The best state found. Starts are taken as they are needed, a batch at a time; none is ever made worse.

    Raises ValueError when there are no starts.
    """
    search, source = Search(problem, schedule), iter(starts)
    best: State | None = None
    start = np.inf
    for _ in range(schedule.batches):
        if best is not None and problem.loss(best) <= schedule.lost:
            break
        if not (batch := list(itertools.islice(source, schedule.looked))):
            break
        first = min(batch, key=problem.loss)
        start = min(start, problem.loss(first))
        best = search.from_batch(batch, first if best is None else best)
    if best is None:
        raise ValueError("a search needs at least one start")
    return Solution(best, problem.loss(best), start)


def turned_round(search: Search, state: State, allowed: Callable[[float], float]) -> State:
    """The state, or the same object facing the other way when its values say that it is seen from behind and its loss
    is at most what is allowed for the state's."""
    problem = search.problem
    params = problem.model.turned_round(problem.params(state)) if problem.model.turned_round else None
    half = problem.placement.half_turn(state.front)
    if params is None or half is None:
        return state
    other = problem.state(params, problem.placement.turned(state.place, state.front, half), half)
    found = search.finished(search.improved(search.step(other, search.schedule.steps[0])))
    return found if problem.loss(found) <= allowed(problem.loss(state)) else state
