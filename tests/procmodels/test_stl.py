"""STL files: closed whatever the shape, in millimetres, upright."""

import numpy as np
import pytest
import trimesh

import procmodels
from procmodels.export import Asset
from procmodels.parts.primitives import box
from procmodels.shape import Shape
from procmodels.stl import export_stl
from tests.made_up import CHAIR
from tests.procmodels.closed import open_edges, triangles_of_stl

RICH = [f"procmodels/classes/{name}.py" for name in ("bed", "chair", "shelf", "sofa", "table")]
PAPER = [f"paper/{name}" for name in procmodels.paper_names() if name != "sofa"]


def written(asset, folder):
    path = folder / "m.stl"
    export_stl(asset, path)
    return path.read_bytes()


def closed(model, count, folder, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        params = model.space.sample(rng)
        corners = triangles_of_stl(written(Asset(model.build(params), model.space, params, 0.7), folder))
        assert open_edges(corners) == 0, params
        assert np.isfinite(corners).all()


def by_file(name):
    """A shipped class, its file taken as it is: loading it as a user's would guard every build."""
    return procmodels.registry._shipped(name, "classes", name.rpartition("/")[2].removesuffix(".py"))


@pytest.mark.slow
@pytest.mark.parametrize("name", [*RICH, *PAPER])
def test_closed_for_200_random_shapes(name, tmp_path):
    closed(by_file(name) if name.endswith(".py") else procmodels.load(name), 200, tmp_path)


@pytest.mark.long
def test_closed_for_200_random_sofas_of_the_paper(tmp_path):
    """Blender builds them, a second each."""
    closed(procmodels.load("paper/sofa"), 200, tmp_path)


def test_closed_for_a_few_of_every_class(tmp_path):
    for name in [*PAPER, "paper/sofa"]:
        closed(procmodels.load(name), 3, tmp_path, seed=1)
    for name in RICH:
        closed(by_file(name), 3, tmp_path, seed=1)


def test_boxes_that_share_an_edge_stay_two(tmp_path):
    space = procmodels.load("paper/chair").space
    shape = Shape((box("a", (-0.5, -0.5, 0), (0, 0, 0.5)), box("b", (0, 0, 0), (0.5, 0.5, 0.5))))
    corners = triangles_of_stl(written(Asset(shape, space, {}, 1.0), tmp_path))
    assert open_edges(corners) == 0
    # Without the gap between them the edge is one of four triangles.
    assert open_edges(np.concatenate([p.vertices.astype(np.float32)[p.triangles()] for p in shape.parts])) > 0


@pytest.mark.parametrize(("metres", "longest"), [(0.92, 920.0), (None, 100.0)])
def test_millimetres_upright_on_the_floor(metres, longest, tmp_path):
    model = procmodels.load("paper/chair")
    written(Asset(model.build(CHAIR), model.space, CHAIR, metres), tmp_path)
    mesh = trimesh.load_mesh(tmp_path / "m.stl")
    assert mesh.is_watertight
    assert mesh.extents[2] == pytest.approx(longest, rel=1e-3)  # this chair's height is its longest side
    assert mesh.bounds[0, 2] == pytest.approx(0, abs=0.05)
    volume = model.build(CHAIR).to_trimesh().volume * longest**3
    assert mesh.volume == pytest.approx(volume, rel=5e-3)
    assert not (tmp_path / "m.stl").read_bytes().startswith(b"solid"), "it would be taken for text"
