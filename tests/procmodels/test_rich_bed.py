"""The rich bed: sound all over its space, nothing floats or pokes through, every parameter does what it says.

A hundred shapes run with the other tests, two thousand with `make long`.
"""

import numpy as np
import pytest

import procmodels
from procmodels.classes import bed as module
from procmodels.parts import bedsteads
from procmodels.parts.heads import Head
from tests.procmodels import soundness
from tests.procmodels.soundness import moved, shape_params
from tests.procmodels.touching import floating

FILE = "procmodels/classes/bed.py"
SOME, MANY = range(120), range(2000)


@pytest.fixture(scope="module")
def bed():
    return procmodels.load(FILE)


def _faults(parts, params):
    """What stands where it should not, in words."""
    by_name = {p.name: p.vertices for p in parts}
    found = []
    for prefix in ("", "upper "):
        if f"{prefix}deck" not in by_name:
            continue
        deck = by_name[f"{prefix}deck"]
        for name in by_name:
            x, y, z = by_name[name].T
            if name.startswith((f"{prefix}mattress", f"{prefix}pillow")):
                if z.min() < deck[:, 2].max() - 1e-6:
                    found.append(f"{name} sinks into the deck")
                if (
                    y.min() < deck[:, 1].min() - bedsteads.RAIL - 1e-6
                    or y.max() > deck[:, 1].max() + bedsteads.RAIL + 1e-6
                ):
                    found.append(f"{name} goes into an end")
            if not prefix and name.startswith(("leg", "plinth")) and z.max() > deck[:, 2].min() + 1e-6:
                found.append(f"{name} pokes through the deck")
    for name, vertices in by_name.items():
        x, y, z = vertices.T
        if name.endswith("left") and not name.startswith("ladder") and x.min() < -1e-6:
            found.append(f"{name} crosses the middle")
        if name.startswith(("head bar", "foot bar", "upper head bar", "upper foot bar")):
            top = by_name[name.split(" bar")[0] + " frame"][:, 2].max()
            if z.max() > top + 1e-6:
                found.append(f"{name} stands out over its frame")
        if z.min() < -1e-6:
            found.append(f"{name} goes below the floor")
    if "bedclothes" in by_name:
        x, y, z = by_name["bedclothes"].T
        hanging = z < by_name["deck"][:, 2].max()
        if np.abs(x)[hanging & (np.abs(y) < 0.4)].min(initial=1) < params["width"] / 2 - 1e-6:
            found.append("bedclothes go through the frame")
    return found


def _sound(bed, numbers):
    for i in numbers:
        params = shape_params(bed.space, i)
        assert floating(bed.build(params).parts) == [], (i, params)
        assert _faults(bed.build_parts(params), params) == [], (i, params)


def test_no_part_floats_or_pokes_through(bed):
    _sound(bed, SOME)


@pytest.mark.long
def test_no_part_of_two_thousand_shapes_floats_or_pokes_through(bed):
    _sound(bed, MANY)


def test_parts_that_float_or_poke_through_are_found(bed):
    """The checks themselves, on parts moved by hand."""
    params = {**bed.space.usual, "bedclothes": 0.6}
    parts = bed.build_parts(params)
    assert floating(parts) == []
    assert _faults(parts, params) == []
    for name, by, said in (
        ("leg head left", (0, 0, 0.02), "leg head left pokes through the deck"),
        ("mattress", (0, 0, -0.02), "mattress sinks into the deck"),
        ("mattress", (0, 0.02, 0), "mattress goes into an end"),
        ("leg head left", (-0.5, 0, 0), "leg head left crosses the middle"),
        ("leg head left", (0, 0, -0.01), "leg head left goes below the floor"),
        ("bedclothes", (0.05, 0, 0), "bedclothes go through the frame"),
    ):
        assert said in _faults(moved(parts, name, by), params)
    for name, by in (("leg head left", (0, 0, -0.1)), ("pillow 1", (0, 0, 0.05))):
        assert floating(moved(parts, name, by)) == [name], name


def test_shapes_stand_in_the_canonical_frame_and_on_the_floor(bed):
    soundness.stands_canonically(bed, SOME)


def test_parts_are_closed_face_outwards_and_have_names_of_their_own(bed):
    soundness.parts_are_closed(bed, SOME)


def test_every_parameter_changes_the_shape_where_it_is_active(bed):
    soundness.active_ones_change_the_shape(bed, SOME)


def test_what_is_not_active_changes_nothing(bed):
    soundness.others_change_nothing(bed, SOME)


