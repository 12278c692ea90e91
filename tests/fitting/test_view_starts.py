"""Starts from a network that only reads shapes: its decoder is never asked, whatever the options say."""

from dataclasses import replace

import pytest

from nnproc.infer import save_network
from nnproc.latent_fit import FitOptions as LatentOptions
from nnproc.network import NetworkConfig, NNProc
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.fitting import shape_fit, view_starts
from recon.fitting.shape_fit import ShapeFitOptions
from recon.fitting.shape_starts import StartOptions
from recon.fitting.view_starts import FitOptions
from recon.geometry import visual_hull
from recon.shapes import shape_target
from tests.fitting.toy_models import boards

SMALL = FitOptions(likely=4, random=6, kept=30)


@pytest.fixture
def model(tmp_path):
    """Boards whose network, untrained, has no decoder."""
    made = replace(boards(2, flags=1, kinds=2), weights=tmp_path / "boards.safetensors")
    network = NNProc(made.space, NetworkConfig(hidden=32))
    network.has_decoder = False
    save_network(made.weights, network)
    return made


def test_views_start_from_what_it_reads_off_the_hull(model):
    cameras, place = orbit(6, seed=0)
    seen = drawn_scene(model.build(model.space.usual), cameras, place)
    hull = visual_hull.run(seen)
    found = view_starts.run(model, seen, hull, SMALL)
    assert len({c.turn for c in found.candidates}) == 4
    asked = replace(SMALL, latent=LatentOptions(starts=2, keep=1, steps=2))
    assert view_starts.run(model, seen, hull, asked) == found


def test_shapes_start_from_what_it_reads_off_their_grids(model):
    shape = model.build(model.space.usual)
    target = shape_target.of_triangles(shape.vertices()[shape.triangles()], ("z",), "boards")
    few = ShapeFitOptions(StartOptions(random=4, points=50), fine=100, keep=1, sweeps=1, tries=1)
    assert shape_fit.run(model, target, few).network
