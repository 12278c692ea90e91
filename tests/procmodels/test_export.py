"""Files for other programs: names, polygons, size, axes and parameters survive."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import bpy
import numpy as np
import pytest
import trimesh

import procmodels
from procmodels.export import Asset, export_glb, export_obj, save_blend
from procmodels.normals import with_normals
from procmodels.shape import Part
from procmodels.usd import export_usd
from tests.made_up import CHAIR, world_from_canonical

HEIGHT = 0.92


@pytest.fixture(scope="module")
def asset():
    model = procmodels.load("paper/chair")
    return Asset(model.build(CHAIR), model.space, CHAIR, HEIGHT, world_from_canonical())  # the chair's height is 1


@pytest.fixture(scope="module")
def reopened(asset, tmp_path_factory):
    path = tmp_path_factory.mktemp("blend") / "model.blend"
    save_blend(asset, path)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return {
        "root": bpy.data.objects["chair"],
        "parts": {o.name: o for o in bpy.data.objects if o.type == "MESH"},
        "collections": [c.name for c in bpy.data.collections],
    }


def test_blend_has_the_parts_as_named_objects_under_one_empty(reopened, asset):
    assert set(reopened["parts"]) == {p.name for p in asset.shape.parts}
    assert reopened["collections"] == ["chair"]
    assert reopened["root"].type == "EMPTY"
    for part in reopened["parts"].values():
        assert part.parent == reopened["root"]
        assert np.allclose(part.matrix_world, np.eye(4))
        assert not part.modifiers
        assert len(part.data.materials) == 1


def test_blend_keeps_polygons(reopened, asset):
    for part in asset.shape.parts:
        polygons = [tuple(p.vertices) for p in reopened["parts"][part.name].data.polygons]
        assert polygons == list(part.faces)


def test_blend_stands_on_the_floor_in_metres(reopened):
    corners = np.concatenate([[v.co[:] for v in o.data.vertices] for o in reopened["parts"].values()])
    assert corners[:, 2].min() == pytest.approx(0, abs=1e-6)
    assert np.ptp(corners[:, 2]) == pytest.approx(HEIGHT, rel=1e-5)
    assert bpy.context.scene.unit_settings.system == "METRIC"


def test_blend_carries_the_parameters_with_ranges(reopened, asset):
    root = reopened["root"]
    for name, value in CHAIR.items():
        assert root[name] == value
    ui = root.id_properties_ui("width").as_dict()
    assert (ui["min"], ui["max"]) == (0.3, 1.0)
    assert "of height" in ui["description"]
    assert "support" in root.id_properties_ui("legs").as_dict()["description"]
    assert root["space_hash"] == asset.space.hash
    assert np.allclose(np.reshape(root["world_from_canonical"], (4, 4)), world_from_canonical())


def test_blend_says_nothing_on_the_standard_output(asset, tmp_path, capfd):
    save_blend(asset, tmp_path / "m.blend")
    assert capfd.readouterr().out == ""


def test_blend_into_a_folder_that_is_missing(asset, tmp_path):
    with pytest.raises(OSError, match="nowhere"):
        save_blend(asset, tmp_path / "nowhere" / "m.blend")


def test_glb_is_y_up_with_named_nodes(asset, tmp_path):
    export_glb(asset, tmp_path / "m.glb")
    scene = trimesh.load_scene(tmp_path / "m.glb")
    low, high = scene.bounds
    assert low[1] == pytest.approx(0, abs=1e-6)
    assert high[1] == pytest.approx(HEIGHT, rel=1e-5)
    assert set(scene.graph.nodes_geometry) == {p.name for p in asset.shape.parts}
    assert scene.volume == pytest.approx(asset.shape.to_trimesh().volume * HEIGHT**3, rel=1e-4)
    # It faces -Y in the canonical frame, +Z in glTF: the back is at low z.
    assert scene.geometry["back rail"].bounds[1, 2] < 0


def test_glb_holds_parameters_and_normals_without_blender(asset, tmp_path):
    export_glb(asset, tmp_path / "m.glb")
    content = _gltf(tmp_path / "m.glb")
    extras = content["scenes"][0].get("extras") or content["nodes"][0].get("extras")
    assert extras["width"] == CHAIR["width"]
    assert extras["space_hash"] == asset.space.hash
    for mesh in content["meshes"]:
        assert "NORMAL" in mesh["primitives"][0]["attributes"]


def _gltf(path: Path) -> dict:
    data = path.read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    return json.loads(data[20 : 20 + length])


@pytest.mark.parametrize(("up", "axis"), [("y", 1), ("z", 2)])
def test_obj_stands_on_its_up_axis_and_keeps_names_and_polygons(asset, tmp_path, up, axis):
    export_obj(asset, tmp_path / "m.obj", up=up)
    text = (tmp_path / "m.obj").read_text()
    assert f"{up.upper()} up" in text.splitlines()[1]
    assert "metres" in text.splitlines()[1]
    assert "# width = 0.5" in text
    sides = [len(line.split()) - 1 for line in text.splitlines() if line.startswith("f ")]
    assert sides == [len(f) for p in asset.shape.parts for f in p.faces]
    scene = trimesh.load_scene(tmp_path / "m.obj", split_objects=True, group_material=False)
    assert set(scene.geometry) == {p.name.replace(" ", "_") for p in asset.shape.parts}
    assert scene.bounds[0, axis] == pytest.approx(0, abs=1e-6)
    order = [0, 2, 1] if up == "y" else [0, 1, 2]
    assert np.ptp(scene.bounds, axis=0) == pytest.approx(HEIGHT * np.ptp(asset.shape.bounds(), axis=0)[order], rel=1e-5)
    assert scene.volume == pytest.approx(asset.shape.to_trimesh().volume * HEIGHT**3, rel=1e-4)


def test_obj_stands_upright_and_faces_the_same_way_in_blender(asset, tmp_path):
    """Blender's importer takes files for Y up unless told otherwise."""
    export_obj(asset, tmp_path / "m.obj")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.obj_import(filepath=str(tmp_path / "m.obj"))
    bpy.context.view_layer.update()
    points = {o.name: np.array([o.matrix_world @ v.co for v in o.data.vertices]) for o in bpy.data.objects}
    everything = np.concatenate(list(points.values()))
    assert everything[:, 2].min() == pytest.approx(0, abs=1e-6)
    assert np.ptp(everything[:, 2]) == pytest.approx(HEIGHT, rel=1e-5)
    assert points["back_rail"][:, 1].min() > 0, "it faces -Y"


