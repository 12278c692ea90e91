"""Generated sets: shapes of training and test kept apart, whatever the size of the grid."""

from pathlib import Path

import numpy as np
import pytest

from datasets.synthetic import SyntheticOptions, generate, read, shape_params
from procmodels.conditions import when
from procmodels.model import Model
from procmodels.parts.primitives import box
from procmodels.space import Choice, Integer, ParamSpace, Scalar

LEGS = tuple(Scalar(f"leg_{i}", 0.1, 1.0, 50) for i in range(8))
BARS = Integer("bars", 1, 3, only_if=when("back").is_("bars"))


def _model(*parameters):
    space = ParamSpace("blocks", parameters)

    def build(params):
        size = float(params.get("leg_0", 0.5))
        return [box("seat", (0, 0, 0), (1, 1, 0.1)), box("leg", (0, 0, -size), (0.1, 0.1, 0))]

    return Model("blocks", space, build, Path("blocks.safetensors"))


def _sets(model, count):
    options = SyntheticOptions(train_on=count, test_on=count)
    return [
        [tuple(shape_params(model, which, i, options).values()) for i in range(count)]
        for which in ("train_on", "test_on")
    ]


@pytest.mark.parametrize(
    "parameters", [LEGS, (Choice("back", ("none", "bars")), BARS, *LEGS[:2])], ids=["huge grid", "conditions"]
)
def test_sets_share_no_shape_and_listing_no_grid(parameters):
    model = _model(*parameters)
    train, test = _sets(model, 300)
    assert not set(train) & set(test)
    assert len(set(train)) > 280
    assert _sets(model, 300) == [train, test], "the same again"
    steps = {p.name: p for p in model.space.parameters}["leg_1"]
    column = list(model.space.by_name).index("leg_1")
    places = np.array([float(row[column]) for row in train + test])
    index = (places - steps.low) / (steps.high - steps.low) * 49
    assert np.abs(index - index.round()).max() < 1e-6, "on the grid"


def test_a_grid_too_small_for_two_sets_is_said():
    model = _model(Choice("back", ("none", "bars")), Integer("bars", 1, 1, only_if=when("back").is_("bars")))
    with pytest.raises(ValueError, match="too small"):
        # Only two shapes: one of the sets has none, or hardly any.
        _sets(model, 3)


def test_shapes_of_a_huge_space_are_written_and_read(tmp_path):
    model = _model(*LEGS)
    generate(model, tmp_path, SyntheticOptions(train_on=4, train_off=3, test_on=2, test_off=1))
    pairs = read(tmp_path, "train_on", model.space.hash)
    assert pairs.vectors.shape == (4, 8)
    grids = pairs.grids()
    assert grids.shape == (4, 64, 64, 64)
    heights = [grid.any((0, 1)).nonzero()[0] for grid in grids]
    expected = 0.1 + np.array([model.space.decode(v)["leg_0"] for v in pairs.vectors])
    assert [np.ptp(h) + 1 for h in heights] == pytest.approx(64 * expected / np.maximum(expected, 1), abs=2)
