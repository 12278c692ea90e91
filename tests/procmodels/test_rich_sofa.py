"""The rich sofa: sound all over its space, nothing floats or pokes through, every parameter does what it says.

A hundred shapes run with the other tests, two thousand with `make long`.
"""

import numpy as np
import pytest
import trimesh

import procmodels
from procmodels.parts.cushions import cushion, square
from procmodels.parts.upholstery import Arm, Tub
from tests.procmodels import soundness
from tests.procmodels.soundness import moved, shape_params
from tests.procmodels.touching import floating

FILE = "procmodels/classes/sofa.py"
SOME, MANY = range(120), range(2000)
SINK = 0.011  # what stands on the seat presses into it


@pytest.fixture(scope="module")
def sofa():
    return procmodels.load(FILE)


def _faults(parts, params):
    """What stands where it should not, in words."""
    vertices = {p.name: p.vertices for p in parts}
    found = []
    bases = [v for name, v in vertices.items() if name.startswith("base")]
    low, deck = min(v[:, 2].min() for v in bases), max(v[:, 2].max() for v in bases)
    seat = params["seat_height"]
    back = vertices.get("back")
    for name, v in vertices.items():
        x, y, z = v.T
        if name.startswith(("leg", "runner", "plinth")) and z.max() > low + 1e-6:
            found.append(f"{name} pokes into the base")
        if name.startswith("seat cushion") and z.min() < deck - 1e-6:
            found.append(f"{name} sinks into the base")
        pressed = SINK + (0.2 * params["softness"] * (seat - deck) if name.startswith("pillow") else 0.0)
        if name.startswith(("back cushion", "side cushion", "pillow")) and z.min() < seat - pressed:
            found.append(f"{name} sinks into the seat")
        if name.startswith("back cushion") and back is not None:
            # The face of the back, a plane that leans.
            slope = np.tan(np.radians(params["back_rake"]))
            face = back[:, 1][back[:, 2] < seat].min()
            if (y - face - slope * np.maximum(z - seat, -SINK)).max() > 1e-3:
                found.append(f"{name} goes into the back")
        if name.startswith(("seat cushion", "back cushion", "pillow")) and np.abs(x).max() > params["width"] / 2 + 1e-6:
            found.append(f"{name} stands out at a side")
        if z.min() < -1e-6:
            found.append(f"{name} goes below the floor")
    return found


def _sound(sofa, numbers):
    for i in numbers:
        params = shape_params(sofa.space, i)
        assert floating(sofa.build(params).parts) == [], (i, params)
        assert _faults(sofa.build_parts(params), params) == [], (i, params)


def test_no_part_floats_or_pokes_through(sofa):
    _sound(sofa, SOME)


@pytest.mark.long
def test_no_part_of_two_thousand_shapes_floats_or_pokes_through(sofa):
    _sound(sofa, MANY)


def test_parts_that_float_or_poke_through_are_found(sofa):
    """The checks themselves, on parts moved by hand."""
    params = {**sofa.space.usual, "pillows": 1}
    parts = sofa.build_parts(params)
    assert floating(parts) == []
    assert _faults(parts, params) == []
    for name, by, said in (
        ("leg rear left", (0, 0, 0.02), "leg rear left pokes into the base"),
        ("seat cushion 1", (0, 0, -0.02), "seat cushion 1 sinks into the base"),
        ("pillow 1", (0, 0, -0.04), "pillow 1 sinks into the seat"),
        ("back cushion 1", (0, 0.02, 0), "back cushion 1 goes into the back"),
        ("back cushion 1", (-1, 0, 0), "back cushion 1 stands out at a side"),
        ("leg rear left", (0, 0, -0.01), "leg rear left goes below the floor"),
    ):
        assert said in _faults(moved(parts, name, by), params)
    for name, by in (("leg rear left", (0, 0, -0.02)), ("arm left", (0.05, 0, 0)), ("pillow 1", (0, -0.5, 0.3))):
        assert name in floating(moved(parts, name, by))


def test_shapes_stand_in_the_canonical_frame_and_on_the_floor(sofa):
    soundness.stands_canonically(sofa, SOME)


def test_parts_are_closed_face_outwards_and_have_names_of_their_own(sofa):
    soundness.parts_are_closed(sofa, SOME)


def test_every_parameter_changes_the_shape_where_it_is_active(sofa):
    soundness.active_ones_change_the_shape(sofa, SOME)


def test_what_is_not_active_changes_nothing(sofa):
    soundness.others_change_nothing(sofa, SOME)


def test_the_back_ends_at_the_gauge(sofa):
    for i in SOME:
        params = shape_params(sofa.space, i)
        if params["back"] != "none":
            back = next(p for p in sofa.build_parts(params) if p.name == "back")
            assert back.vertices[:, 2].max() == pytest.approx(1, abs=1e-9), params


def test_a_corner_at_the_right_mirrors_one_at_the_left(sofa):
    other = {"left": "right", "right": "left"}
    for i in SOME:
        params = {**shape_params(sofa.space, i), "back": "straight", "corner": "left", "pillows": 0}
        mirror = {**params, "corner": "right", "arms": other.get(params["arms"], params["arms"])}
        left, right = ({p.name: p.vertices for p in sofa.build_parts(p)} for p in (params, mirror))
        assert len(left) == len(right)
        a, b = (np.concatenate(list(parts.values())) for parts in (left, right))
        assert np.sort(np.abs(a[:, 0])) == pytest.approx(np.sort(np.abs(b[:, 0])), abs=1e-9)
        for name, vertices in left.items():
            twin = " ".join(other.get(word, word) for word in name.split())
            assert right[twin] == pytest.approx(vertices * (-1, 1, 1), abs=1e-9), name


