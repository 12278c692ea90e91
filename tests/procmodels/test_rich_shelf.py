"""The rich shelf: sound all over its space, nothing floats or pokes through, every parameter does what it says.

A hundred shapes run with the other tests, two thousand with `make long`.
"""

import numpy as np
import pytest

import procmodels
from tests.procmodels import soundness
from tests.procmodels.soundness import moved, shape_params
from tests.procmodels.touching import floating

FILE = "procmodels/classes/shelf.py"
SOME, MANY = range(120), range(2000)
FRONTS = ("door", "drawer", "lower door", "lower drawer")


@pytest.fixture(scope="module")
def shelf():
    return procmodels.load(FILE)


def _overlap(a, b):
    """How far two boxes go into each other, along the axis where it is least."""
    return float((np.minimum(a.max(0), b.max(0)) - np.maximum(a.min(0), b.min(0))).min())


def _faults(parts, params):
    """What stands where it should not, in words."""
    by_name = {p.name: p.vertices for p in parts}
    found = []
    for name, v in by_name.items():
        if v[:, 2].min() < -1e-6:
            found.append(f"{name} goes below the floor")
        if v[:, 2].max() > 1 + 1e-6:
            found.append(f"{name} stands out over the top")
        if name.endswith("left") and v[:, 0].min() < -1e-6:
            found.append(f"{name} crosses the middle")
        if not name.startswith(("leg", "top")) and np.abs(v[:, 0]).max() > params["width"] / 2 + 1e-6:
            found.append(f"{name} stands out at the sides")
    # All that a case is made of lies side by side; only posts go into boards.
    boxes = [(n, v) for n, v in by_name.items() if not n.startswith(("leg", "post"))]
    for i, (name, a) in enumerate(boxes):
        for other, b in boxes[:i]:
            if params["sides"] == "filled" and _overlap(a, b) > 1e-5:
                found.append(f"{name} goes into {other}")
    return found


def _sound(shelf, numbers):
    for i in numbers:
        params = shape_params(shelf.space, i)
        assert floating(shelf.build(params).parts) == [], (i, params)
        assert _faults(shelf.build_parts(params), params) == [], (i, params)


def test_no_part_floats_or_pokes_through(shelf):
    _sound(shelf, SOME)


@pytest.mark.long
def test_no_part_of_two_thousand_shapes_floats_or_pokes_through(shelf):
    _sound(shelf, MANY)


def test_parts_that_float_or_poke_through_are_found(shelf):
    """The checks themselves, on parts moved by hand."""
    params = {**shelf.space.usual, "upper": "fronts", "lower": "fronts", "base": "legs", "base_height": 0.1}
    params |= {"leaves": 2, "front_rows": 1, "rows_below": 2, "leaves_below": 1}
    parts = shelf.build_parts(params)
    assert floating(parts) == []
    assert _faults(parts, params) == []
    for name, by, said in (
        ("leg front left", (0, 0, -0.01), "leg front left goes below the floor"),
        ("side left", (-1, 0, 0), "side left crosses the middle"),
        ("door 1 1 1", (0, 0.01, 0), "door 1 1 1 goes into side right"),
        ("top", (0, 0, 0.01), "top stands out over the top"),
        ("board between", (0.01, 0, 0), "board between goes into side left"),
        ("door 1 1 2", (0.1, 0, 0), "door 1 1 2 stands out at the sides"),
    ):
        assert any(said in f or f == _said_other_way(said) for f in _faults(moved(parts, name, by), params)), said
    for name, by in (
        ("door 1 1 1", (0, -0.05, 0)),
        ("leg rear left", (0, 0.3, 0)),
        ("lower drawer 1 1", (0, -0.05, 0)),
    ):
        assert floating(moved(parts, name, by)) == [name], name


def _said_other_way(said):
    first, _, second = said.partition(" goes into ")
    return f"{second} goes into {first}"


def test_shapes_stand_in_the_canonical_frame_and_on_the_floor(shelf):
    soundness.stands_canonically(shelf, SOME)


def test_parts_are_closed_face_outwards_and_have_names_of_their_own(shelf):
    soundness.parts_are_closed(shelf, SOME)


