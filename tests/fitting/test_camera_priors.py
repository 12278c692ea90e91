"""What an unlikely picture costs: nothing for an ordinary one, and in the direction that each prior says."""

import numpy as np
import pytest

from procmodels import load, names
from recon.fitting.camera_priors import PriorOptions, roots

LEVEL = np.array([0.0, -1, 0])  # the vertical in a level camera's frame


def cost(up=LEVEL, azimuth=0.0, elevation=20.0, zoom=1.0, extent=(0.5, 0.5, 1.0), usual=(0.0, 0.2)):
    found = roots(np.array(up), azimuth, elevation, zoom, np.array(extent), usual, PriorOptions())
    assert found.shape == (6,)
    return float((found**2).sum())


def test_an_ordinary_picture_costs_nothing():
    assert cost() == 0
    assert cost(elevation=40) == cost(elevation=0) == 0


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"up": (np.sin(np.radians(8)), -np.cos(np.radians(8)), 0)}, 0.004),
        ({"zoom": 1.8}, 0.003),
        ({"zoom": 1 / 1.8}, 0.003),
        ({"elevation": 48.0}, 0.004),
        ({"elevation": -8.0}, 0.004),
        ({"azimuth": 180.0}, 0.01),
        ({"azimuth": 90.0}, 0.005),
        ({"extent": (0.5, 0.5 * np.exp(0.2), 1)}, 0.004),
        ({"extent": (0.5, 0.1, 1)}, 0.036),  # at most three spreads
        ({"extent": (0.5, 0.1, 1), "usual": None}, 0.0),
    ],
)
def test_each_prior_costs_what_it_says(changes, expected):
    assert cost(**changes) == pytest.approx(expected, abs=1e-9)


def test_every_class_says_how_deep_real_ones_are():
    for name in names():
        usual = load(name).usual_depth
        assert usual is not None
        assert usual[1] > 0


def test_a_bed_with_the_higher_board_at_its_foot_is_turned():
    bed = load("bed")
    params = bed.space.sample(np.random.default_rng(0))
    params = {**params, "headboard_height": 0.1, "footboard_height": 0.5, "pillows": 0}
    other = bed.turned_round(params)
    assert bed.turned_round(other) is None
    there = bed.build(params).vertices() * (-1, -1, 1)
    back = bed.build(other).vertices()
    assert np.allclose(np.sort(there, axis=0), np.sort(back, axis=0), atol=1e-6)
