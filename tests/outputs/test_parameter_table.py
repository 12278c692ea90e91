"""The report's table of parameters: groups, real lengths, and what does nothing."""

import re

import numpy as np
import pytest

from procmodels.conditions import when
from procmodels.export import Asset
from procmodels.model import Model
from procmodels.parts.primitives import box
from procmodels.space import Choice, Flag, Integer, ParamSpace, Scalar
from procmodels.units import DEGREES, of_parameter
from recon.outputs.parameter_table import table

SPACE = ParamSpace(
    "stool",
    (
        Scalar("width", 0.2, 2.0, about="of the seat", group="seat"),
        Scalar("leg_width", 0.0, 0.5, unit=of_parameter("width"), group="legs"),
        Choice("back", ("none", "bars"), group="back"),
        Integer("bars", 1, 4, only_if=when("back").is_("bars"), group="back"),
        Scalar("rake", 0.0, 30.0, unit=DEGREES, only_if=when("back").not_("none"), group="back"),
        Flag("ring", group="legs"),
    ),
)
VALUES = {"width": 0.5, "leg_width": 0.1, "back": "none", "bars": 2, "rake": 15.0, "ring": True}


def _build(params):
    return [box("seat", (0, 0, 0), (params["width"], 0.5, 1.0))]


@pytest.fixture
def asset(tmp_path):
    model = Model("stool", SPACE, _build, tmp_path / "stool.safetensors")
    return Asset(model.build(VALUES), SPACE, VALUES, 0.4, lengths=model.lengths(VALUES, 0.4))


def _rows(html):
    return re.findall(r"<tr.*?</tr>", html)


def test_parameters_stand_in_their_groups(asset):
    rows = _rows(table(asset, VALUES, {}))
    heads = [re.sub("<.*?>", "", r) for r in rows if "class=group" in r]
    assert heads == ["seat", "legs", "back"]
    assert len(rows) == len(heads) + len(VALUES)
    assert [i for i, r in enumerate(rows) if ">ring<" in r] == [4], "beside the legs"


def test_lengths_are_said_in_centimetres(asset):
    rows = _rows(table(asset, VALUES, {}))
    # 0.5 of a height of 40 cm, and a tenth of that.
    assert "of height, 20.0 cm" in rows[1]
    assert "of width, 2.0 cm" in rows[3]
    assert 'title="of the seat"' in rows[1]
    bare = Asset(asset.shape, SPACE, VALUES)
    assert " cm" not in table(bare, VALUES, {})


def test_what_does_nothing_is_greyed_and_says_when_it_would(asset):
    rows = _rows(table(asset, VALUES, {}))
    idle = [r for r in rows if "class=idle" in r]
    assert len(idle) == 2
    assert "only if back is bars" in idle[0]
    assert "only if back is not none" in idle[1]
    shown = table(asset, {**VALUES, "back": "bars"}, {})
    assert "class=idle" not in shown
    assert "degrees" in shown


def test_certainty_is_drawn_beside_the_values(asset):
    html = table(asset, VALUES, {"width": {"low": 0.4, "high": 0.6}, "ring": {"chance": 0.8, "rival": False}})
    assert "80 % sure, else no" in html
    left, width = map(float, re.search(r"left:([\d.]+)%;width:([\d.]+)%", html).groups())
    assert [left, width] == pytest.approx([100 * 0.2 / 1.8, 100 * 0.2 / 1.8], abs=0.1)


def test_a_models_lengths_follow_its_own_unit(tmp_path):
    """Wider than high: the canonical unit is the width, the model's unit the height."""
    model = Model("stool", SPACE, _build, tmp_path / "stool.safetensors")
    values = {**VALUES, "width": 2.0}
    assert np.ptp(model.build(values).bounds(), axis=0).ravel()[0] == pytest.approx(1)
    assert model.lengths(values, 1.2)["width"] == pytest.approx(1.2)
