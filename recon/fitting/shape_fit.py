"""Find the parameters whose exact mesh lies nearest to a shape: starts, one-at-a-time choices, Gauss-Newton.

Starts are the network's answer for every way to stand, and a spread of random shapes compared with all of them. The
best few are polished on the exact model. A mesh fills its own box, so its place is known and stays; a cloud's box is
only near, so that scale, translation and a small turn are fitted too, held to the box by the cloud's spacing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from nnproc.infer import WeightsError, load_network, params_from_grids
from procmodels import Model
from procmodels.space import Params
from recon.fitting.chamfer_residuals import Body, Places, Score
from recon.scene import Canonical
from recon.shapes.shape_target import Hypothesis, Target, grids_of, hypotheses

FAR = 2.0  # times the best start's distance: others are given up
NEARLY = 0.15  # of the distance: so much farther may the likelier of two fronts be


@dataclass(frozen=True)
class ShapeFitOptions:
    """How wide and how long the search is; a build with its distances takes about 4 ms."""

    random: int = 96  # random shapes beside the network's answers
    ways: int = 4  # ways to stand that all random shapes are compared with, the best by every `sparse`-th of them
    sparse: int = 4
    rough: int = 250  # points each way when starts are compared
    fine: int = 1_200  # points each way when polishing
    keep: int = 4  # starts that are polished
    sweeps: int = 4  # rounds of changing one choice
    tries: int = 2  # most promising changes of a round that are polished
    step: float = 0.03  # finite difference of a scalar, share of its range
    move_step: float = 0.006  # finite difference of the alignment, canonical units, radians or log scale
    seed: int = 0


@dataclass(frozen=True)
class ShapeFit:
    """The result.

    params, canonical  parameters, and input_from_canonical under the name that all outputs use
    distance           D_chamfer to the input points, canonical units squared
    start              the same before polishing, of the best start
    hypothesis         how the input stands, in words
    alternatives       (words, distance) of other ways to stand and other choices, best first
    network            False when there were no weights and only random starts were used
    """

    params: Params
    canonical: Canonical
    distance: float
    start: float
    hypothesis: str
    alternatives: tuple[tuple[str, float], ...]
    network: bool


@dataclass(frozen=True)
class _State:
    """Scalars as shares of their ranges (n,), discrete values, and (5,) log scale, translation, yaw."""

    units: np.ndarray
    discrete: Params
    move: np.ndarray
    way: int


def run(model: Model, target: Target, options: ShapeFitOptions = ShapeFitOptions()) -> ShapeFit:
    """The best parameters found; deterministic by seed."""
    ways = hypotheses(target)
    search = _Search(model, target, ways, options)
    starts, network = _starts(search)
    start = search.final(starts[0])
    best = [search.polish(s, 3) for s in _spread(starts, options.keep)]
    best.sort(key=search.loss)
    # A runner-up that is far behind after polishing is not the start of the best.
    close = [s for s in best[:2] if search.loss(s) <= FAR * search.loss(best[0])]
    found = min(map(search.improve, close), key=search.loss)
    found = search.faced(search.polish(found, 8))
    alternatives = search.alternatives(found, starts)
    way = ways[found.way]
    return ShapeFit(
        params=search.params(found),
        canonical=Canonical(way.input_from_canonical @ _matrix(found.move)),
        distance=search.final(found),
        start=start,
        hypothesis=way.name,
        alternatives=alternatives,
        network=network,
    )


def _spread(starts: list[_State], keep: int) -> list[_State]:
    """The first of every way and discrete combination, `keep` of them."""
    chosen: dict[tuple, _State] = {}
    for s in starts:
        chosen.setdefault((s.way, *s.discrete.values()), s)
    return list(chosen.values())[:keep]


def _starts(search: _Search) -> tuple[list[_State], bool]:
    """Every start, best first by rough score, and whether the network could be asked."""
    model, options, ways = search.model, search.options, search.ways
    rng = np.random.default_rng(options.seed)
    guesses: list[list[Params]] = [[] for _ in ways]
    network = True
    try:
        answers = params_from_grids(load_network(model.space, model.weights), grids_of(search.target, ways))
        guesses = [[a] for a in answers]
    except WeightsError:
        network = False
    count = options.random if network else 3 * options.random
    common = [model.space.sample(rng) for _ in range(count)]
    bodies = [Body.of(model.build(p)) for p in common]
    rough = [{j: search.rough(i, bodies[j]) for j in range(0, count, options.sparse)} for i in range(len(ways))]
    scored = []
    for i in sorted(range(len(ways)), key=lambda i: min(rough[i].values()))[: options.ways]:
        rough[i] |= {j: search.rough(i, bodies[j]) for j in range(count) if j not in rough[i]}
    for i in range(len(ways)):
        scored += [(search.rough(i, Body.of(model.build(p))), i, 0, search.state(p, i)) for p in guesses[i]]
        scored += [(score, i, j + 1, search.state(common[j], i)) for j, score in rough[i].items()]
    scored.sort(key=lambda entry: entry[:3])
    # The network's own answers are always among those that go on, however they look before polishing.
    mine = sorted((e for e in scored if network and e[2] == 0), key=lambda e: e[0])[:2]
    return [e[3] for e in (*scored[:1], *mine, *scored[1:200])], network


class _Search:
    """The target in every way to stand, and steps from state to state."""

    def __init__(self, model: Model, target: Target, ways: list[Hypothesis], options: ShapeFitOptions) -> None:
        self.model, self.target, self.ways, self.options = model, target, ways, options
        self.free = not target.complete
        self.dead = 1.8 * target.spacing if self.free and target.spacing > 0.008 else 0.0
        self.reach = 0.15 if self.free else np.inf
        self._rough: dict[int, Score] = {}
        self._fine: dict[int, Score] = {}
        self._bodies: dict[tuple, Body] = {}

    def state(self, params: Params, way: int) -> _State:
        """A start: in the middle of its box."""
        units = np.array([s.unit_from_value(float(params[s.name])) for s in self.model.space.scalars])
        return _State(units, {p.name: params[p.name] for p in self.model.space.discrete}, np.zeros(5), way)

    def params(self, state: _State) -> Params:
        """Parameter values in the space's order."""
        scalars = self.model.space.scalars
        values = {s.name: s.value_from_unit(float(u)) for s, u in zip(scalars, state.units, strict=True)}
        return self.model.space.validate({**values, **state.discrete})

    def body(self, state: _State) -> Body:
        """The state's exact mesh; alignment alone does not build anew."""
        key = (state.units.tobytes(), *state.discrete.values())
        if key not in self._bodies:
            if len(self._bodies) > 100:
                self._bodies.clear()
            self._bodies[key] = Body.of(self.model.build(self.params(state)))
        return self._bodies[key]

    def rough(self, way: int, body: Body) -> float:
        """A quick score of a start."""
        if way not in self._rough:
            points = self.ways[way].points[:: max(1, len(self.ways[way].points) // 2000)]
            self._rough[way] = Score(points, self.options.rough, self.dead, self.reach)
        return self._rough[way](body)

    def score(self, way: int) -> Score:
        """The score that polishing uses."""
        if way not in self._fine:
            surface = None
            if len(self.target.triangles):
                forward = np.linalg.inv(self.ways[way].input_from_canonical)
                surface = Body(self.target.triangles @ forward[:3, :3].T + forward[:3, 3])
            points = self.ways[way].points
            self._fine[way] = Score(points, self.options.fine, self.dead, self.reach, surface=surface)
        return self._fine[way]

    def loss(self, state: _State) -> float:
        """What polishing lowers."""
        score, body = self.score(state.way), self.body(state)
        return float(np.square(self._residuals(state, score, score.places(body))).sum())

    def _residuals(self, state: _State, score: Score, places: Places) -> np.ndarray:
        if not self.free:
            return score.residuals(self.body(state), places)
        main = score.residuals(self.body(state), places, _matrix(state.move))
        # The cloud's box is the object's to within about its spacing.
        return np.concatenate([main, 0.1 * state.move])

    def polish(self, state: _State, steps: int) -> _State:
        """Gauss-Newton steps of the scalars and, for clouds, the alignment."""
        n, score, damping = len(state.units), self.score(state.way), 1e-2
        loss = self.loss(state)
        for _ in range(steps):
            places = score.places(self.body(state))
            here = self._residuals(state, score, places)
            slopes = []
            for delta in self._deltas(state):
                size = delta.sum()
                slopes.append((self._residuals(_moved(state, delta, n), score, places) - here) / size)
            if not slopes or any(len(s) != len(here) for s in slopes):
                return state
            J = np.stack(slopes, 1)
            hessian, gradient = J.T @ J, J.T @ here
            for _ in range(3):
                step = -np.linalg.solve(hessian + np.diag(damping * np.diag(hessian) + 1e-6), gradient)
                trial = _moved(state, np.clip(step, -0.25, 0.25), n)
                if (trial_loss := self.loss(trial)) < loss * (1 - 1e-4):
                    break
                damping *= 8
            else:
                return state
            gain, state, loss, damping = loss - trial_loss, trial, trial_loss, damping / 4
            if gain < 1e-2 * loss:
                break
        return state

    def _deltas(self, state: _State) -> Iterator[np.ndarray]:
        """One finite difference each; a scalar in the upper half is probed downwards."""
        n = len(state.units)
        sizes = np.where(state.units > 0.5, -1, 1) * self.options.step
        yield from np.diag(np.concatenate([sizes, np.full(5 if self.free else 0, self.options.move_step)]))[: n + 5]

    def neighbours(self, state: _State) -> Iterator[tuple[str, _State]]:
        """States that differ in one choice, flag or integer."""
        for p in self.model.space.discrete:
            for i in range(p.grid_steps):
                if (value := p.grid_value(i)) != state.discrete[p.name]:
                    yield f"{p.name} = {value}", replace(state, discrete={**state.discrete, p.name: value})

    def improve(self, state: _State) -> _State:
        """Change one choice at a time while that helps, polishing the most promising."""
        loss = self.loss(state)
        for _ in range(self.options.sweeps):
            ranked = sorted(((self.loss(s), i, s) for i, (_, s) in enumerate(self.neighbours(state))))
            trials = [self.polish(s, 2) for _, _, s in ranked[: self.options.tries]]
            best = min(trials, key=self.loss, default=state)
            if (lower := self.loss(best)) >= loss * (1 - 1e-3):
                break
            state, loss = best, lower
        return state

    def faced(self, state: _State) -> _State:
        """The state, or the same object facing the other way when its values say that it is seen from behind and it
        lies nearly as close."""
        other = self.model.turned_round(self.params(state)) if self.model.turned_round else None
        half = np.diag([-1.0, -1, 1])
        here = self.ways[state.way].input_from_canonical[:3, :3]
        ways = [i for i, w in enumerate(self.ways) if np.allclose(w.input_from_canonical[:3, :3], here @ half)]
        if other is None or not ways:
            return state
        mirrored = state.move * (1, -1, -1, 1, 1)
        turned = replace(self.state(other, ways[0]), move=mirrored)
        found = self.polish(self.improve(self.polish(turned, 3)), 8)
        return found if self.loss(found) <= (1 + NEARLY) * self.loss(state) + 2e-5 else state

    def alternatives(self, found: _State, starts: list[_State]) -> tuple[tuple[str, float], ...]:
        """Other choices as they are, and the best start of every other way to stand, by distance."""
        others = [(name, self.loss(s)) for name, s in self.neighbours(found)]
        seen = {found.way}
        for s in starts:
            if s.way not in seen:
                seen.add(s.way)
                others.append((self.ways[s.way].name, self.loss(s)))
        return tuple(sorted(others, key=lambda pair: pair[1]))

    def final(self, state: _State) -> float:
        """D_chamfer to the input points where the result stands: everything counts, nothing is cut."""
        score = Score(self.ways[state.way].points, 5_000)
        return score(self.body(state), _matrix(state.move))


def _moved(state: _State, delta: np.ndarray, n: int) -> _State:
    move = state.move + (delta[n:] if len(delta) > n else 0)
    return replace(state, units=np.clip(state.units + delta[:n], 0, 1), move=move)


def _matrix(move: np.ndarray) -> np.ndarray:
    """(4, 4) similarity of (log scale, translation, yaw in radians)."""
    c, s = np.cos(move[4]), np.sin(move[4])
    out = np.eye(4)
    out[:3, :3] = np.exp(move[0]) * np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)])
    out[:3, 3] = move[1:4]
    return out
