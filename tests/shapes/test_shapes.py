"""Shapes as input: cleaned, stood up in every way, scored smoothly, and fitted."""

import json
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from procmodels.shape import Part, Shape
from recon.command import main
from recon.evaluate.metrics import chamfer
from recon.files.recognise import Kind
from recon.fitting.evidence import Evidence
from recon.fitting.shape_fit import ShapeFit
from recon.fitting.shape_fit import run as fit_shape
from recon.fitting.state import Posed
from recon.fitting.surface_target import Surface
from recon.fitting.uncertainty import Certainty, Choice
from recon.geometry.triangles import Triangles
from recon.scene import Canonical, InputError
from recon.shapes import shape_target
from recon.shapes.shape_target import ShapeOptions, Target, grids_of, hypotheses
from tests.results import assert_opens

CHAIR = {"width": 0.45, "depth": 0.5, "leg_height": 0.42, "legs": "support", "arms": "none", "back": "hbar"}


STEPS = (0.01, 0.02, 0.04)


def distance(points, box, count, mesh=None, move=None):
    """Chamfer distance of a mesh, moved, to points or the mesh that they are of."""
    part = Part("box", np.asarray(box.vertices), tuple(map(tuple, box.faces.tolist())))
    posed = Posed(Shape((part,)), np.eye(4) if move is None else move, np.zeros((0, 4, 4)), np.zeros((0, 3, 3)))
    return Surface(points, (count,), mesh).loss(posed)


def box_points(rng, n, size, low=(0, 0, 0)):
    """(n, 3) points on the surface of a box."""
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(np.add(low, np.array(size) / 2))
    return np.asarray(trimesh.sample.sample_surface(mesh, n, seed=int(rng.integers(99)))[0])


def read(tmp_path, points, **options):
    path = tmp_path / "cloud.npy"
    np.save(path, points)
    return shape_target.run(path, Kind.CLOUD, "points", ShapeOptions(**options))


def test_a_hypothesis_brings_up_and_front_to_the_canonical_axes(tmp_path, rng):
    points = box_points(rng, 900, (1, 3, 2), low=(5, 5, 5))
    target = read(tmp_path, points, up="y", front="x")
    (way,) = hypotheses(target)
    back = way.input_from_canonical
    turn = back[:3, :3] / np.cbrt(np.linalg.det(back[:3, :3]))
    np.testing.assert_allclose(turn @ (0, 0, 1), (0, 1, 0), atol=1e-9)
    np.testing.assert_allclose(turn @ (0, -1, 0), (1, 0, 0), atol=1e-9)
    assert np.linalg.det(back[:3, :3]) > 0
    np.testing.assert_allclose(np.ptp(way.points, axis=0).max(), 1)
    np.testing.assert_allclose(way.points.min(0) + way.points.max(0), 0, atol=1e-9)
    np.testing.assert_allclose(way.points @ back[:3, :3].T + back[:3, 3], target.points, atol=1e-9)


def test_ups_and_fronts_are_all_tried_unless_they_are_given(tmp_path, rng):
    points = box_points(rng, 900, (1, 3, 2))
    assert len({w.name for w in hypotheses(read(tmp_path, points))}) == 8
    assert len(hypotheses(read(tmp_path, points, up="-x"))) == 4
    with pytest.raises(InputError, match="must differ"):
        read(tmp_path, points, up="x", front="-x")
    with pytest.raises(InputError, match="--up is one of"):
        read(tmp_path, points, up="north")


def test_an_object_that_stands_askew_is_turned_straight(tmp_path, rng):
    points = box_points(rng, 3000, (1, 0.6, 2))
    for degrees in (0, 27, -38):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        target = read(tmp_path, points @ np.array([(c, s, 0), (-s, c, 0), (0, 0, 1)]), up="z")
        for way in hypotheses(target):
            np.testing.assert_allclose(np.sort(np.ptp(way.points, axis=0)), (0.3, 0.5, 1), atol=0.02)
            assert np.linalg.det(way.input_from_canonical[:3, :3]) > 0


def test_grids_of_all_ways_are_those_of_their_points(tmp_path, rng):
    target = read(tmp_path, box_points(rng, 6000, (1.0, 0.7, 1.3)))
    ways = hypotheses(target)
    for grid, way in zip(grids_of(target, ways), ways, strict=True):
        np.testing.assert_array_equal(grid, shape_target.grid_of(target, way), err_msg=way.name)


