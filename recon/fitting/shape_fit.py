"""Find the parameters whose exact mesh lies nearest to a shape: starts, one-at-a-time choices, Gauss-Newton.

Starts are the network's answer for every way to stand, and a spread of random shapes compared with all of them. The
best few are polished on the exact model. A mesh fills its own box, so its place is known and stays; a cloud's box is
only near, so that scale, translation and a small turn are fitted too, held to the box by the cloud's spacing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from procmodels import Model
from procmodels.space import Params
from recon.fitting import beliefs, evidence, moves, shape_starts, uncertainty
from recon.fitting.evidence import Evidence
from recon.fitting.placement import Upright
from recon.fitting.problem import Problem
from recon.fitting.search import Neighbour, Schedule, Search, solve, turned_round
from recon.fitting.shape_starts import GAPPY, StartOptions, problem_of
from recon.fitting.state import State
from recon.fitting.surface_target import Surface
from recon.fitting.uncertainty import Calibration, Certainty
from recon.scene import Canonical
from recon.shapes.shape_target import Hypothesis, Target, hypotheses

NEARLY = 0.15  # of the distance: so much farther may the likelier of two fronts be
OTHERS = 2  # other ways to stand that are polished before they are told


@dataclass(frozen=True)
class ShapeFitOptions:
    """How wide and how long the search is; a build with its distances takes about 4 ms."""

    starts: StartOptions = field(default_factory=StartOptions)
    fine: int = 1_200  # points each way when polishing
    keep: int = 4  # starts that are polished
    sweeps: int = 4  # rounds of changing one choice
    tries: int = 2  # most promising changes of a round that are polished
    seed: int = 0


@dataclass(frozen=True)
class ShapeFit:
    """The result.

    params, canonical  parameters, and input_from_canonical under the name that all outputs use
    distance           D_chamfer to the input points, canonical units squared
    start              the same before polishing, of the best start
    hypothesis         how the input stands, in words
    alternatives       (words, distance) of other ways to stand and other choices, best first; none is better than the
                       answer by what accepted it
    network            False when there were no weights and only random starts were used
    certainty          how sure each parameter is
    evidence           what speaks for the answer and against it
    """

    params: Params
    canonical: Canonical
    distance: float
    start: float
    hypothesis: str
    alternatives: tuple[tuple[str, float], ...]
    network: bool
    certainty: Certainty
    evidence: Evidence


def run(model: Model, target: Target, options: ShapeFitOptions = ShapeFitOptions()) -> ShapeFit:
    """The best parameters found, and how sure they are; deterministic by seed."""
    solved = _solved(model, target, options)
    search, ways, problem = solved.search, solved.ways, solved.search.problem
    found, near_by = _answer(search, solved.state, solved.starts)
    distance = _final(problem, found, ways)
    return ShapeFit(
        params=problem.params(found),
        canonical=_place(problem, found, ways),
        distance=distance,
        start=_final(problem, solved.starts[0], ways),
        hypothesis=ways[found.front].name,
        alternatives=tuple((_words(m, ways), distance + off) for m, off in search.behind(found, near_by)),
        network=solved.network,
        certainty=uncertainty.run(search, found, _calibration(model, target), near_by),
        evidence=_evidence(problem, found, ways, target),
    )


def nearest(model: Model, target: Target, options: ShapeFitOptions = ShapeFitOptions()) -> tuple[Params, Canonical]:
    """The best parameters found and where they stand, without asking how sure they are."""
    solved = _solved(model, target, options)
    found = _turned(solved.search, solved.state)
    return solved.search.problem.params(found), _place(solved.search.problem, found, solved.ways)


@dataclass(frozen=True)
class _Solved:
    """The best state of a search, and what it began with: starts, best first, and whether a network gave some."""

    search: Search
    state: State
    ways: list[Hypothesis]
    starts: list[State]
    network: bool


def _solved(model: Model, target: Target, options: ShapeFitOptions) -> _Solved:
    ways = hypotheses(target)
    problem = problem_of(model, target, ways, options.fine)
    starts, network = shape_starts.run(problem, target, ways, options.starts, options.seed)
    chosen: dict[tuple, State] = {}
    for s in starts:
        chosen.setdefault((s.front, *s.choices.values()), s)
    schedule = Schedule(
        looked=options.keep,
        starts=options.keep,
        behind=2.0,
        sweeps=options.sweeps,
        tries=options.tries,
        fronts=False,
    )
    state = solve(problem, chosen.values(), schedule).state
    return _Solved(Search(problem, schedule), state, ways, starts, network)


def _turned(search: Search, state: State) -> State:
    """The state, or what faces the likelier way."""
    return turned_round(search, state, lambda loss: (1 + NEARLY) * loss + 2e-5)


def _in_way(problem: Problem, state: State) -> np.ndarray:
    """(4, 4) similarity: where the shape stands in the frame of its way to stand."""
    way_from_target = np.linalg.inv(
        problem.placement.posed(problem.shape(state), np.zeros(5), state.front).target_from_shape
    )
    return way_from_target @ problem.posed(state).target_from_shape


def _place(problem: Problem, state: State, ways: list[Hypothesis]) -> Canonical:
    return Canonical(ways[state.front].input_from_canonical @ _in_way(problem, state))


def _answer(search: Search, state: State, starts: list[State]) -> tuple[State, list[Neighbour]]:
    """The state, or what beat it when its choices and other ways to stand were tried, and those."""
    problem = search.problem
    state, near_by = search.compared(state)
    others = _elsewhere(search, state, starts)
    best = min((s for _, s in others), key=problem.loss, default=state)
    if problem.loss(best) < problem.loss(state):
        state, near_by = search.compared(search.finished(search.improved(best)))
        others = _elsewhere(search, state, starts)
    round_ = _turned(search, state)
    if round_ is not state:
        state, near_by = round_, search.polished_neighbours(round_)
        others = _elsewhere(search, state, starts)
    return state, [*near_by, *others]


def _elsewhere(search: Search, state: State, starts: list[State]) -> list[Neighbour]:
    """The best start of every other way to stand, the first few of them polished."""
    first: dict[int, State] = {}
    for s in starts:
        if s.front != state.front:
            first.setdefault(s.front, s)
    ranked = search.ranked(first.values())
    polished = [search.step(s, search.schedule.steps[0]) for s in ranked[:OTHERS]] + ranked[OTHERS:]
    return [(moves.Face(s.front, 0), s) for s in polished]


def _calibration(model: Model, target: Target) -> Calibration:
    return beliefs.calibration_of(beliefs.table(model.space, kind_of(target)))


def kind_of(target: Target) -> str:
    """The kind of input that beliefs about it go by."""
    return "mesh" if target.complete else "cloud"


def _words(move: moves.Move, ways: list[Hypothesis]) -> str:
    return ways[move.front].name if isinstance(move, moves.Face) else str(move)


def _evidence(problem: Problem, state: State, ways: list[Hypothesis], target: Target) -> Evidence:
    """What the input's points say of the answer where it stands."""
    shape_from_way = np.linalg.inv(_in_way(problem, state))
    points = ways[state.front].points @ shape_from_way[:3, :3].T + shape_from_way[:3, 3]
    spacing = 0.0 if target.complete else GAPPY * target.spacing
    return evidence.of_surfaces(problem.model.space, problem.params(state), problem.shape(state), points, spacing)


def _final(problem: Problem, state: State, ways: list[Hypothesis]) -> float:
    """D_chamfer to the input points where the result stands: everything counts, nothing is cut."""
    alone = Problem(problem.model, Surface(ways[state.front].points, (5_000,)), Upright([np.eye(4)]))
    return alone.loss(alone.state(problem.params(state), state.place))
