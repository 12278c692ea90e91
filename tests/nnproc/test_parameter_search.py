"""The search over SD(PE(p)): an exact bank, a bias that vanishes where it was measured, and a shape found again."""

import numpy as np
import pytest
import torch

from nnproc.infer import load_network
from nnproc.parameter_search import SearchOptions, bank, draw_silhouettes, search
from recon.evaluate.data.held_out import masks, operator

SHAPE = {"width": 0.56, "depth": 0.47, "leg_height": 0.43, "legs": "round", "arms": "solid", "back": "vbar"}
BRIEF = SearchOptions(starts=4, keep=(4, 2), newton_steps=2)


@pytest.fixture(scope="module")
def rays():
    return operator("spread", stride=4)


@pytest.fixture(scope="module")
def known(chair, rays):
    """60 random chairs and what their exact outlines show; none has the values of SHAPE."""
    rng = np.random.default_rng(11)
    params = [chair.space.sample(rng, on_grid=True) for _ in range(60)]
    seen = [rays.gather(masks(chair.build(p), "spread")).numpy() > 0.5 for p in params]
    return bank(torch.from_numpy(np.stack([chair.space.encode(p) for p in params])), seen)


def test_the_bank_gives_back_what_it_was_given():
    rng = np.random.default_rng(0)
    seen = rng.random((50, 333)) < 0.3
    kept = bank(torch.zeros(50, 2), list(seen))
    assert kept.n == 333
    index = torch.tensor([3, 49, 0])
    assert (kept.exact(index).numpy() == seen[index]).all()


def test_nearest_is_exact():
    rng = np.random.default_rng(0)
    for n in (8, 15, 16, 17, 333):
        seen = rng.random((50, n)) < 0.3
        target = rng.random(n) < 0.3
        kept = bank(torch.zeros(50, 2), list(seen))
        expected = np.argsort((seen ^ target).sum(1), kind="stable")
        assert kept.nearest(torch.from_numpy(target).float(), 7).tolist() == expected[:7].tolist()


def test_a_shape_of_the_bank_is_its_own_nearest(known):
    for i in (0, 31, 59):
        found = int(known.nearest(known.exact(torch.tensor([i]))[0], 1)[0])
        assert torch.equal(known.exact(torch.tensor([found])), known.exact(torch.tensor([i])))


def test_corrected_at_a_shape_of_the_bank_nothing_is_left(chair, rays, known):
    network = load_network(chair.space, chair.weights)
    target = known.exact(torch.tensor([17]))[0]
    still = SearchOptions(starts=1, keep=())
    corrected, plain = (
        search(network, draw_silhouettes(rays), target, known, still, corrected=c)[0] for c in (True, False)
    )
    assert corrected.loss == pytest.approx(0, abs=1e-9)
    assert plain.loss > 1e-5, "the network's grids are thicker than the mesh"
    assert torch.allclose(corrected.vector, known.vectors[17])


def test_a_chair_is_found_again_from_its_outlines(chair, rays, known):
    network = load_network(chair.space, chair.weights)
    target = rays.gather(masks(chair.build(SHAPE), "spread"))
    found = search(network, draw_silhouettes(rays), target, known, BRIEF)
    assert [f.loss for f in found] == sorted(f.loss for f in found)
    best = found[0].params
    assert {p.name: best[p.name] for p in chair.space.discrete} == {p.name: SHAPE[p.name] for p in chair.space.discrete}
    for s in chair.space.scalars:
        assert best[s.name] == pytest.approx(SHAPE[s.name], abs=0.25 * (s.high - s.low)), s.name