def test_a_sparse_cloud_becomes_a_surface(tmp_path, rng):
    target = read(tmp_path, box_points(rng, 500, (1, 1, 1)))
    grid = shape_target.grid_of(target, hypotheses(target)[0])
    shell = np.zeros((64, 64, 64), bool)
    shell[[0, -1]] = shell[:, [0, -1]] = shell[:, :, [0, -1]] = True
    near = np.pad(np.zeros((56, 56, 56), bool), 4, constant_values=True)
    assert not (grid & ~near).any()
    assert (grid & near).sum() > 0.1 * shell.sum(), "500 single voxels would be 2 % of it"


def test_outliers_floors_and_other_objects_are_left_out(tmp_path, rng):
    chair = box_points(rng, 3000, (1, 1, 2))
    floor = np.column_stack([rng.uniform(-2, 3, (1500, 2)), rng.normal(0, 0.002, 1500)])
    far = rng.uniform(-9, 9, (30, 3))
    cleaned = read(tmp_path, np.concatenate([chair, floor, far]), up="z")
    np.testing.assert_allclose(np.ptp(cleaned.points, axis=0), (1, 1, 2), atol=0.1)
    assert any("floor" in w for w in cleaned.warnings)
    pair = np.concatenate([chair, box_points(rng, 2000, (1, 1, 1), low=(4, 0, 0))])
    only = read(tmp_path, pair)
    np.testing.assert_allclose(np.ptp(only.points, axis=0), (1, 1, 2), atol=0.1)
    assert any("separate objects" in w for w in only.warnings)


def test_a_table_top_is_not_a_floor(tmp_path, rng):
    top = box_points(rng, 3000, (3, 2, 0.04), low=(-1.5, -1, 1))
    post = box_points(rng, 1000, (0.2, 0.2, 1), low=(-0.1, -0.1, 0))
    assert np.ptp(read(tmp_path, np.concatenate([top, post])).points, axis=0)[0] > 2.9


def test_clouds_that_are_no_shape(tmp_path, rng):
    with pytest.raises(InputError, match="3 usable points"):
        read(tmp_path, rng.random((3, 3)))
    with pytest.raises(InputError, match="90 of 100 points are not numbers"):
        read(tmp_path, np.where(np.arange(100)[:, None] < 90, np.nan, rng.random((100, 3))))
    with pytest.raises(InputError, match="on one line"):
        read(tmp_path, np.outer(np.arange(50.0), (1, 2, 3)))
    some = np.where(np.arange(1000)[:, None] < 20, np.inf, box_points(rng, 1000, (1, 1, 1)))
    assert "20 points that are not numbers" in read(tmp_path, some).warnings[0]


def test_a_mesh_of_too_many_faces_is_read_as_points(tmp_path):
    mesh = trimesh.creation.icosphere(4)
    mesh.export(tmp_path / "s.obj")
    target = shape_target.run(tmp_path / "s.obj", Kind.MESH, "a mesh", ShapeOptions(max_faces=1000, samples=4000))
    assert len(target.triangles) == 0
    np.testing.assert_allclose(np.linalg.norm(target.points, axis=1), 1, atol=0.01)


def test_inverted_faces_change_nothing(tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False).export(tmp_path / "b.obj")
    target = shape_target.run(tmp_path / "b.obj", Kind.MESH, "a mesh", ShapeOptions(samples=2000))
    assert distance(target.points, box, 500) < 0.02


def test_the_score_is_a_chamfer_distance_that_moves_smoothly(rng):
    box = trimesh.creation.box((1, 0.6, 0.8))
    points, mesh = box_points(rng, 4000, (1, 0.6, 0.8), low=(-0.5, -0.3, -0.4)), Triangles(np.asarray(box.triangles))
    assert distance(points, box, 1000, mesh) < 1e-10
    shifted = [distance(points, box, 1000, mesh, trimesh.transformations.translation_matrix((x, 0, 0))) for x in STEPS]
    assert shifted[0] < shifted[1] < shifted[2]
    np.testing.assert_allclose(shifted[2] / shifted[1], 4, rtol=0.2)


