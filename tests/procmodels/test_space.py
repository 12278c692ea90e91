"""Parameter spaces: round trips, the grid, one-to-one maps, and messages for people."""

import hashlib
import json

import numpy as np
import pytest

import procmodels
from datasets.synthetic import SyntheticOptions, shape_params
from procmodels.conditions import when
from procmodels.space import Choice, Flag, Geometric, Integer, ParameterError, ParamSpace, Ratio, Scalar
from procmodels.units import DEGREES, OF_HEIGHT, of_parameter

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
        "from procmodels.parts.primitives import box\n"
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


# What the weights of the paper's classes and the data that they were trained on hang on: hash, points of the grid,
# digest of 20 continuous and 20 on-grid samples and of the first and eighth shape of each generated set.
PAPER = {
    "bed": ("666b8802859f09a3", 10_125, "0d53a58237a70a2b"),
    "chair": ("2130c168d9754613", 5_760, "5fc9502ff4886e5b"),
    "shelf": ("570e4935f9548c2c", 14_400, "80608b7c1c1694ba"),
    "sofa": ("b34aab2288df3adf", 531_441, "44f1b2085f9d7c37"),
    "table": ("3c56fa1881f97b9c", 3_456, "2e8356517f2e9ca5"),
}


@pytest.mark.parametrize("name", PAPER)
def test_the_papers_spaces_stay_what_their_weights_know(name):
    model = procmodels.load(f"paper/{name}")
    space, rng = model.space, np.random.default_rng(0)
    rows = [space.sample(rng, on_grid=i >= 20) for i in range(40)]
    sets = ("train_on", "train_off", "test_on", "test_off")
    rows += [shape_params(model, which, i, SyntheticOptions()) for which in sets for i in (0, 7)]
    digest = hashlib.sha256(json.dumps(rows).encode()).hexdigest()[:16]
    assert (space.hash, space.grid_size, digest) == PAPER[name]
    assert not space.conditional


HUGE = ParamSpace(
    "huge",
    (
        Choice("kind", ("a", "b", "c"), usual=(90, 10, 0)),
        *(Scalar(f"s{i}", 0.0, 2.0, 17, usual=(0.5, 0.1)) for i in range(30)),
        Scalar("board", 0.0, 1.0, usual=(0.0, 0.2), absent=0.6),
        Geometric("width", 0.1, 10.0, usual=(1.0, 0.3)),
        Integer("bars", 1, 4, usual=(1, 1, 6, 0)),
        Flag("ring", usual=0.2),
    ),
)


def test_spaces_may_be_huge(rng):
    assert HUGE.grid_size > 2**120
    last = HUGE.grid_point(HUGE.grid_size - 1)
    assert (last["s7"], last["kind"], last["bars"]) == (2.0, "c", 4)
    steps = {round(float(HUGE.sample(rng, on_grid=True)["s3"]) * 8, 9) for _ in range(300)}
    assert steps == set(range(17))
    space = ParamSpace("one_more", tuple(Integer(f"i{i}", 0, 9) for i in range(25)))
    assert space.validate(space.sample(rng, on_grid=True))


def test_samples_are_half_as_usual_half_even():
    samples = [HUGE.sample(np.random.default_rng([1, i])) for i in range(4000)]
    s = np.array([p["s0"] for p in samples])
    # Evenly over [0, 2]: 0.3 of them lie in 0.5 +- 0.3; of the usual ones all but 0.3 % do.
    assert (abs(s - 0.5) < 0.3).mean() == pytest.approx((0.3 + 0.997) / 2, abs=0.03)
    assert s.max() > 1.9
    assert np.mean([p["board"] == 0 for p in samples]) == pytest.approx(0.6, abs=0.03)
    usual = np.array([HUGE.sample(np.random.default_rng([2, i]), uniform=0.0)["s0"] for i in range(500)])
    assert usual.std() == pytest.approx(0.1, rel=0.15)
    assert abs(usual - 0.5).max() < 0.5


def test_choices_come_as_often_as_usual_but_none_is_rare():
    samples = [HUGE.sample(np.random.default_rng([3, i])) for i in range(4000)]
    for name, shares in {
        "kind": {"a": 0.05 + 0.85 * 0.9, "b": 0.05 + 0.85 * 0.1, "c": 0.05},
        "bars": {1: 0.15, 2: 0.15, 3: 0.65, 4: 0.05},
        "ring": {True: 0.05 + 0.9 * 0.2},
    }.items():
        for value, share in shares.items():
            assert np.mean([p[name] == value for p in samples]) == pytest.approx(share, abs=0.03), (name, value)


def test_equal_steps_of_a_geometric_scalar_are_equal_factors():
    width = Geometric("width", 0.1, 10.0, 5)
    assert [width.grid_value(i) for i in range(5)] == pytest.approx([0.1, 10**-0.5, 1, 10**0.5, 10])
    assert [width.unit_from_value(width.value_from_unit(u)) for u in (0, 0.3, 1)] == pytest.approx([0, 0.3, 1])
    assert width.problem(width.value_from_unit(1.0)) is None


def test_lengths_are_said_in_centimetres():
    space = ParamSpace(
        "stool",
        (
            Scalar("inset", 0.0, 0.5, unit=of_parameter("leg")),
            Scalar("leg", 0.0, 0.5, unit=of_parameter("width")),
            Scalar("width", 0.2, 1.0),
            Scalar("tilt", 0.0, 20.0, unit=DEGREES),
            Scalar("back", 0.0, 1.0, only_if=when("tilt").above(5.0)),
            Scalar("worded", 0.0, 1.0, unit="of whatever"),
        ),
    )
    values = {"inset": 0.5, "leg": 0.1, "width": 0.5, "tilt": 3.0, "back": 0.5, "worded": 1.0}
    metres = space.metres(values, metres_per_unit=0.8)
    assert metres == pytest.approx({"inset": 0.02, "leg": 0.04, "width": 0.4})
    assert space.by_name["leg"].unit.say(0.1, metres["leg"]) == "0.1 of width, 4.0 cm"
    assert DEGREES.say(3.0) == "3 degrees"
    assert OF_HEIGHT.say(0.5) == "0.5 of height"


def test_parameters_are_grouped_for_people():
    parameters = (Flag("a", group="seat"), Flag("b", group="legs"), Flag("c", group="seat"))
    assert {g: [p.name for p in ps] for g, ps in ParamSpace("g", parameters).groups.items()} == {
        "seat": ["a", "c"],
        "legs": ["b"],
    }
