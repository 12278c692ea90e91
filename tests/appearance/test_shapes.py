"""Meshes and clouds hand their colours over."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import procmodels
from procmodels.asset import Y_UP_FROM_Z_UP
from procmodels.export import Asset, export_glb, export_obj
from procmodels.look import Look, srgb
from recon.appearance import shapes
from recon.appearance.atlas import unwrapped
from recon.appearance.fill import picture
from recon.appearance.photos import LookOptions
from recon.appearance.texels import Texels
from recon.files.painted import painted
from recon.scene import Canonical
from tests.appearance.made_photos import stool

COLOURS = np.array([(0.5, 0.1, 0.08), (0.1, 0.12, 0.5), (0.4, 0.32, 0.1)])
OPTIONS = LookOptions(size=256)


def _asset(textured: bool) -> Asset:
    """The stool, standing on the floor: by half its height over where it is."""
    shape, model = stool(), procmodels.load("paper/chair")
    atlas = unwrapped(shape, 128)
    texels = Texels.of(atlas)
    image = picture(texels, COLOURS[atlas.part[texels.triangle]])
    look = Look(COLOURS, image, atlas.uv) if textured else Look(COLOURS)
    return Asset(shape, model.space, {}, look=look)


def _up(asset: Asset) -> np.ndarray:
    return asset.mesh_from_canonical


@pytest.mark.parametrize("textured", [False, True], ids=["colours", "texture"])
@pytest.mark.parametrize("ending", ["glb", "obj"])
def test_a_mesh_hands_its_colours_over(ending, textured, tmp_path):
    asset = _asset(textured)
    path = tmp_path / f"m.{ending}"
    (export_glb if ending == "glb" else export_obj)(asset, path)
    file_from_canonical = Y_UP_FROM_Z_UP @ _up(asset)
    vertices = asset.shape.vertices() @ file_from_canonical[:3, :3].T + file_from_canonical[:3, 3]
    found = shapes.run(path, vertices, asset.shape, Canonical(file_from_canonical), OPTIONS)
    assert found.look.colours == pytest.approx(COLOURS, abs=0.02)
    texels = Texels.of(unwrapped(asset.shape, 256))
    atlas = unwrapped(asset.shape, 256)
    shown = found.look.picture.reshape(-1, 3)[texels.flat].astype(float)
    apart = np.abs(shown - 255 * srgb(COLOURS[atlas.part[texels.triangle]])).max(1)
    assert np.quantile(apart, 0.9) < 8, "all but where the boards touch the seat, which nobody sees"


def test_a_cloud_hands_its_colours_over(tmp_path):
    shape, atlas = stool(), unwrapped(stool(), 256)
    texels = Texels.of(atlas)
    some = np.random.default_rng(0).permutation(len(texels.flat))[:6000]
    rgb = np.rint(255 * srgb(COLOURS[atlas.part[texels.triangle[some]]])).astype(np.uint8)
    trimesh.PointCloud(texels.places[some], rgb).export(tmp_path / "c.ply")
    found = shapes.run(tmp_path / "c.ply", texels.places[some], shape, Canonical(np.eye(4)), OPTIONS)
    assert found.look.colours == pytest.approx(COLOURS, abs=0.01)


def test_shapes_without_colours_stay_plain(tmp_path):
    mesh = stool().to_trimesh()
    for name in ("m.stl", "m.off", "m.ply"):
        mesh.export(tmp_path / name)
        assert painted(tmp_path / name) is None
    (tmp_path / "broken.obj").write_text("v nonsense\nf 1 2 3\n")
    assert painted(tmp_path / "broken.obj") is None


def test_colours_of_another_place_are_not_used(tmp_path):
    asset = _asset(False)
    export_obj(asset, tmp_path / "m.obj")
    points = asset.shape.vertices() + np.array([3.0, 0, 0])
    assert shapes.run(tmp_path / "m.obj", points, asset.shape, Canonical(np.eye(4)), OPTIONS).look is None