def test_a_bed_is_as_long_as_the_gauge(bed):
    for i in SOME:
        params = {**shape_params(bed.space, i), "head_rake": 0.0, "bedclothes": 0.0}
        if params["ladder"] != "end" or params["storeys"] == "low":
            vertices = np.concatenate([p.vertices for p in bed.build_parts(params)])
            assert np.ptp(vertices[:, 1]) == pytest.approx(1, abs=2e-3), params


def test_beds_without_sides_and_ladders_are_symmetric(bed):
    for i in SOME:
        params = {**shape_params(bed.space, i), "sides": "none", "ladder": "none"}
        parts = [p for p in bed.build_parts(params) if "pillow" not in p.name]
        vertices = np.concatenate([p.vertices for p in parts])
        nearest = np.abs((vertices * [-1, 1, 1])[:, None] - vertices[None]).max(2).min(1)
        assert nearest.max() < 1e-6, i


def test_lengths_and_angles_are_what_they_say(bed):
    params = {**bed.space.usual, "width": 0.8, "deck": 0.16, "rail": 0.5, "head_height": 0.3, "head_rake": 15.0}
    params |= {"foot_height": 0.1, "mattress": 0.1, "head_width": 1.2, "bedclothes": 0.5, "head_thickness": 0.04}
    parts = {p.name: p.vertices for p in bed.build_parts(params)}
    assert parts["deck"][:, 2].max() == pytest.approx(0.16)
    assert np.ptp(parts["rail left"][:, 2]) == pytest.approx(0.08)
    assert parts["headboard"][:, 2].max() == pytest.approx(0.46)
    assert parts["footboard"][:, 2].max() == pytest.approx(0.26)
    assert np.ptp(parts["headboard"][:, 0]) == pytest.approx(0.96)
    assert parts["mattress"][:, 2].max() == pytest.approx(0.26)
    assert parts["bedclothes"][:, 2].min() == pytest.approx(0.13, abs=0.005)
    head = parts["headboard"]
    top = head[head[:, 2] > 0.459]
    assert np.degrees(np.arctan2(top[:, 1].max() - 0.5, 0.3)) == pytest.approx(15, abs=0.1)
    assert bed.lengths(params, 2.0)["head_height"] == pytest.approx(
        0.3 * 2.0 / np.ptp(np.concatenate([*parts.values()])[:, 1])
    )


def test_bedclothes_hang_over_a_bed_without_a_foot_alone(bed):
    params = {**bed.space.usual, "bedclothes": 0.6, "foot_height": 0.0}
    ends = []
    for foot in (0.0, 0.2):
        parts = {p.name: p.vertices for p in bed.build_parts({**params, "foot_height": foot})}
        clothes = parts["bedclothes"]
        ends.append(clothes[clothes[:, 1] < clothes[:, 1].min() + 0.01, 2].min())
        assert ("footboard" in parts) == (foot > 0)
    assert ends[0] == pytest.approx(ends[1], abs=1e-6)
    clothes = next(p for p in bed.build_parts(params) if p.name == "bedclothes").vertices
    hanging = clothes[np.abs(clothes[:, 0]) < 0.1]
    assert hanging[:, 2].min() == pytest.approx(ends[0])


def test_storeys_have_their_decks(bed):
    for storeys, decks in (("low", ["deck"]), ("loft", ["upper deck"]), ("bunk", ["deck", "upper deck"])):
        params = bed.space.held({**bed.space.usual, "storeys": storeys})
        names = [p.name for p in bed.build_parts(params)]
        assert [n for n in names if n.endswith("deck")] == decks
        assert ("ladder side left" in names) == (storeys != "low")


def test_a_bed_with_the_higher_foot_is_turned_round(bed):
    params = {**bed.space.usual, "head_height": 0.1, "foot_height": 0.3}
    other = module.turned_round(params)
    assert (other["head_height"], other["foot_height"]) == (0.3, 0.1)
    assert module.turned_round(other) is None
    assert bed.space.validate(other)


def test_a_bar_ends_within_the_frame():
    head = Head(0.8, 0.5, 1, 0.03, 0.1, 0.1, 0.2, 0.6, arch=0.4, roundness=0.7, post=0.04)
    z = np.linspace(0.21, 0.55, 20)
    x = head.reach(z)
    assert (head.edge(x) >= z - 1e-9).all()
    assert (np.diff(x) <= 1e-9).all()
    assert x[0] == pytest.approx(0.38)
