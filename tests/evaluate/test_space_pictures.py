"""Pictures of a prior and of every choice."""

import cv2
import numpy as np
import pytest

from procmodels.conditions import when
from procmodels.model import Model
from procmodels.parts.primitives import box
from procmodels.space import Choice, Integer, ParamSpace, Scalar
from recon.evaluate.space_pictures import SpaceOptions, choices, prior, run

SPACE = ParamSpace(
    "block",
    (
        Scalar("width", 0.1, 2.0, usual=(0.5, 0.01)),
        Choice("back", ("none", "bars"), usual=(3, 1)),
        Integer("bars", 1, 3, only_if=when("back").is_("bars"), usual=(1, 0, 0)),
    ),
)


@pytest.fixture
def model(tmp_path):
    def build(p):
        bars = p["bars"] if p["back"] == "bars" else 0
        return [box("seat", (0, 0, 0), (p["width"], 1, 1))] + [
            box(f"bar {i}", (i, 0, 1), (i + 1, 1, 1.5)) for i in range(bars)
        ]

    return Model("block", SPACE, build, tmp_path / "block.safetensors")


def test_every_value_of_every_choice_is_drawn_where_it_does_something(model):
    tiles = choices(model, SpaceOptions())
    assert [text for text, _ in tiles] == ["back: none", "back: bars", "bars: 1", "bars: 2", "bars: 3"]
    assert [len(shape.parts) for _, shape in tiles] == [1, 2, 2, 3, 4]


def test_the_prior_is_drawn_as_usual(model):
    shapes = [shape for _, shape in prior(model, SpaceOptions(shapes=20))]
    widths = [np.ptp(s.parts[0].vertices, axis=0) for s in shapes]
    assert [w[0] / w[1] for w in widths] == pytest.approx([0.5] * 20, abs=0.06)
    assert len({len(s.parts) for s in shapes}) > 1


def test_pictures_are_written_once_a_kind(model, tmp_path):
    paths = list(run(model, SpaceOptions(shapes=3, width=400, out=tmp_path)))
    assert [p.name for p in paths] == ["block_prior.jpg", "block_choices.jpg"]
    heights = [cv2.imread(str(p)).shape for p in paths]
    assert all(h[1] == 400 for h in heights)
    assert heights[1][0] > heights[0][0], "captions"
