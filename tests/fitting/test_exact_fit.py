"""Parameters found on the exact model from exact masks or grids, and nothing made worse."""

import numpy as np
import pytest

from datasets.voxels import surface_grid
from recon.evaluate.data.held_out import cameras, masks
from recon.fitting import exact_fit
from recon.fitting.exact_moves import ExactOptions, Moves, moved
from recon.fitting.exact_targets import GridTarget, MaskTarget

CHAIR = {"width": 0.62, "depth": 0.47, "leg_height": 0.41, "legs": "round", "arms": "solid", "back": "hbar"}
AWAY = {**CHAIR, "width": 0.7, "depth": 0.53, "leg_height": 0.36, "arms": "none", "back": "vbar"}


@pytest.fixture(scope="module")
def mask_target(chair):
    K, poses = (c.numpy() for c in cameras("spread"))
    return MaskTarget(masks(chair.build(CHAIR), "spread").numpy() > 0.5, K, poses)


@pytest.fixture(scope="module")
def grid_target(chair):
    shape = chair.build(CHAIR)
    return GridTarget(surface_grid(shape.vertices(), shape.triangles()))


def _close(chair, found, share):
    for s in chair.space.scalars:
        assert found[s.name] == pytest.approx(CHAIR[s.name], abs=share * (s.high - s.low))
    return {k: v for k, v in found.items() if isinstance(v, str)} == {
        k: v for k, v in CHAIR.items() if isinstance(v, str)
    }


def test_a_chair_off_the_grid_is_found_from_four_masks(chair, mask_target):
    found = exact_fit.run(chair, mask_target, [AWAY])
    assert _close(chair, found.params, 0.005)
    assert found.loss < mask_target.good < found.start_loss


def test_a_chair_off_the_grid_is_found_from_its_grid(chair, grid_target):
    found = exact_fit.run(chair, grid_target, [AWAY])
    assert _close(chair, found.params, 0.03), "voxels are 0.016 wide"
    assert found.loss < grid_target.good < found.start_loss


@pytest.mark.parametrize("start", [CHAIR, {**AWAY, "legs": "office"}])
def test_no_start_is_made_worse(chair, mask_target, start):
    options = ExactOptions(sweeps=1, tries=1, far=1, steps=(1, 1, 1))
    found = exact_fit.run(chair, mask_target, [start], options)
    assert found.loss <= found.start_loss
    assert found.loss == mask_target.loss(chair.build(found.params))


def test_the_true_shape_has_no_loss(chair, mask_target, grid_target):
    shape = chair.build(CHAIR)
    assert mask_target.loss(shape) == grid_target.loss(shape) == 0
    assert np.square(grid_target.residuals(shape, 1, shape)).sum() < 1e-5


def test_mask_residuals_are_smooth_in_the_scalars(chair, mask_target):
    """A difference of half the size is half as large: what Gauss-Newton needs."""
    moves = Moves(chair, mask_target, ExactOptions())
    state = moves.state({**AWAY, "arms": "solid", "back": "hbar"})
    reference = moves.shape(state)
    for level in range(mask_target.levels):
        here = moves.residuals(state, level, reference)
        for direction in np.eye(3):
            near, far = (moves.residuals(moved(state, h * direction), level, reference) - here for h in (1e-3, 2e-3))
            assert np.linalg.norm(far - 2 * near) < 0.2 * np.linalg.norm(far)


def test_what_the_views_do_not_show_stands_in_the_middle(chair):
    K, poses = (c.numpy()[:1] for c in cameras("spread"))
    poses[:, 2, 3] = -9  # the chair is behind the camera
    found = exact_fit.run(chair, MaskTarget(np.zeros((1, 128, 128), bool), K, poses), [CHAIR])
    assert found.loss == 0
    for s in chair.space.scalars:
        assert s.unit_from_value(found.params[s.name]) == pytest.approx(0.5, abs=0.01)