def test_lengths_and_angles_are_what_they_say(sofa):
    params = {**sofa.space.usual, "width": 2.4, "depth": 1.2, "seat_height": 0.5, "back_thickness": 0.2, "base": "legs"}
    params |= {"leg_height": 0.3, "cushion": 0.4, "back_rake": 10.0, "arm_height": 0.5, "arm_width": 0.2}
    params |= {"arm_length": 0.9, "back_cushion": 0.15, "back_cushion_rise": 0.2, "seats": 2}
    parts = {p.name: p.vertices for p in sofa.build_parts(params)}
    assert np.ptp(np.concatenate(list(parts.values()))[:, 0]) == pytest.approx(2.4)
    assert parts["arm left"][:, 2].max() == pytest.approx(0.75)
    assert np.ptp(parts["arm left"][:, 0]) == pytest.approx(0.2)
    assert parts["arm left"][:, 1].min() == pytest.approx(0.6 - 1.08)
    assert parts["leg rear left"][:, 2].max() == pytest.approx(0.15)
    assert parts["seat cushion 1"][:, 2].max() == pytest.approx(0.5)
    assert np.ptp(parts["seat cushion 1"][:, 2]) == pytest.approx(0.4 * 0.35)
    assert parts["back cushion 1"][:, 2].max() == pytest.approx(1.1)
    top = parts["back"][parts["back"][:, 2] > 0.99]
    assert top[:, 1].max() == pytest.approx(0.6 + 0.5 * np.tan(np.radians(10)))
    assert np.ptp(top[:, 1]) == pytest.approx(0.24)
    assert sofa.lengths(params, 1.0)["back_thickness"] == pytest.approx(0.24 / 2.4)


def test_a_corner_part_goes_on_to_the_front_at_its_side(sofa):
    params = {**sofa.space.usual, "corner": "left", "corner_length": 0.5, "depth": 1.0, "corner_back": True}
    parts = {p.name: p.vertices for p in sofa.build_parts(params)}
    part = parts["base 2"]
    assert part[:, 1].max() == pytest.approx(-0.5, abs=1e-6)
    assert part[:, 0].min() > 0, "the sitter's left is +X"
    assert parts["side back"][:, 1].min() == pytest.approx(-1.0)
    assert parts["arm left"][:, 1].min() == pytest.approx(-1.0), "the arm stands across its end"
    chaise = {p.name: p.vertices for p in sofa.build_parts({**params, "corner_back": False})}
    assert "side back" not in chaise
    assert chaise["arm left"][:, 1].min() > -0.51


def test_a_rolled_arm_is_thinner_below_its_scroll():
    board, scroll = (Arm(1.0, 0.3, -0.5, 0.5, 0.1, 0.8, 0.4, roll).wall("arm").vertices for roll in (0.0, 1.0))
    assert np.ptp(board[:, 0]) == pytest.approx(0.3)
    assert np.ptp(scroll[:, 0]) == pytest.approx(0.3)
    for vertices, foot in ((board, 1.3), (scroll, 1.0 + 0.55 * 0.3)):
        assert vertices[vertices[:, 2] < 0.11, 0].max() == pytest.approx(foot)
    assert np.ptp(scroll[scroll[:, 2] > 0.799, 0]) < 0.05
    assert np.ptp(board[board[:, 2] > 0.799, 0]) == pytest.approx(0.3)


def test_a_tub_is_as_thick_as_asked_and_rises_to_its_back():
    tub = Tub(1.0, 0.5, 0.15, 0.2, -0.5, 0.4, 0.1, 0.45, 0.7, 0.0)
    outer, inner = tub.path(False), tub.path(True)
    assert outer[0] - inner[0] == pytest.approx([-0.15, 0.0])
    assert (outer[9] - inner[9]) == pytest.approx([0.0, 0.2])
    gaps = np.linalg.norm(outer - inner, axis=1)
    assert (gaps > 0.14).all()
    assert (gaps < 0.26).all()
    vertices = tub.part().vertices
    assert vertices[vertices[:, 1] < -0.49, 2].max() == pytest.approx(0.7)
    assert vertices[vertices[:, 1] > 0.49, 2].max() == pytest.approx(1.0)


def test_cushions_go_from_crisp_to_plump():
    fullness = []
    for softness in (0.0, 0.5, 1.0):
        part = cushion("cushion", square((-0.5, -0.4), (0.5, 0.4), softness), 0.2, 0.4, softness)
        low, high = part.vertices.min(0), part.vertices.max(0)
        assert [*low, *high] == pytest.approx([-0.5, -0.4, 0.2, 0.5, 0.4, 0.4])
        mesh = trimesh.Trimesh(part.vertices, part.triangles(), process=False)
        assert mesh.is_watertight
        assert mesh.convex_hull.volume == pytest.approx(mesh.volume, rel=1e-3)
        fullness.append(mesh.volume / 0.16)
    assert fullness[0] > 0.97
    assert fullness[0] > fullness[1] > fullness[2] > 0.6
