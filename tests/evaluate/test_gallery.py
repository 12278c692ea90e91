"""The gallery's pictures: voxels as cubes, rows of the right size, one small file a class."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from datasets.voxels import surface_grid
from recon.evaluate import gallery
from recon.evaluate.__main__ import main
from recon.evaluate.gallery import GalleryOptions, cubes

SMALL = GalleryOptions(shapes=2, columns=2, held_out=1, width=160)


def test_cubes_lie_in_their_voxels():
    grid = np.zeros((64, 64, 64), bool)
    grid[3, 60, 31] = grid[4, 60, 31] = True
    part = cubes(grid).parts[0]
    assert len(part.vertices) == 16
    assert len(part.faces) == 12
    centre = (np.array([3, 60, 31]) + 0.5) / 64 - 0.5
    assert part.vertices[:8].mean(0) == pytest.approx(centre)
    assert np.ptp(part.vertices[:8], axis=0) == pytest.approx(gallery.CUBE / 64)
    a, b, c = (part.vertices[part.triangles()[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->i", np.cross(a, b), c).sum() / 6
    assert volume == pytest.approx(2 * (gallery.CUBE / 64) ** 3), "all sides face outwards"


def test_cubes_show_a_shape(chair):
    shape = chair.build(chair.space.grid_point(0))
    grid = surface_grid(shape.vertices(), shape.triangles())
    assert cubes(grid).bounds() == pytest.approx(shape.bounds(), abs=1 / 64)


def test_an_empty_grid_leaves_its_place_empty(chair):
    shape = chair.build(chair.space.grid_point(0))
    picture = gallery.draw([[("", shape)] * 2, [("a", shape), ("b", None), ("c", shape)]], SMALL)
    side = (160 - 2 * gallery.MARGIN - 2 * gallery.GAP) // 3
    place = picture[-gallery.MARGIN - gallery.CAPTION - side : -gallery.MARGIN - gallery.CAPTION]
    left = gallery.MARGIN + side + gallery.GAP
    assert (place[:, left : left + side] == gallery.PAPER).all()
    assert (place[:, gallery.MARGIN : gallery.MARGIN + side] != gallery.PAPER).any()


def test_one_small_picture_a_class(tmp_path):
    options = replace(SMALL, task4=False, out=tmp_path / "g", work=tmp_path)
    (path,) = gallery.run(["chair"], options)
    assert path == tmp_path / "g" / "chair.jpg"
    assert cv2.imread(str(path)).shape[1] == 160
    assert path.stat().st_size <= gallery.LARGEST


def test_missing_weights_are_explained(tmp_path, monkeypatch, capsys):
    from procmodels import registry

    monkeypatch.setattr(registry, "weights_of", lambda file: tmp_path / file.with_suffix(".safetensors").name)
    assert main(["gallery", "--class", "chair", "--out", str(tmp_path)]) == 2
    assert "nnproc.train" in capsys.readouterr().err