def test_every_parameter_changes_the_shape_where_it_is_active(shelf):
    soundness.active_ones_change_the_shape(shelf, SOME)


def test_what_is_not_active_changes_nothing(shelf):
    soundness.others_change_nothing(shelf, SOME)


def test_shelves_are_as_high_as_the_gauge(shelf):
    for i in SOME:
        vertices = np.concatenate([p.vertices for p in shelf.build_parts(shape_params(shelf.space, i))])
        assert np.ptp(vertices[:, 2]) == pytest.approx(1)


def test_lengths_are_what_they_say(shelf):
    params = {**shelf.space.usual, "width": 0.8, "depth": 0.4, "frame": 0.02, "board": 0.01, "base_height": 0.1}
    params |= {"lower": "fronts", "lower_height": 0.4, "rows": 3, "row_ratio": 2.0, "columns": 2, "column_ratio": 1.5}
    parts = {p.name: p.vertices for p in shelf.build_parts(params)}
    assert np.ptp(np.concatenate([*parts.values()]), axis=0) == pytest.approx([0.8, 0.4, 1.0])
    assert parts["bottom"][:, 2].min() == pytest.approx(0.1)
    between = parts["board between"]
    assert between[:, 2].min() - 0.12 == pytest.approx(0.4 * (0.98 - 0.12 - 0.01), rel=1e-3)
    edges = [between[:, 2].max(), *(z for n in (1, 2) for z in parts[f"board {n}"][[0, 1], 2]), 0.98]
    heights = np.diff(edges)[::2]
    assert heights[0] / heights[2] == pytest.approx(2.0, rel=1e-3)
    divider = parts["divider 1 row 1"]
    assert (0.38 - divider[:, 0].max()) / (divider[:, 0].min() + 0.38) == pytest.approx(1.5, rel=1e-3)
    # Doors cover the lower part, a gap apart.
    doors = np.concatenate([v for n, v in parts.items() if n.startswith(("lower door", "lower drawer"))])
    assert doors[:, 1].min() == pytest.approx(-0.2)
    assert doors[:, 2].min() == pytest.approx(0.1, abs=0.01)
    assert shelf.lengths(params, 1.9)["depth"] == pytest.approx(0.4 * 1.9)


@pytest.mark.parametrize(
    ("upper", "lower", "there", "missing"),
    [
        ("open", "none", ["board 1"], FRONTS),
        ("fronts", "none", ["drawer 1 1", "drawer 1 4"], ("board", "lower")),
        ("fronts", "fronts", ["drawer 1 4", "lower door 1 1 1", "lower door 1 1 2", "board between"], ("board 1",)),
        ("open", "fronts", ["board 3", "lower door 1 1 2"], ("door", "drawer")),
        ("fronts", "open", ["drawer 1 4", "lower board 1"], ("lower door", "board 1")),
    ],
)
def test_parts_of_a_case_are_open_or_closed(shelf, upper, lower, there, missing):
    params = {**shelf.space.usual, "width": 0.5, "upper": upper, "lower": lower, "rows": 4, "front_rows": 4}
    params |= {"leaves": 1, "leaves_below": 2, "lower_height": 0.5, "rows_below": 2 if lower == "open" else 1}
    parts = {p.name: p.vertices for p in shelf.build_parts(params)}
    assert set(there) <= set(parts)
    assert not [n for n in parts if n.startswith(missing) and n != "board between"]
    fronts = [v for n, v in parts.items() if n.startswith(FRONTS)]
    sides = parts["side left"][:, 1].min()
    assert all(v[:, 1].max() == pytest.approx(sides) for v in fronts)


def test_open_bays_have_boards_instead_of_fronts(shelf):
    params = {**shelf.space.usual, "upper": "fronts", "columns": 3, "rows": 3, "leaves": 1, "front_rows": 1}
    for bays, closed in (("none", [1, 2, 3]), ("inner", [1, 3]), ("outer", [2])):
        names = {p.name for p in shelf.build_parts({**params, "open_bays": bays})}
        assert {f"door {i} 1" for i in closed} == {n for n in names if n.startswith("door")}
        assert {f"board {i} 2" for i in {1, 2, 3} - set(closed)} <= names
