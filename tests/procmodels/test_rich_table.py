"""The rich table: sound all over its space, nothing floats or pokes through, every parameter does what it says.

A hundred shapes run with the other tests, two thousand with `make long`.
"""

import numpy as np
import pytest

import procmodels
from procmodels.parts.tops import Top
from tests.procmodels import soundness
from tests.procmodels.soundness import moved, shape_params
from tests.procmodels.touching import floating

FILE = "procmodels/classes/table.py"
SOME, MANY = range(120), range(2000)


@pytest.fixture(scope="module")
def table():
    return procmodels.load(FILE)


def _faults(parts, params):
    """What stands where it should not, in words."""
    by_name = {p.name: p.vertices for p in parts}
    under = by_name["top"][:, 2].min()
    low = [v[:, 2].max() for n, v in by_name.items() if n.startswith(("shelf", "stretcher"))]
    found = []
    for name, vertices in by_name.items():
        x, _, z = vertices.T
        if name != "top" and z.max() > under + 1e-6:
            found.append(f"{name} pokes into the top")
        if not params["turn"] and name.endswith("left") and x.min() < -1e-6:
            found.append(f"{name} crosses the middle")
        if name.startswith(("body", "drawer")) and z.min() < max(low, default=0) - 1e-6:
            found.append(f"{name} goes through a shelf or a bar")
        if z.min() < -1e-6:
            found.append(f"{name} goes below the floor")
        if name.startswith("shelf") and np.abs(vertices[:, :2]).max(0)[0] > params["width"] * 2:
            found.append("the shelf is wider than anything")
    for side in ("left", "right"):
        if f"body {side}" in by_name and f"leg front {side}" in by_name:
            body, leg = (np.abs(by_name[f"{n} {side}"][:, 0]) for n in ("body", "leg front"))
            if body.max() > leg.min() + 1e-6:
                found.append(f"body {side} goes into a leg")
    return found


def _sound(table, numbers):
    for i in numbers:
        params = shape_params(table.space, i)
        assert floating(table.build(params).parts) == [], (i, params)
        assert _faults(table.build_parts(params), params) == [], (i, params)


def test_no_part_floats_or_pokes_through(table):
    _sound(table, SOME)


@pytest.mark.long
def test_no_part_of_two_thousand_shapes_floats_or_pokes_through(table):
    _sound(table, MANY)


def test_parts_that_float_or_poke_through_are_found(table):
    """The checks themselves, on parts moved by hand."""
    params = table.space.held({**table.space.usual, "shelf": True, "blocks": "both", "block_height": 0.4})
    parts = table.build_parts(params)
    assert floating(parts) == []
    assert _faults(parts, params) == []
    for name, by, said in (
        ("leg front left", (0, 0, 0.01), "leg front left pokes into the top"),
        ("leg front left", (-1, 0, 0), "leg front left crosses the middle"),
        ("leg front left", (0, 0, -0.01), "leg front left goes below the floor"),
        ("body left", (0, 0, -0.5), "body left goes through a shelf or a bar"),
        ("body left", (0.02, 0, 0), "body left goes into a leg"),
    ):
        assert said in _faults(moved(parts, name, by), params)
    for name, by in (("leg rear left", (0, 1, 0)), ("drawer left 1", (0, -0.02, 0)), ("shelf", (0, 0, -0.5))):
        assert floating(moved(parts, name, by)) == [name], name


def test_shapes_stand_in_the_canonical_frame_and_on_the_floor(table):
    soundness.stands_canonically(table, SOME)


def test_parts_are_closed_face_outwards_and_have_names_of_their_own(table):
    soundness.parts_are_closed(table, SOME)


def test_every_parameter_changes_the_shape_where_it_is_active(table):
    soundness.active_ones_change_the_shape(table, SOME)


def test_what_is_not_active_changes_nothing(table):
    soundness.others_change_nothing(table, SOME)


def test_tables_are_as_high_as_the_gauge(table):
    for i in SOME:
        vertices = np.concatenate([p.vertices for p in table.build_parts(shape_params(table.space, i))])
        assert np.ptp(vertices[:, 2]) == pytest.approx(1)