def test_a_turned_and_scaled_chair_is_found_again(tmp_path, chair):
    """The mesh of a chair, y up, turned by a quarter, 40 units large."""
    shape = chair.build(CHAIR)
    turn = np.array([(0, -1, 0), (1, 0, 0), (0, 0, 1)]) @ np.eye(3)
    y_up = np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)])
    moved = trimesh.Trimesh(40 * shape.vertices() @ (y_up @ turn).T + 7, shape.triangles(), process=False)
    moved.export(tmp_path / "chair.obj")
    found = fit_shape(chair, shape_target.run(tmp_path / "chair.obj", Kind.MESH, "a mesh", ShapeOptions()))
    assert chamfer(chair.build(found.params).to_trimesh(), shape.to_trimesh()) < 3e-4
    assert {k: found.params[k] for k in ("legs", "arms", "back")} == {k: CHAIR[k] for k in ("legs", "arms", "back")}
    back = found.canonical.world_from_canonical
    here = found.distance
    assert here < 1e-4
    assert all(distance >= here for _, distance in found.alternatives)
    assert {"up y, front", "arms = "} <= {words[:11] if "up" in words else words[:7] for words, _ in found.alternatives}
    assert set(found.certainty.choices) == {"legs", "arms", "back"}
    np.testing.assert_allclose(back[:3, :3] / 40, y_up @ turn, atol=0.01)


def test_the_command_ends_in_the_same_outputs(tmp_path, chair, monkeypatch, capsys):
    """With the answer given: the search itself is tested above."""
    shape = chair.build(CHAIR)
    trimesh.Trimesh(shape.vertices(), shape.triangles(), process=False).export(tmp_path / "c.stl")
    sure = Certainty({"width": (0.4, 0.6)}, {"arms": Choice(0.9, "solid", 0.01, 5.0)}, {"width": 0.01}, {"arms": 5.0})
    seen = Evidence(0.007, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0)
    others = (("arms = solid", 0.01),)
    answer = ShapeFit(CHAIR, Canonical(np.eye(4)), 1e-4, 2e-4, "up z, front -y", others, True, sure, seen)
    monkeypatch.setattr("recon.fitting.shape_fit.run", lambda model, target, options: _checked(target, answer))
    out = tmp_path / "out"
    assert (
        main([str(tmp_path / "c.stl"), "--class", "paper/chair", "--up", "z", "--height", "0.9", "--out", str(out)])
        == 0
    )
    assert "D_chamfer 0.00010 to a mesh of" in capsys.readouterr().out
    report = json.loads((out / "report.json").read_text())
    assert report["input"]["kind"] == "mesh"
    assert report["distance"] == pytest.approx(1e-4)
    assert report["alternatives"] == [{"what": "arms = solid", "distance": 0.01}]
    assert report["certainty"]["params"]["width"] == {"low": 0.4, "high": 0.6}
    assert report["certainty"]["params"]["arms"]["rival"] == "solid"
    assert report["belongs"]
    for name in ("mesh.glb", "mesh.obj", "model.blend", "params.json", "report.html", "contact_sheet.png"):
        assert_opens(out / name)


def test_what_is_no_chair_is_said_to_be_none(tmp_path, chair, monkeypatch, capsys):
    """A refrigerator: the nearest chair is far from it."""
    trimesh.creation.box((0.6, 0.6, 1.7)).export(tmp_path / "fridge.stl")
    sure = Certainty({"width": (0.4, 0.6)}, {"legs": Choice(0.98, "office", 0.01, 5.0)}, {"width": 0.01}, {"legs": 5.0})
    seen = Evidence(0.09, 0.3, 0.3, 0.6, 2.0, 2.0, 0.3, {"leg": 0.6})
    answer = ShapeFit(CHAIR, Canonical(np.eye(4)), 0.016, 0.02, "up z, front -y", (), True, sure, seen)
    monkeypatch.setattr("recon.fitting.shape_fit.run", lambda model, target, options: answer)
    out = tmp_path / "out"
    assert main([str(tmp_path / "fridge.stl"), "--class", "paper/chair", "--up", "z", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "no chair; the nearest one:" in said
    assert "warning: this is not a chair" in said
    assert "30% of what is seen has nothing of the result near it" in said
    report = json.loads((out / "report.json").read_text())
    assert report["confidence"] < 0.2
    assert not report["belongs"]
    assert report["certainty"]["params"]["legs"]["chance"] < 0.9
    assert "Not a chair: the nearest one from" in (out / "report.html").read_text()


def _checked(target, answer):
    assert isinstance(target, Target)
    assert target.ups == ("z",)
    return answer


def test_bad_shapes_end_with_code_2_and_nothing_written(tmp_path, capsys):
    (tmp_path / "three.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n")
    assert main([str(tmp_path / "three.xyz"), "--out", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert "three.xyz has 3 usable points" in message
    assert "Traceback" not in message
    assert not (tmp_path / "out").exists()


def test_open3d_is_loaded_without_a_web_server():
    """In a process of its own: this one may have loaded it already."""
    code = (
        "import sys; from recon.system.light_open3d import without_plotting; without_plotting(); import open3d as o3d; "
        "o3d.t.geometry.RaycastingScene(); sys.exit('dash' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=120).returncode == 0
