"""Colours and a picture reach every file format, at the right places."""

from __future__ import annotations

import json
import struct

import bpy
import numpy as np
import pytest
import trimesh

import procmodels
from procmodels.export import Asset, export_glb, export_obj, save_blend
from procmodels.look import Look, linear, srgb
from tests.made_up import CHAIR


@pytest.fixture(scope="module")
def plain():
    model = procmodels.load("paper/chair")
    return Asset(model.build(CHAIR), model.space, CHAIR, 0.9)


def _coloured(plain, picture: bool) -> Asset:
    """Every part of another colour; in the picture part i is the square i of a row of them."""
    parts = plain.shape.parts
    colours = np.random.default_rng(0).uniform(0.1, 0.9, (len(parts), 3))
    if not picture:
        return Asset(plain.shape, plain.space, plain.params, 0.9, look=Look(colours))
    size = 16 * len(parts)
    image = np.zeros((size, size, 3), np.uint8)
    uv = []
    for i, part in enumerate(parts):  # upper edge of the picture: v near 1
        image[:16, 16 * i : 16 * (i + 1)] = np.rint(255 * srgb(colours[i]))
        corners = sum(map(len, part.faces))
        inside = np.random.default_rng(i).uniform(4, 12, (corners, 2))
        uv.append((inside + np.array([16 * i, size - 16])) / size)
    return Asset(plain.shape, plain.space, plain.params, 0.9, look=Look(colours, image, tuple(uv)))


@pytest.fixture(params=[False, True], ids=["colours", "picture"])
def asset(request, plain):
    return _coloured(plain, request.param)


def _seen(mesh: trimesh.Trimesh) -> np.ndarray:
    """(n, 3) sRGB 0..255 that a reader shows at a mesh's vertices."""
    if mesh.visual.uv is None:
        return np.tile(mesh.visual.material.main_color[:3].astype(float), (len(mesh.vertices), 1))
    return np.asarray(mesh.visual.to_color().vertex_colors)[:, :3].astype(float)


def test_srgb_and_back():
    values = np.linspace(0, 1, 100)
    assert linear(srgb(values)) == pytest.approx(values, abs=1e-9)
    assert srgb(np.array([0.0, 0.0031308, 0.2140, 1.0])) == pytest.approx([0, 0.04045, 0.5, 1], abs=1e-3)


def test_glb_shows_every_part_in_its_colour(asset, tmp_path):
    export_glb(asset, tmp_path / "m.glb")
    scene = trimesh.load_scene(tmp_path / "m.glb")
    for part, colour in zip(asset.shape.parts, asset.look.colours, strict=True):
        mesh = scene.geometry[part.name]
        if asset.look.picture is None:  # trimesh tells a factor as it is in the file: linear
            assert mesh.visual.material.baseColorFactor[:3] == pytest.approx(255 * colour, abs=1.1)
        else:
            assert _seen(mesh) == pytest.approx(np.tile(255 * srgb(colour), (len(mesh.vertices), 1)), abs=4)
            assert mesh.visual.material.baseColorTexture.size == asset.look.picture.shape[1::-1]


def test_glb_holds_the_picture_once(plain, tmp_path):
    export_glb(_coloured(plain, True), tmp_path / "m.glb")
    data = (tmp_path / "m.glb").read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    content = json.loads(data[20 : 20 + length])
    assert [len(content[k]) for k in ("images", "textures", "samplers")] == [1, 1, 1]
    assert len(content["materials"]) == len(plain.shape.parts)
    ends = [v["byteOffset"] + v["byteLength"] for v in content["bufferViews"]]
    assert max(ends) <= content["buffers"][0]["byteLength"] == len(data) - length - 28


def test_obj_finds_its_materials(asset, tmp_path):
    export_obj(asset, tmp_path / "m.obj")
    assert "mtllib m.mtl" in (tmp_path / "m.obj").read_text()
    scene = trimesh.load_scene(tmp_path / "m.obj", split_objects=True, group_material=False)
    for part, colour in zip(asset.shape.parts, asset.look.colours, strict=True):
        mesh = scene.geometry[part.name.replace(" ", "_")]
        assert _seen(mesh) == pytest.approx(np.tile(255 * srgb(colour), (len(mesh.vertices), 1)), abs=4)
    assert (tmp_path / "texture.jpg").exists() == (asset.look.picture is not None)


def test_blend_has_the_picture_inside(asset, tmp_path):
    save_blend(asset, tmp_path / "m.blend")
    assert [p.name for p in tmp_path.iterdir()] == ["m.blend"]
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "m.blend"))
    for i, part in enumerate(asset.shape.parts):
        mesh = bpy.data.objects[part.name].data
        (material,) = mesh.materials
        assert material.diffuse_color[:3] == pytest.approx(asset.look.colours[i], abs=1e-5)
        base = material.node_tree.nodes["Principled BSDF"].inputs["Base Color"]
        if asset.look.picture is None:
            assert base.default_value[:3] == pytest.approx(asset.look.colours[i], abs=1e-5)
            continue
        image = base.links[0].from_node.image
        assert image.packed_file is not None
        assert tuple(image.size) == asset.look.picture.shape[1::-1]
        uv = np.empty(2 * len(mesh.loops), np.float32)
        mesh.uv_layers[0].uv.foreach_get("vector", uv)
        assert uv.reshape(-1, 2) == pytest.approx(asset.look.uv[i], abs=1e-5)


def test_a_look_of_another_shape_is_refused(plain):
    with pytest.raises(ValueError, match="another shape"):
        Asset(plain.shape, plain.space, plain.params, look=Look(np.ones((2, 3))))
    with pytest.raises(ValueError, match="needs uv"):
        Look(np.ones((2, 3)), np.zeros((4, 4, 3), np.uint8))
