"""What is told beside an answer is never better than it; an answer that is beaten by its neighbour gives way."""

import numpy as np
import pytest

from procmodels import load
from recon.fitting import uncertainty
from recon.fitting.moves import Choose
from recon.fitting.placement import Upright
from recon.fitting.problem import Problem
from recon.fitting.search import Schedule, Search
from recon.fitting.surface_target import Surface
from recon.geometry.triangles import Triangles

CHAIR = {"width": 0.45, "depth": 0.5, "leg_height": 0.42, "legs": "support", "arms": "none", "back": "hbar"}
NOWHERE = np.zeros(5)


@pytest.fixture(scope="module")
def search():
    chair = load("paper/chair")
    surface = Triangles.of(chair.build(CHAIR))
    target = Surface(surface.at(surface.places(4000))[0], (400,), surface)
    return Search(Problem(chair, target, Upright([np.eye(4)])), Schedule(fronts=False, steps=(2, 2, 3)))


@pytest.mark.parametrize("wrong", [{}, {"arms": "basic"}, {"legs": "round", "width": 0.5}])
def test_no_neighbour_is_better_than_the_answer(search, wrong):
    problem = search.problem
    state, neighbours = search.compared(problem.state(CHAIR | wrong, NOWHERE))
    assert problem.params(state)["arms"] == "none"
    assert problem.params(state)["legs"] == "support"
    assert min(problem.loss(other) for _, other in neighbours) >= problem.loss(state)
    behind = search.behind(state, neighbours)
    assert [off for _, off in behind] == sorted(off for _, off in behind)
    assert behind[0][1] > 0


def test_every_other_value_of_every_choice_is_told(search):
    state = search.problem.state(CHAIR, NOWHERE)
    told = {move.values[0] for move, _ in search.polished_neighbours(state) if isinstance(move, Choose)}
    values = {p.name: set(p.values) for p in search.problem.model.space.discrete}
    assert told == {(n, v) for n, all_of_it in values.items() for v in all_of_it if v != CHAIR[n]}


def test_rivals_are_polished_and_name_the_parts_that_they_lack(search):
    state = search.problem.state(CHAIR, NOWHERE)
    sure = uncertainty.run(search, state)
    assert set(sure.choices) == {"legs", "arms", "back"}
    for name, choice in sure.choices.items():
        assert choice.rival != CHAIR[name]
        plain = Choose(((name, choice.rival),)).applied(search.problem, state)
        assert choice.gap <= search.problem.loss(plain) - search.problem.loss(state) + 1e-12
    own = {p.name for p in search.problem.shape(state).parts}
    assert set(sure.choices["back"].parts) <= own
    assert sure.choices["back"].parts
    assert not sure.choices["arms"].parts, "a chair without arms has no part for it"
