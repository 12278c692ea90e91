"""Parameter spaces: round trips, the grid, one-to-one maps, and messages for people."""

import numpy as np
import pytest

import procmodels
from procmodels.space import Choice, Flag, Integer, ParameterError, ParamSpace, Ratio, Scalar

SPACE = ParamSpace(
    "stool",
    (
        Scalar("depth", 0.4, 0.6, 3),
        Ratio("width", 0.6, 4.0, 8),
        Integer("bars", 0, 3),
        Choice("legs", ("posts", "plate")),
        Flag("round"),
    ),
)


def test_the_ratio_map_is_the_papers():
    ratio = Ratio("width", 0.6, 4.0, 8)
    assert [ratio.value_from_unit(u) for u in (0, 0.25, 0.5, 0.75, 1)] == pytest.approx([0.6, 0.8, 1, 2.5, 4])


@pytest.mark.parametrize("parameter", [Scalar("a", 0.3, 1.0, 6), Ratio("b", 0.2, 5, 8)])
def test_scalar_maps_are_one_to_one(parameter):
    units = np.linspace(0, 1, 101)
    values = np.array([parameter.value_from_unit(u) for u in units])
    assert (np.diff(values) > 0).all()
    assert [parameter.unit_from_value(v) for v in values] == pytest.approx(list(units), abs=1e-12)


def test_encoding_round_trips(rng):
    for _ in range(50):
        params = SPACE.sample(rng)
        vector = SPACE.encode(params)
        assert vector.shape == (SPACE.width,) == (9,)
        assert ((vector >= 0) & (vector <= 1)).all()
        back = SPACE.decode(vector)
        assert {k: back[k] for k in ("bars", "legs", "round")} == {k: params[k] for k in ("bars", "legs", "round")}
        assert [back["depth"], back["width"]] == pytest.approx([params["depth"], params["width"]], abs=1e-6)


def test_grid_points_are_distinct_and_valid():
    points = [SPACE.grid_point(i) for i in range(SPACE.grid_size)]
    assert SPACE.grid_size == 3 * 8 * 4 * 2 * 2 == len({tuple(p.items()) for p in points})
    assert [SPACE.validate(p) for p in points] == points
    with pytest.raises(IndexError):
        SPACE.grid_point(SPACE.grid_size)


def test_every_fault_is_named_with_what_is_allowed():
    with pytest.raises(ParameterError) as error:
        SPACE.validate({"depth": 0.9, "bars": 1.5, "legs": "wheels", "round": 1, "colour": "red"})
    text = str(error.value)
    for part in ("depth = 0.9 is out of range", "0.4 to 0.6", "width: missing", "bars = 1.5", "posts, plate", "colour"):
        assert part in text
    for bad in (float("nan"), "0.5", None, True):
        with pytest.raises(ParameterError, match="depth"):
            SPACE.validate({"depth": bad, "width": 1.0, "bars": 0, "legs": "posts", "round": False})


def test_the_hash_follows_everything_that_changes_a_shape():
    changed = [
        ParamSpace("stool", SPACE.parameters, version=2),
        ParamSpace("bench", SPACE.parameters),
        ParamSpace("stool", SPACE.parameters[::-1]),
        ParamSpace("stool", (Scalar("depth", 0.4, 0.7, 3), *SPACE.parameters[1:])),
    ]
    assert len({SPACE.hash, *(s.hash for s in changed)}) == 5
    assert ParamSpace("stool", SPACE.parameters).hash == SPACE.hash


def test_decode_refuses_a_wrong_shape():
    with pytest.raises(ValueError, match=r"\(9,\), got \(3,\)"):
        SPACE.decode(np.zeros(3))


def test_the_registry_lists_what_it_knows():
    assert "chair" in procmodels.names()
    with pytest.raises(procmodels.ModelError, match="chair"):
        procmodels.load("throne")


def test_a_model_may_be_a_file_of_the_users(tmp_path):
    file = tmp_path / "my_stool.py"
    file.write_text(
        "from procmodels.blender import box\n"
        "from procmodels.space import ParamSpace, Scalar\n"
        "SPACE = ParamSpace('my_stool', (Scalar('depth', 0.2, 1.0, 3),))\n"
        "def build(params):\n"
        "    return [box('block', (0, 0, 0), (1, params['depth'], 0.5))]\n"
    )
    shape = procmodels.load(str(file)).build({"depth": 0.4})
    assert np.ptp(shape.bounds(), axis=0).ravel() == pytest.approx([1, 0.4, 0.5])
    (tmp_path / "empty.py").write_text("")
    with pytest.raises(procmodels.ModelError, match="SPACE"):
        procmodels.load(str(tmp_path / "empty.py"))
