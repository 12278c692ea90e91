"""The sofa model: a live node graph whose parameters do what their names say, sound meshes at every corner."""

from __future__ import annotations

import itertools

import bpy
import numpy as np
import pytest
import trimesh

import procmodels
from datasets.voxels import surface_grid
from procmodels.export import Asset, save_blend
from procmodels.paper.sofa import LEGS
from tests.procmodels.touching import all_touch

BASE = {
    "width": 1.8,
    "depth": 0.9,
    "seat_height": 0.45,
    "arm_width": 0.16,
    "arm_height": 0.18,
    "back_height": 0.47,
    "back_tilt": 10.0,
    "back_thickness": 0.14,
    "cushion_softness": 0.5,
    "seats": 2,
    "back_cushions": 2,
    "pillows": 2,
}
HEIGHT = 0.85


@pytest.fixture(scope="module")
def sofa():
    return procmodels.load("sofa")


def _corners(sofa, n=10):
    """Shapes with every parameter at an end of its range: all low, all high, and random ones."""
    rng = np.random.default_rng(0)
    ends = [(p.low, p.high) for p in sofa.space.parameters]
    picks = [np.zeros(12, int), np.ones(12, int), *rng.integers(2, size=(n, 12))]
    return [dict(zip(BASE, (e[k] for e, k in zip(ends, pick, strict=True)), strict=True)) for pick in picks]


def _named(sofa, **changes):
    return {p.name: p for p in sofa.build_parts({**BASE, **changes})}


def _box(part):
    return part.vertices.min(0), part.vertices.max(0)


def test_the_space_has_nine_scalars_and_three_integers(sofa):
    assert list(sofa.space.slices) == list(BASE)
    assert (len(sofa.space.scalars), len(sofa.space.discrete)) == (9, 3)


def test_every_corner_is_closed_faces_outwards_and_is_convex(sofa):
    for params in _corners(sofa):
        parts = sofa.build_parts(params)
        assert len({p.name for p in parts}) == len(parts)
        assert min(p.vertices[:, 2].min() for p in parts) == pytest.approx(0, abs=1e-6)
        assert sum(len(p.faces) for p in parts) < 6000
        for part in parts:
            mesh = trimesh.Trimesh(part.vertices, part.triangles(), process=False)
            assert mesh.is_watertight, (params, part.name)
            hull = mesh.convex_hull.volume
            assert part.convex
            assert mesh.volume > 0.985 * hull, (params, part.name)  # the facets are not plane


def test_no_part_floats(sofa):
    for params in _corners(sofa):
        assert all_touch(sofa.build_parts(params)), params


def test_no_part_pokes_through_another(sofa):
    """No vertex lies deeper than 1 % of the width inside another part; every part is convex, so planes tell."""
    for params in _corners(sofa, 6):
        parts = sofa.build_parts(params)
        hulls = [trimesh.Trimesh(p.vertices, p.triangles()).convex_hull for p in parts]
        for (a, hull), (b, other) in itertools.permutations(zip(parts, hulls, strict=True), 2):
            depth = (
                hull.face_normals @ other.vertices.T - (hull.face_normals * hull.triangles[:, 0]).sum(1)[:, None]
            ).max(0)
            assert -depth.min() < 0.01 * params["width"], (params, a.name, b.name)


def test_the_counts_are_numbers_of_named_parts(sofa):
    for name, word in (("seats", "seat cushion"), ("back_cushions", "back cushion"), ("pillows", "pillow")):
        for count in next(p for p in sofa.space.discrete if p.name == name).values:
            found = [n for n in _named(sofa, **{name: count}) if n.startswith(word)]
            assert found == [f"{word} {i + 1}" for i in range(count)]


def test_the_same_parameters_build_the_same_mesh(sofa):
    first = sofa.build(BASE)
    sofa.build({**BASE, "width": 2.1, "seats": 3, "pillows": 0})
    again = sofa.build(BASE)
    assert (first.vertices() == again.vertices()).all()
    assert [p.faces for p in first.parts] == [p.faces for p in again.parts]


def test_building_survives_another_file_being_opened(sofa):
    first = sofa.build(BASE)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert (sofa.build(BASE).vertices() == first.vertices()).all()


