"""Where the search on a shape begins: the network's answers for every way to stand, and random shapes.

A way to stand that the network meets far better than others is taken for it: the rest is looked at no closer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nnproc.infer import WeightsError, likely_params, load_network
from procmodels import Model
from recon.fitting.placement import Upright
from recon.fitting.problem import Problem
from recon.fitting.state import State
from recon.fitting.surface_target import Surface
from recon.geometry.triangles import Triangles
from recon.shapes.shape_target import Hypothesis, Target, grids_of

GAPS = 0.008  # of the longest side: clouds of a larger spacing have gaps that mean nothing
GAPPY = 1.8  # spacings of a cloud within which it says nothing
REACH = 0.15  # canonical units: what of a cloud lies farther away is not of this class


@dataclass(frozen=True)
class StartOptions:
    """How wide the search begins; a build with its rough distances takes about a millisecond."""

    likely: int = 8  # combinations of choices of the network's answer for each way to stand
    random: int = 96  # random shapes beside the network's answers
    ways: int = 4  # ways to stand that all random shapes are compared with, the best by every `sparse`-th of them
    sparse: int = 4
    far: float = 4.0  # times the loss of the network's best: ways beyond are not looked at, but for the `ways` best
    points: int = 250  # each way when starts are compared
    keep: int = 4  # of the network's answers that go on, however they look before polishing


def problem_of(model: Model, target: Target, ways: list[Hypothesis], count: int, thin: int = 1) -> Problem:
    """Every thin-th of the target's points in the frame of its first way to stand, `count` of them each way."""
    first_from_input = np.linalg.inv(ways[0].input_from_canonical)
    mesh = None
    if len(target.triangles):
        mesh = Triangles(target.triangles @ first_from_input[:3, :3].T + first_from_input[:3, 3])
    loose = not target.complete
    surface = Surface(
        ways[0].points[::thin],
        (count,),
        mesh if thin == 1 else None,
        dead=GAPPY * target.spacing if loose and target.spacing > GAPS else 0.0,
        reach=REACH if loose else np.inf,
    )
    return Problem(model, surface, Upright([first_from_input @ w.input_from_canonical for w in ways], loose))


def run(
    problem: Problem, target: Target, ways: list[Hypothesis], options: StartOptions, seed: int = 0
) -> tuple[list[State], bool]:
    """Every start, best first by rough score, and whether the network could be asked."""
    model, rng, nowhere = problem.model, np.random.default_rng(seed), np.zeros(5)
    rough = problem_of(model, target, ways, options.points, max(1, len(target.points) // 2000))
    told: list[list[State]] = []
    try:
        network = load_network(model.space, model.weights)
        answers = likely_params(network, grids_of(target, ways), options.likely)
        told = [[rough.state(a, nowhere, i) for a in some] for i, some in enumerate(answers)]
    except WeightsError:
        pass
    close = _close([rough.loss(some[0]) for some in told], options) if told else list(range(len(ways)))
    mine = [s for i, some in enumerate(told) for s in (some if i in close else some[:1])]
    drawn = [model.space.sample(rng) for _ in range(options.random if mine else 3 * options.random)]
    scored: dict[tuple[int, int], float] = {}

    def score(way: int, numbers: range) -> None:
        for j in numbers:
            if (way, j) not in scored:
                scored[way, j] = rough.loss(rough.state(drawn[j], nowhere, way))

    for i in close:
        score(i, range(0, len(drawn), options.sparse))
    best = {i: min(loss for (way, _), loss in scored.items() if way == i) for i in close}
    for i in sorted(best, key=best.__getitem__)[: options.ways]:
        score(i, range(len(drawn)))
    others = [(loss, i, rough.state(drawn[j], nowhere, i)) for (i, j), loss in scored.items()]
    entries = [(rough.loss(s), s.front, s) for s in mine] + others
    entries.sort(key=lambda e: e[:2])
    first = sorted(mine, key=rough.loss)[: options.keep]
    return [e[2] for e in entries[:1]] + first + [e[2] for e in entries[1:200]], bool(mine)


def _close(losses: list[float], options: StartOptions) -> list[int]:
    """The ways to stand that are looked at, by the losses of the network's likeliest answers."""
    order = [int(i) for i in np.argsort(losses, kind="stable")]
    near = [i for i in order if losses[i] <= options.far * losses[order[0]]]
    return sorted({*order[: options.ways], *near})