def test_tables_are_symmetric_left_to_right_without_blocks_and_corners(table):
    for i in SOME:
        params = table.space.held({**shape_params(table.space, i), "blocks": "none", "corner": "none", "turn": 0.0})
        parts = [p for p in table.build_parts(params) if not p.name.startswith(("foot", "column", "stretcher"))]
        vertices = np.concatenate([p.vertices for p in parts])
        nearest = np.abs((vertices * [-1, 1, 1])[:, None] - vertices[None]).max(2).min(1)
        assert nearest.max() < 1e-6, i


def test_lengths_and_angles_are_what_they_say(table):
    params = {**table.space.usual, "width": 2.0, "depth": 1.2, "top_thickness": 0.1, "leg_thickness": 0.06}
    params |= {"inset_side": 0.0, "inset_front": 0.0, "apron": 0.2, "splay_side": 10.0, "leg_taper": 1.0}
    params |= {"shelf": True, "shelf_height": 0.5, "shelf_thickness": 0.1}
    parts = {p.name: p.vertices for p in table.build_parts(params)}
    assert np.ptp(parts["top"], axis=0) == pytest.approx([2.0, 1.2, 0.1])
    leg = parts["leg front left"]
    assert leg[leg[:, 2] > 0.5, 0].max() == pytest.approx(1.0, abs=1e-3)
    lean = leg[leg[:, 2] < 1e-9].mean(0) - leg[leg[:, 2] > 0.5].mean(0)
    assert np.degrees(np.arctan2(lean[0], -lean[2])) == pytest.approx(10)
    assert parts["apron front"][:, 2].min() == pytest.approx(0.8 * 0.9)
    assert parts["shelf"][:, 2].min() == pytest.approx(0.5 * (0.9 - 0.1))
    assert table.lengths(params, 2.3)["width"] == pytest.approx(
        2.0 * 2.3 / np.ptp(np.concatenate([*parts.values()])[:, 0])
    )


@pytest.mark.parametrize("side", ["left", "right"])
def test_an_l_comes_forward_at_its_side(table, side):
    params = {**table.space.usual, "corner": side, "width": 2.0, "depth": 1.6, "corner_width": 0.3, "corner_depth": 0.4}
    top = table.build_parts(params)[0].vertices
    front = top[top[:, 1] < -0.79, 0]
    assert np.ptp(front) == pytest.approx(0.6)
    assert np.sign(front.mean()) == (1 if side == "left" else -1)
    assert top[np.abs(top[:, 0]) > 0.99, 1].min() == pytest.approx(-0.8)
    free = top[top[:, 0] * np.sign(front.mean()) < -0.99]
    assert np.ptp(free[:, 1]) == pytest.approx(0.4 * 1.6)


def test_a_tops_corners_are_where_its_room_says():
    for roundness in (0.0, 0.4, 1.0):
        top = Top(2.0, 1.2, roundness, 0.9, 1.0)
        outline = top.outline()
        assert np.ptp(outline, axis=0) == pytest.approx([2.0, 1.2])
        assert np.abs(outline - top.room).max(1).min() == pytest.approx(0, abs=1e-9)
        assert top.towards(90) == pytest.approx((0.0, 0.6))


def test_legs_of_a_round_table_stand_turned_below_its_edge(table):
    params = {**table.space.usual, "round": True, "width": 2.0, "depth": 1.2, "inset_side": 0.0, "inset_front": 0.0}
    feet = {}
    for turn in (0.0, 45.0):
        leg = next(p for p in table.build_parts({**params, "turn": turn}) if p.name == "leg front left").vertices
        feet[turn] = leg[leg[:, 2] < 1e-9, :2]
        assert np.hypot(*(feet[turn] / (1.0, 0.6)).T).max() == pytest.approx(1, abs=0.01)
    assert feet[45.0].mean(0)[1] == pytest.approx(0, abs=0.05)
    assert feet[0.0].mean(0)[1] < -0.3


def test_desks_have_their_drawers(table):
    params = {**table.space.usual, "blocks": "both", "drawers": 4}
    names = [p.name for p in table.build_parts(params)]
    assert {f"drawer {side} {n}" for side in ("left", "right") for n in (1, 2, 3, 4)} <= set(names)
    assert not any(n.startswith("apron") for n in names)
