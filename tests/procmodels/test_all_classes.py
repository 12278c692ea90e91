"""Every class from exact silhouettes of an unseen shape: alignment, front, fit and refinement together."""

import numpy as np
import pytest

from procmodels import load, names
from recon.evaluate.chair import from_silhouettes
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.evaluate.metrics import chamfer
from recon.scene import ReconstructionError


@pytest.mark.slow
@pytest.mark.parametrize("name", names())
def test_a_class_is_found_again_from_its_silhouettes(name):
    model = load(name)
    params = model.space.sample(np.random.default_rng([77, len(name)]))
    cameras, place = orbit(16, seed=len(name))
    try:
        refined = from_silhouettes(model, *drawn_scene(model.build(params), cameras, place))
    except ReconstructionError as error:
        pytest.fail(str(error))
    assert refined.mean_iou > 0.95
    assert chamfer(model.build(refined.params).to_trimesh(), model.build(params).to_trimesh(), 4000) < 0.002
