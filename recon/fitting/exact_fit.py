"""Find parameters on the exact model when place and size are known: several starts, choices, Gauss-Newton.

Unlike recon.fitting.refine nothing but the parameters is free, so a build and its images cost a few milliseconds and
dozens of choices can be tried. A network's answers are the starts; none of them is ever made worse by the target's
exact loss.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procmodels import Model
from procmodels.space import Params
from recon.fitting.chamfer_residuals import Body, Score
from recon.fitting.exact_moves import ExactOptions, Moves, State, moved
from recon.fitting.exact_targets import ExactTarget


@dataclass(frozen=True)
class ExactFit:
    """The result: parameters, their exact loss, the best start's, and the number of shapes built."""

    params: Params
    loss: float
    start_loss: float
    builds: int


def run(
    model: Model, target: ExactTarget, starts: Sequence[Params], options: ExactOptions = ExactOptions()
) -> ExactFit:
    """The best parameters found from the starts, best first; deterministic."""
    search = _Search(model, target, options)
    states = [search.state(p) for p in starts]
    start = min(states, key=search.exact)
    chosen: dict[tuple, State] = {}
    for s in sorted(states, key=search.coarse):
        chosen.setdefault(tuple(s.discrete.values()), s)
    polished = [search.polish(s, 0, options.steps[0]) for s in list(chosen.values())[: options.starts]]
    polished.sort(key=search.coarse)
    # Cheap answers first: most starts need no other choices, few need them all.
    best = min(start, search.finish(polished[0]), key=search.exact)
    for s in polished[:2]:
        if search.exact(best) > target.good:
            best = min(best, search.finish(search.improve(s)), key=search.exact)
    if search.exact(best) > target.good:
        far = search.best(search.far(best), options.far)
        best = min(best, search.finish(search.improve(far)), key=search.exact)
    if search.exact(best) > target.lost:
        drawn = np.random.default_rng(0)
        anywhere = [search.state(model.space.sample(drawn)) for _ in range(options.anywhere)]
        for s in sorted(anywhere, key=search.coarse)[: options.restarts]:
            if search.exact(best) > target.lost:
                best = min(best, search.finish(search.improve(search.polish(s, 0, options.steps[0]))), key=search.exact)
    best = search.likely(search.centred(best))
    return ExactFit(search.params(best), search.exact(best), search.exact(start), search.builds)


class _Search(Moves):
    """Changes of choices, and what is done about parts that the target does not show."""

    def centred(self, state: State) -> State:
        """Every scalar in the middle of what the exact loss allows: pixels and voxels leave room, some views much."""
        for i in range(len(state.units)):
            ends = [self._end(state, i, way) for way in (-1, 1)]
            units = state.units.copy()
            units[i] = sum(ends) / 2
            middle = replace(state, units=units)
            if self.exact(middle) <= self.exact(state):
                state = middle
        return state

    def _end(self, state: State, i: int, way: int) -> float:
        """How far scalar i can go one way without a higher exact loss, to about a quarter of the way."""
        inside, outside = state.units[i], None
        for size in (0.002, 0.008, 0.03, 0.12, 0.5, 1.0):
            trial = moved(state, way * size * np.eye(len(state.units))[i])
            if self.exact(trial) > self.exact(state):
                outside = trial.units[i]
                break
            inside = trial.units[i]
        for _ in range(2 if outside is not None and inside != state.units[i] else 0):
            units = state.units.copy()
            units[i] = (inside + outside) / 2
            if self.exact(replace(state, units=units)) > self.exact(state):
                outside = units[i]
            else:
                inside = units[i]
        return float(inside)

    def likely(self, state: State) -> State:
        """Of the choices that the target cannot tell apart, the one that is nearest to the others on average."""
        equal = self.alike(state)
        if len(equal) < 3:
            return state
        bodies = [Body.of(self.shape(s)) for s in equal]
        places = [b.at(b.places(self.options.points))[0] for b in bodies]
        scores = [Score(p, self.options.points, surface=b) for p, b in zip(places, bodies, strict=True)]
        distance = [sum(score(body) for score in scores) for body in bodies]
        return equal[int(np.argmin(distance))]

    def alike(self, state: State) -> list[State]:
        """The state and others of equal exact loss that differ in choices, in several at once where several are free;
        a sample where there are many."""
        loss = self.exact(state)
        same = [s for s in self.neighbours(state) if self.exact(s) <= loss]
        free = [p for p in self.model.space.discrete if any(s.discrete[p.name] != state.discrete[p.name] for s in same)]
        if len(free) < 2:
            return [state, *same]
        combinations = list(itertools.product(*[[p.grid_value(i) for i in range(p.grid_steps)] for p in free]))
        out = [state]
        for i in np.random.default_rng(0).permutation(len(combinations))[: self.options.combined]:
            changed = dict(zip([p.name for p in free], combinations[i], strict=True))
            other = replace(state, discrete={**state.discrete, **changed})
            if other.discrete != state.discrete and self.exact(other) <= loss:
                out.append(other)
            if len(out) == self.options.alike:
                break
        return out

    def neighbours(self, state: State) -> Iterator[State]:
        """States that differ in one discrete value."""
        for p in self.model.space.discrete:
            for i in range(p.grid_steps):
                if (value := p.grid_value(i)) != state.discrete[p.name]:
                    yield replace(state, discrete={**state.discrete, p.name: value})

    def jumps(self, state: State) -> Iterator[State]:
        """States with one scalar somewhere else: a part that the views hardly show does not pull from afar."""
        for i in range(len(state.units)):
            for value in self.options.jumps:
                units = state.units.copy()
                units[i] = value
                yield replace(state, units=units)

    def far(self, state: State) -> Iterator[State]:
        """All choices with the state's scalars, and one change of a choice together with a jump."""
        discrete = self.model.space.discrete
        for values in itertools.product(*[[p.grid_value(i) for i in range(p.grid_steps)] for p in discrete]):
            yield replace(state, discrete=dict(zip([p.name for p in discrete], values, strict=True)))
        for other in self.neighbours(state):
            yield from self.jumps(other)

    def improve(self, state: State) -> State:
        """Change one choice or move one scalar far while the coarse loss falls."""
        for _ in range(self.options.sweeps):
            best = self.best(itertools.chain(self.neighbours(state), self.jumps(state)), self.options.tries)
            if self.coarse(best) >= self.coarse(state) * (1 - 1e-2):
                break
            state = best
        return state

    def best(self, states: Iterable[State], tries: int) -> State:
        """The best by coarse loss of the most promising `tries`, polished."""
        ranked = sorted(((self.coarse(s), i, s) for i, s in enumerate(states)), key=lambda e: e[:2])
        return min((self.polish(s, 0, self.options.steps[1]) for _, _, s in ranked[:tries]), key=self.coarse)