def test_usd_stands_upright_with_names_and_values(asset, tmp_path, capfd):
    """What Blender reads back, which turns Y up to Z up."""
    save_blend(asset, tmp_path / "m.blend")
    export_usd(tmp_path / "m.usdz")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(tmp_path / "m.usdz"))
    bpy.context.view_layer.update()
    meshes = [o for o in bpy.data.objects if o.type == "MESH"]
    points = np.concatenate([[o.matrix_world @ v.co for v in o.data.vertices] for o in meshes])
    assert points[:, 2].min() == pytest.approx(0, abs=1e-5)
    assert np.ptp(points[:, 2]) == pytest.approx(HEIGHT, rel=1e-4)
    assert len(meshes) == len(asset.shape.parts)
    assert "USD export" not in capfd.readouterr().out
    with pytest.raises(OSError, match="nowhere"):
        export_usd(tmp_path / "nowhere" / "m.usdz")


def test_obj_in_the_frame_of_the_cameras(asset, tmp_path):
    export_obj(asset, tmp_path / "w.obj", world=True)
    mesh = trimesh.load_mesh(tmp_path / "w.obj", process=False, maintain_order=True)
    matrix = world_from_canonical()
    expected = asset.shape.vertices() @ matrix[:3, :3].T + matrix[:3, 3]
    assert mesh.bounds == pytest.approx(np.stack([expected.min(0), expected.max(0)]), abs=1e-5)
    assert "no preferred up" in (tmp_path / "w.obj").read_text()
    unplaced = Asset(asset.shape, asset.space, asset.params)
    with pytest.raises(ValueError, match="no world frame"):
        export_obj(unplaced, tmp_path / "u.obj", world=True)


def test_without_a_real_size_the_longest_side_is_one(asset, tmp_path):
    plain = Asset(asset.shape, asset.space, asset.params)
    export_obj(plain, tmp_path / "m.obj")
    mesh = trimesh.load_mesh(tmp_path / "m.obj")
    assert mesh.extents.max() == pytest.approx(1, rel=1e-5)
    assert mesh.bounds[0, 1] == pytest.approx(0, abs=1e-6)
    assert "longest side = 1" in (tmp_path / "m.obj").read_text()


def test_normals_are_smooth_round_a_cylinder_and_sharp_at_a_box():
    n = 24
    turn = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    vertices = np.concatenate([ring, ring + np.array([0, 0, 1])])
    sides = tuple((i, (i + 1) % n, n + (i + 1) % n, n + i) for i in range(n))
    part = Part("can", vertices, (tuple(range(n))[::-1], tuple(range(n, 2 * n)), *sides))
    points, normals, triangles = with_normals(part)
    assert len(points) == 4 * n, "doubled at the rims only"
    level = np.abs(normals[:, 2]) < 0.5
    assert normals[level] == pytest.approx(points[level] * (1, 1, 0), abs=1e-3)
    assert np.abs(normals[~level, 2]) == pytest.approx(np.ones(2 * n))
    whole = trimesh.Trimesh(points, triangles)
    whole.merge_vertices(merge_norm=True)
    assert whole.is_watertight
    assert whole.volume == pytest.approx(np.pi, rel=0.02)
