"""The rich chair: sound all over its space, nothing floats or pokes through, every parameter does what it says.

A few hundred shapes run with the other tests, two thousand with `make long`.
"""

from collections import Counter

import numpy as np
import pytest
import trimesh

import procmodels
from procmodels.parts.seats import Seat
from procmodels.space import Scalar
from tests.procmodels.touching import floating

FILE = "procmodels/classes/chair.py"
BELOW = ("leg", "stretcher", "apron", "runner", "star arm", "castor", "column", "foot", "ring bar", "board", "bar")
SOME, MANY = range(120), range(2000)


@pytest.fixture(scope="module")
def chair():
    return procmodels.load(FILE)


def _params(space, i):
    """Shape number i: as usual, evenly over the space, or at its corners, in turn."""
    rng = np.random.default_rng([31, i])
    if i % 3 < 2:
        return space.sample(rng, uniform=float(i % 3))
    ends = {p.name: (p.low, p.high)[rng.integers(2)] for p in space.scalars}
    return space.held({**{p.name: p.sample_grid(rng) for p in space.discrete}, **ends})


def _seat(parts):
    """The slab's planes, (z at y = 0, slope) of its underside and top, and its half depth."""
    slab = next(p for p in parts if p.name == "seat").vertices.reshape(2, -1, 3)
    planes = [np.polyfit(ring[:, 1], ring[:, 2], 1)[::-1] for ring in slab]
    return planes[0], planes[1], np.ptp(slab[0, :, 1]) / 2


def _faults(parts, thickness):
    """What stands where it should not, in words."""
    under, top, half = _seat(parts)
    found = []
    for part in parts:
        x, y, z = part.vertices.T
        beneath = np.abs(y) < half
        if part.name.startswith(BELOW) and (z - under[0] - under[1] * y)[beneath].max(initial=-1) > 1e-6:
            found.append(f"{part.name} pokes into the seat")
        if part.name.startswith(("back", "arm")) and (z - top[0] - top[1] * y).min() < -1e-6:
            found.append(f"{part.name} goes through the seat")
        if part.name.endswith("left") and x.min() < -0.1 * thickness:
            found.append(f"{part.name} crosses the middle")
        if part.name.startswith(("back bar", "back rail", "back splat", "back cushion")) and z.max() > 1 + 1e-6:
            found.append(f"{part.name} stands out over the top")
        if z.min() < -1e-6:
            found.append(f"{part.name} goes below the floor")
    return found


def _sound(chair, numbers):
    for i in numbers:
        params = _params(chair.space, i)
        parts = chair.build_parts(params)
        assert floating(chair.build(params).parts) == [], (i, params)
        assert _faults(parts, params["leg_thickness"]) == [], (i, params)


def test_no_part_floats_or_pokes_through(chair):
    _sound(chair, SOME)


@pytest.mark.long
def test_no_part_of_two_thousand_shapes_floats_or_pokes_through(chair):
    _sound(chair, MANY)


def test_parts_that_float_or_poke_through_are_found(chair):
    """The checks themselves, on parts moved by hand."""
    parts = chair.build_parts(chair.space.usual)
    thickness = chair.space.usual["leg_thickness"]
    assert floating(parts) == []
    assert _faults(parts, thickness) == []
    for name, by, said in (
        ("leg front left", (0, 0, 0.01), "leg front left pokes into the seat"),
        ("back panel", (0, 0, -0.02), "back panel goes through the seat"),
        ("leg rear left", (-0.5, 0, 0), "leg rear left crosses the middle"),
        ("leg rear left", (0, 0, -0.01), "leg rear left goes below the floor"),
    ):
        assert said in _faults(_moved(parts, name, by), thickness)
    for name, by in (("leg front left", (0, 0, -0.01)), ("leg rear left", (0.1, 0, 0)), ("back panel", (0, 0.1, 0))):
        assert floating(_moved(parts, name, by)) == [name]


def _moved(parts, name, by):
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return [p.moved(matrix) if p.name == name else p for p in parts]


def test_shapes_stand_in_the_canonical_frame_and_on_the_floor(chair):
    for i in SOME:
        params = _params(chair.space, i)
        low, high = chair.build(params).bounds()
        assert (high - low).max() == pytest.approx(1)
        assert low + high == pytest.approx(0, abs=1e-9)
        vertices = np.concatenate([p.vertices for p in chair.build_parts(params)])
        assert vertices[:, 2].min() == pytest.approx(0, abs=1e-9), params
        if params["back"] != "none":
            assert vertices[:, 2].max() == pytest.approx(1, abs=1e-9), params


