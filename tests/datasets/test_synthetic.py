"""Generated sets: shapes of training and test kept apart, whatever the size of the grid."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from datasets import synthetic
from datasets.hulls import skin
from datasets.jobs import Pool
from datasets.synthetic import SyntheticOptions, generate, read, shape_params
from datasets.voxels import surface_grid
from procmodels import load
from procmodels.conditions import when
from procmodels.model import Model
from procmodels.parts.primitives import box
from procmodels.space import Choice, Integer, ParamSpace, Scalar

LEGS = tuple(Scalar(f"leg_{i}", 0.1, 1.0, 50) for i in range(8))
BARS = Integer("bars", 1, 3, only_if=when("back").is_("bars"))


def _model(*parameters):
    space = ParamSpace("blocks", parameters)

    def build(params):
        size = float(params.get("leg_0", 0.5))
        return [box("seat", (0, 0, 0), (1, 1, 0.1)), box("leg", (0, 0, -size), (0.1, 0.1, 0))]

    return Model("blocks", space, build, Path("blocks.safetensors"))


def _sets(model, count):
    options = SyntheticOptions(train_on=count, test_on=count)
    return [
        [tuple(shape_params(model, which, i, options).values()) for i in range(count)]
        for which in ("train_on", "test_on")
    ]


@pytest.mark.parametrize(
    "parameters", [LEGS, (Choice("back", ("none", "bars")), BARS, *LEGS[:2])], ids=["huge grid", "conditions"]
)
def test_sets_share_no_shape_and_listing_no_grid(parameters):
    model = _model(*parameters)
    train, test = _sets(model, 300)
    assert not set(train) & set(test)
    assert len(set(train)) > 280
    assert _sets(model, 300) == [train, test], "the same again"
    steps = {p.name: p for p in model.space.parameters}["leg_1"]
    column = list(model.space.by_name).index("leg_1")
    places = np.array([float(row[column]) for row in train + test])
    index = (places - steps.low) / (steps.high - steps.low) * 49
    assert np.abs(index - index.round()).max() < 1e-6, "on the grid"


def test_a_grid_too_small_for_two_sets_is_said():
    model = _model(Choice("back", ("none", "bars")), Integer("bars", 1, 1, only_if=when("back").is_("bars")))
    with pytest.raises(ValueError, match="too small"):
        # Only two shapes: one of the sets has none, or hardly any.
        _sets(model, 3)


def test_shapes_of_a_huge_space_are_written_and_read(tmp_path):
    model = _model(*LEGS)
    generate(model, tmp_path, SyntheticOptions(train_on=4, train_off=3, test_on=2, test_off=1))
    pairs = read(tmp_path, "train_on", model.space.hash)
    assert pairs.vectors.shape == (4, 8)
    grids = pairs.grids()
    assert grids.shape == (4, 64, 64, 64)
    heights = [grid.any((0, 1)).nonzero()[0] for grid in grids]
    expected = 0.1 + np.array([model.space.decode(v)["leg_0"] for v in pairs.vectors])
    assert [np.ptp(h) + 1 for h in heights] == pytest.approx(64 * expected / np.maximum(expected, 1), abs=2)


STOOL = """
from procmodels.parts.primitives import box
from procmodels.space import ParamSpace, Scalar
SPACE = ParamSpace("stool", (Scalar("height", 0.3, 0.9, 99), Scalar("width", 0.3, 0.9, 99)))


def build(params):
    half, top = params["width"] / 2, params["height"]
    legs = [box("leg", (s * half - 0.05, -0.05, 0), (s * half + 0.05, 0.05, top)) for s in (-1, 1)]
    return [*legs, box("seat", (-half, -0.3, top), (half, 0.3, top + 0.1))]
"""


@pytest.fixture
def stool(tmp_path):
    path = tmp_path / "stool.py"
    path.write_text(STOOL)
    return load(str(path))


def test_any_number_of_workers_makes_the_same_files(stool, tmp_path, monkeypatch):
    monkeypatch.setattr(synthetic, "SHARD", 2)
    options = SyntheticOptions(train_on=0, train_off=5, test_on=0, test_off=2, train_hull=3, test_hull=2)
    for workers in (1, 2):
        generate(stool, tmp_path / str(workers), options, Pool(workers) if workers > 1 else None)
    one, two = ({p.name: p.read_bytes() for p in (tmp_path / w).glob("*.npz")} for w in ("1", "2"))
    assert len(one) == 3 + 1 + 2 + 1
    assert one == two
    manifests = [json.loads((tmp_path / w / "manifest.json").read_text()) for w in ("1", "2")]
    assert manifests[0] == manifests[1]
    # What is missing is made again, by workers too; what is whole is kept.
    lost = tmp_path / "2" / "train_hull_000002.npz"
    kept = tmp_path / "2" / "train_off_000000.npz"
    before = kept.stat().st_mtime_ns
    lost.unlink()
    generate(stool, tmp_path / "2", options, Pool(2))
    assert lost.read_bytes() == one[lost.name]
    assert kept.stat().st_mtime_ns == before
    assert not list((tmp_path / "2").glob("*.ply"))


def test_hulls_are_those_of_their_vectors(stool, tmp_path):
    options = SyntheticOptions(train_on=0, train_off=4, test_on=0, test_off=0, train_hull=4, test_hull=4)
    generate(stool, tmp_path, options)
    sets = {w: read(tmp_path, w, stool.space.hash) for w in ("train_off", "train_hull", "test_hull")}
    assert len({v.tobytes() for pairs in sets.values() for v in pairs.vectors}) == 12, "no shape is in two sets"
    for pairs in (sets["train_hull"], sets["test_hull"]):
        for vector, grid in zip(pairs.vectors, pairs.grids(), strict=True):
            shape = stool.build(stool.space.decode(vector))
            surface = surface_grid(shape.vertices(), shape.triangles())
            near = binary_dilation(grid, np.ones((3, 3, 3)), iterations=3)
            assert (surface & near).sum() > 0.6 * surface.sum()
            assert not (grid & ~skin(grid)).any(), "nothing inside"


def test_the_papers_classes_get_no_hulls_unless_asked(stool, tmp_path):
    generate(stool, tmp_path, SyntheticOptions(train_on=2, train_off=2, test_on=1, test_off=1))
    with pytest.raises(ValueError, match="no train_hull shapes"):
        read(tmp_path, "train_hull", stool.space.hash)