def test_lengths_are_what_their_names_say(sofa):
    for params in _corners(sofa, 6):
        parts = {p.name: _box(p) for p in sofa.build_parts(params)}
        left, right, back = parts["arm left"], parts["arm right"], parts["back frame"]
        assert left[1][0] - right[0][0] == pytest.approx(params["width"], abs=1e-5)
        assert left[1][1] - left[0][1] == pytest.approx(params["depth"], abs=1e-5)
        assert left[1][0] - left[0][0] == pytest.approx(params["arm_width"], abs=1e-5)
        assert left[1][2] == pytest.approx(params["seat_height"] + params["arm_height"], abs=1e-5)
        assert back[1][2] == pytest.approx(params["seat_height"] + params["back_height"], abs=1e-5)
        assert parts["seat cushion 1"][1][2] == pytest.approx(params["seat_height"], abs=1e-5)
        assert left[0][2] == pytest.approx(LEGS["leg_height"][0], abs=1e-5)


def test_the_back_leans_and_has_its_thickness(sofa):
    for thickness, tilt in itertools.product((0.08, 0.2), (0.0, 20.0)):
        low, high = _box(_named(sofa, back_thickness=thickness, back_tilt=tilt)["back frame"])
        lean = np.tan(np.radians(tilt)) * (high[2] - low[2])
        assert high[1] - low[1] == pytest.approx(thickness + lean, abs=0.01)  # its edges are rounded


def test_softness_rounds_the_cushions_and_keeps_their_size(sofa):
    crisp, plump = (_named(sofa, cushion_softness=s) for s in (0.0, 1.0))
    for name in ("seat cushion 1", "back cushion 2"):
        a, b = (trimesh.Trimesh(p[name].vertices, p[name].triangles()) for p in (crisp, plump))
        assert b.volume < 0.85 * a.volume
        assert b.extents[0] == pytest.approx(a.extents[0], abs=1e-5)


def test_left_and_right_are_the_sitters(sofa):
    parts = _named(sofa)
    assert parts["arm left"].vertices[:, 0].min() > 0
    assert parts["leg back right"].vertices[:, 0].max() < 0
    assert parts["pillow 1"].vertices[:, 0].mean() > 0
    assert parts["back frame"].vertices[:, 1].mean() > parts["seat cushion 1"].vertices[:, 1].mean()


def _grid(sofa, params):
    shape = sofa.build(params)
    return surface_grid(shape.vertices(), shape.triangles())


def test_every_grid_step_of_every_parameter_changes_the_voxels(sofa):
    crisp = {**BASE, "cushion_softness": 0.0}  # where neighbouring cushions are hardest to tell apart
    for p in sofa.space.parameters:
        grids = [_grid(sofa, {**crisp, p.name: p.grid_value(i)}) for i in range(p.grid_steps)]
        for a, b in itertools.combinations(grids, 2):
            assert (a ^ b).sum() > 60, p.name


def test_the_saved_blend_is_live(sofa, tmp_path):
    shape = sofa.build(BASE)
    metres = HEIGHT / np.ptp(shape.bounds(), axis=0)[2]
    save_blend(Asset(shape, sofa.space, BASE, metres, live_object=sofa.live_object), tmp_path / "m.blend")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "m.blend"))
    (obj,) = [o for o in bpy.data.objects if o.type == "MESH"]
    (modifier,) = obj.modifiers
    inputs = {
        i.name: i
        for i in modifier.node_group.interface.items_tree
        if i.in_out == "INPUT" and i.socket_type in ("NodeSocketFloat", "NodeSocketInt")
    }
    assert len(modifier.node_group.interface.items_tree) == 20, "19 inputs and the geometry"
    assert list(inputs) == [*BASE, *LEGS]
    assert all(i.description and i.min_value <= i.default_value <= i.max_value for i in inputs.values())
    assert modifier[inputs["width"].identifier] == pytest.approx(BASE["width"])
    assert modifier[inputs["back_tilt"].identifier] == pytest.approx(np.radians(BASE["back_tilt"]))

    points = _evaluated(obj)
    metric = shape.vertices() * metres
    assert np.ptp(points, axis=0) == pytest.approx(np.ptp(metric, axis=0), abs=1e-5)
    assert points[:, 2].min() == pytest.approx(0, abs=1e-5)
    assert points[:, :2].min(0) == pytest.approx(metric[:, :2].min(0), abs=1e-5)

    modifier[inputs["seats"].identifier] = 3
    obj.update_tag()
    assert len(_evaluated(obj)) > len(points)
    modifier[inputs["leg_height"].identifier] = 0.2
    obj.update_tag()
    assert (_evaluated(obj)[:, 2] < 1e-5).sum() == 16, "the feet stay on the floor"


def _evaluated(obj):
    """(n, 3) vertices of an object after its modifiers, in the file's frame."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = np.array([v.co[:] for v in evaluated.data.vertices])
    matrix = np.array(evaluated.matrix_world)
    names = [m and m.name for m in evaluated.data.materials]
    assert {names[f.material_index] for f in evaluated.data.polygons} == {"wood"}
    return points @ matrix[:3, :3].T + matrix[:3, 3]
