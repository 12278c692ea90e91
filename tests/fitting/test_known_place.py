"""Parameters found on the exact model from exact masks or grids, and nothing made worse."""

import numpy as np
import pytest

from datasets.voxels import surface_grid
from recon.evaluate.data.held_out import cameras, masks
from recon.fitting import known_place
from recon.fitting.search import Schedule

CHAIR = {"width": 0.62, "depth": 0.47, "leg_height": 0.41, "legs": "round", "arms": "solid", "back": "hbar"}
AWAY = {**CHAIR, "width": 0.7, "depth": 0.53, "leg_height": 0.36, "arms": "none", "back": "vbar"}
NOWHERE = np.zeros(0)


@pytest.fixture
def in_masks(chair):
    K, poses = (c.numpy() for c in cameras("spread"))
    return known_place.in_masks(chair, masks(chair.build(CHAIR), "spread").numpy() > 0.5, K, poses)


@pytest.fixture
def in_grid(chair):
    shape = chair.build(CHAIR)
    return known_place.in_grid(chair, surface_grid(shape.vertices(), shape.triangles()))


def _close(problem, found, share):
    params = problem.params(found.state)
    for s in problem.scalars:
        assert params[s.name] == pytest.approx(CHAIR[s.name], abs=share * (s.high - s.low))
    return {k: v for k, v in params.items() if isinstance(v, str)} == {
        k: v for k, v in CHAIR.items() if isinstance(v, str)
    }


def test_a_chair_off_the_grid_is_found_from_four_masks(in_masks):
    found = known_place.run(in_masks, [AWAY])
    assert _close(in_masks, found, 0.005)
    assert found.loss < known_place.losses(in_masks)[0] < found.start


def test_a_chair_off_the_grid_is_found_from_its_grid(in_grid):
    found = known_place.run(in_grid, [AWAY])
    assert _close(in_grid, found, 0.03), "voxels are 0.016 wide"
    assert found.loss < known_place.losses(in_grid)[0] < found.start


@pytest.mark.parametrize("start", [CHAIR, {**AWAY, "legs": "office"}])
def test_no_start_is_made_worse(in_masks, start):
    found = known_place.run(in_masks, [start], Schedule(looked=1, sweeps=1, tries=1, far=1, steps=(1, 1, 1)))
    assert found.loss <= found.start
    assert found.loss == in_masks.target.loss(in_masks.posed(found.state))


def test_the_true_shape_has_no_loss(in_masks, in_grid):
    assert in_masks.loss(in_masks.state(CHAIR, NOWHERE)) == 0
    assert in_grid.loss(in_grid.state(CHAIR, NOWHERE)) == 0
    assert in_grid.smooth(in_grid.state(CHAIR, NOWHERE), 1) < 1e-5


def test_a_loss_is_the_share_of_pixels_that_thresholds_speak_of(in_masks):
    """The thresholds count pixels of the images, the loss those of the object."""
    target, away = in_masks.target, in_masks.state(AWAY, NOWHERE)
    differing = target.loss(in_masks.posed(away)) * target.weight
    drawn = masks(in_masks.shape(away), "spread").numpy() > 0.5
    assert differing == pytest.approx(np.mean(drawn != target.hard), rel=0.25)


def test_mask_residuals_are_smooth_in_the_scalars(in_masks):
    """A difference of half the size is half as large: what Gauss-Newton needs."""
    state = in_masks.state({**AWAY, "arms": "solid", "back": "hbar"}, NOWHERE)
    for level in range(in_masks.target.levels):
        here = in_masks.residuals(state, level)
        for direction in np.eye(3):
            near, far = (in_masks.residuals(in_masks.moved(state, h * direction), level) - here for h in (1e-3, 2e-3))
            assert np.linalg.norm(far - 2 * near) < 0.2 * np.linalg.norm(far)


def test_what_the_views_do_not_show_stands_in_the_middle(chair):
    K, poses = (c.numpy()[:1] for c in cameras("spread"))
    poses[:, 2, 3] = -9  # the chair is behind the camera
    problem = known_place.in_masks(chair, np.zeros((1, 128, 128), bool), K, poses)
    found = known_place.run(problem, [CHAIR])
    assert found.loss == 0
    assert found.state.units == pytest.approx(np.full(3, 0.5), abs=0.01)
