"""The chair model: canonical frame, parameters that do what their names say, sound meshes at every corner."""

import itertools

import numpy as np
import pytest

from tests.procmodels.touching import all_touch

CHOICES = {
    "legs": ("basic", "round", "support", "office"),
    "arms": ("none", "basic", "solid", "office"),
    "back": ("basic", "hbar", "vbar", "office"),
}
BASE = {"width": 0.6, "depth": 0.5, "leg_height": 0.4, "legs": "basic", "arms": "none", "back": "basic"}


def test_the_space_is_the_papers(chair):
    assert chair.space.grid_size == 5760
    assert {p.name: p.grid_steps for p in chair.space.parameters} == {
        "width": 6,
        "depth": 3,
        "leg_height": 5,
        "legs": 4,
        "arms": 4,
        "back": 4,
    }
    assert [(s.low, s.high) for s in chair.space.scalars] == [(0.3, 1.0), (0.4, 0.6), (0.3, 0.5)]
    assert {p.name: p.values for p in chair.space.discrete} == CHOICES


def _corners():
    ends = itertools.product((0.3, 1.0), (0.4, 0.6), (0.3, 0.5))
    for (w, d, z), combination in zip(itertools.cycle(ends), itertools.product(*CHOICES.values()), strict=False):
        yield {"width": w, "depth": d, "leg_height": z, **dict(zip(CHOICES, combination, strict=True))}


def test_every_combination_is_canonical_and_sound(chair):
    for params in _corners():
        shape = chair.build(params)
        low, high = shape.bounds()
        assert (high - low).max() == pytest.approx(1)
        assert low + high == pytest.approx(0, abs=1e-9)
        assert len({p.name for p in shape.parts}) == len(shape.parts), "part names are unique"
        for part in shape.parts:
            assert part.moved(np.eye(4)).triangles().max() < len(part.vertices)


def test_parts_are_closed_and_face_outwards(chair):
    import trimesh

    for params in _corners():
        for part in chair.build(params).parts:
            mesh = trimesh.Trimesh(part.vertices, part.triangles(), process=False)
            assert mesh.is_watertight, (params, part.name)
            assert mesh.volume > 0, (params, part.name)
            assert mesh.is_convex == part.convex


def test_no_part_floats(chair):
    for params in _corners():
        assert all_touch(chair.build(params).parts), params


def test_the_back_is_behind_and_the_legs_stand_on_the_floor(chair):
    for back in CHOICES["back"]:
        shape = chair.build({**BASE, "back": back})
        backs = [p for p in shape.parts if p.name.startswith("back")]
        legs = [p for p in shape.parts if p.name.startswith("leg")]
        seat = next(p for p in shape.parts if p.name == "seat")
        assert min(p.vertices[:, 1].mean() for p in backs) > seat.vertices[:, 1].mean()
        assert {round(p.vertices[:, 2].min() - shape.bounds()[0, 2], 9) for p in legs} == {0}


@pytest.mark.parametrize(("name", "axis"), [("width", 0), ("depth", 1)])
def test_width_and_depth_set_the_seat(chair, name, axis):
    for value in (0.4, 0.55):
        shape = chair.build({**BASE, name: value})
        seat = next(p for p in shape.parts if p.name == "seat")
        assert np.ptp(seat.vertices[:, axis]) == pytest.approx(value, abs=1e-6)


def test_leg_height_is_the_seats_underside(chair):
    for value in (0.3, 0.44):
        shape = chair.build({**BASE, "leg_height": value})
        seat = next(p for p in shape.parts if p.name == "seat")
        assert seat.vertices[:, 2].min() - shape.bounds()[0, 2] == pytest.approx(value, abs=1e-6)


def test_chairs_are_symmetric_left_to_right(chair):
    for params in _corners():
        vertices = chair.build(params).vertices()
        mirrored = vertices * [-1, 1, 1]
        nearest = np.abs(vertices[:, None] - mirrored[None]).max(2).min(1)
        assert nearest.max() < 0.02, params  # the star's castors have 12 sides: not exactly mirrored


def test_no_two_choices_build_one_shape(chair):
    for name, options in CHOICES.items():
        volumes = {o: len(chair.build({**BASE, name: o}).vertices()) for o in options}
        shapes = [chair.build({**BASE, name: o}).vertices() for o in options]
        for a, b in itertools.combinations(shapes, 2):
            assert a.shape != b.shape or np.abs(a - b).max() > 0.01, volumes