def test_parts_are_closed_face_outwards_and_have_names_of_their_own(chair):
    for i in SOME:
        params = _params(chair.space, i)
        parts = chair.build(params).parts
        assert len({p.name for p in parts}) == len(parts)
        for part in parts:
            edges = Counter((f[j - 1], f[j]) for f in part.faces for j in range(len(f)))
            assert set(edges.values()) == {1}, (i, part.name)
            assert all((b, a) in edges for a, b in edges), (i, part.name)
            mesh = trimesh.Trimesh(part.vertices, part.triangles(), process=False)
            assert mesh.volume > 0, (i, part.name)
            if part.convex:
                hull = mesh.convex_hull.volume
                assert mesh.volume == pytest.approx(hull, rel=1e-3, abs=1e-9), (i, part.name)


def test_chairs_are_symmetric_left_to_right(chair):
    for i in SOME:
        shape = chair.build({**_params(chair.space, i), "base_turn": 0.0})  # a turned star moves the middle of the box
        parts = [p for p in shape.parts if not p.name.startswith(("star arm", "castor", "ring", "column", "back bar"))]
        vertices = np.concatenate([p.vertices for p in parts])
        mirrored = vertices * [-1, 1, 1]
        nearest = np.abs(mirrored[:, None] - vertices[None]).max(2).min(1)
        assert nearest.max() < 1e-6, i


def _changed(chair, params, name, value):
    """How far the shape's vertices move when one parameter does; infinite when it has others."""
    before, after = (chair.build_parts(p) for p in (params, {**params, name: value}))
    a, b = (np.concatenate([p.vertices for p in parts]) for parts in (before, after))
    return np.abs(a - b).max() if a.shape == b.shape else np.inf


def test_every_parameter_changes_the_shape_where_it_is_active(chair):
    seen = Counter()
    for i in SOME:
        params = _params(chair.space, i)
        active = chair.space.active(params)
        for p in chair.space.parameters:
            if p.name not in active:
                continue
            seen[p.name] += 1
            if isinstance(p, Scalar):
                unit = p.unit_from_value(params[p.name])
                values = [p.value_from_unit(unit + 0.1 if unit < 0.5 else unit - 0.1)]
            else:
                values = [v for v in map(p.grid_value, range(p.grid_steps)) if v != params[p.name]]
            for value in values:
                assert _changed(chair, params, p.name, value) > 1e-4, (i, p.name, value, params)
    assert all(seen[p.name] >= 3 for p in chair.space.parameters), seen


def test_what_is_not_active_changes_nothing(chair):
    for i in SOME:
        params = _params(chair.space, i)
        for p in chair.space.parameters:
            if p.name not in chair.space.active(params):
                for value in (p.grid_value(0), p.grid_value(p.grid_steps - 1)):
                    assert _changed(chair, params, p.name, value) == 0, (i, p.name)


def test_lengths_and_angles_are_what_they_say(chair):
    params = {**chair.space.usual, "width": 0.7, "depth": 0.6, "seat_height": 0.4, "back_rake": 20.0, "back_bend": 0.0}
    params |= {"splay_front": 10.0, "seat_drop": 0.1, "apron": 0.2, "back_wrap": 0.0, "seat_taper": 0.8}
    parts = {p.name: p.vertices for p in chair.build_parts(params)}
    assert np.ptp(parts["seat"], axis=0)[:2] == pytest.approx([0.7, 0.6], rel=0.02)
    assert parts["seat"][:, 2].max() == pytest.approx(0.4)
    rear, front = (
        parts["seat"][20:][order] for order in (parts["seat"][20:, 1].argmax(), parts["seat"][20:, 1].argmin())
    )
    assert front[2] - rear[2] == pytest.approx(0.1 * 0.4)
    leg = parts["leg front left"]
    lean = (leg[leg[:, 2] < 1e-9].mean(0) - leg[leg[:, 2] > 0.1].mean(0))[1:]
    assert np.degrees(np.arctan2(-lean[0], -lean[1])) == pytest.approx(10, abs=0.2)
    back = parts["back panel"][:65]
    assert np.degrees(np.arctan2(np.ptp(back[:, 1]), np.ptp(back[:, 2]))) == pytest.approx(20, abs=0.5)
    metres = chair.lengths(params, 0.9)
    assert metres["width"] == pytest.approx(0.7 * 0.9 / max(1, np.ptp(np.concatenate(list(parts.values()))[:, 1])))


def test_a_seats_outline_is_where_its_half_width_says(rng):
    for roundness in (0.0, 0.4, 1.0):
        seat = Seat(0.5, 0.6, 0.8, roundness, top=(1, 0), under=(0, 0))
        for x, y in seat.outline():
            assert abs(x) <= seat.half_width(y) + 1e-9
            if abs(y) < 0.29:
                assert abs(x) == pytest.approx(seat.half_width(y), abs=1e-6)
        # The corners of the inner rectangle lie on the outline or within it.
        assert seat.corner_width(seat.front) <= seat.half_width(seat.front) + 1e-9
