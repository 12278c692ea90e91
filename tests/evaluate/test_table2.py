"""Tables 2 and 3: real objects through every input, the oracle beside them, kept rows and clear errors."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from procmodels import load
from recon.evaluate import __main__ as command
from recon.evaluate.data.scenes import orbit
from recon.evaluate.data.true_views import all_round, one_view, ray_masks
from recon.evaluate.metrics import chamfer
from recon.evaluate.tables import real_answers, table2, table3
from recon.evaluate.tables.oracle import OracleOptions, oracle
from recon.evaluate.tables.table2_rows import Table2Row
from recon.geometry.raster import iou, silhouettes
from recon.scene import ReconstructionError, cam_from_canonical

QUICK = OracleOptions(random=20, keep=2, fine=600, sweeps=1, tries=1, seeds=(0,))


@pytest.fixture(scope="module")
def chair():
    model = load("chair")
    return model, model.build(model.space.sample(np.random.default_rng(5)))


@pytest.fixture
def folder(chair, tmp_path):
    """A folder of meshes with one chair, Y up and facing -Z, as its files are expected."""
    (tmp_path / "things" / "chair").mkdir(parents=True)
    mesh = chair[1].to_trimesh()
    mesh.vertices = mesh.vertices @ np.array([(-1, 0, 0), (0, 0, 1), (0, 1, 0)], float).T
    mesh.export(tmp_path / "things" / "chair" / "own.ply")
    return tmp_path / "things"


def test_rays_draw_what_the_rasteriser_draws(chair):
    cameras, place = orbit(3, seed=1)
    drawn = silhouettes(chair[1], cameras.K, cam_from_canonical(cameras, place), cameras.sizes)
    for ours, theirs in zip(ray_masks(chair[1].to_trimesh(), cameras, place), drawn, strict=True):
        assert iou(ours, theirs) > 0.995


def test_views_show_the_whole_object(chair):
    mesh = chair[1].to_trimesh()
    for seed in range(6):
        mask, K, pose, azimuth = one_view(mesh, seed)
        assert mask.any()
        assert not np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]]).any()
        assert azimuth < 66 or azimuth > 294  # the front is in view
        redrawn = silhouettes(chair[1], K[None], pose[None], np.array([mask.shape[::-1]]))[0]
        assert iou(mask, redrawn) > 0.99
    seen = all_round(mesh, 4, 0)
    poses, masks = seen.poses, seen.silhouettes
    assert len(poses.cameras) == 4
    assert all(m.any() for m in masks.masks)


def test_a_turn_that_cannot_be_seen_is_no_turn(chair):
    square = trimesh.creation.box((1, 1, 0.6))
    assert [real_answers._visible(square, k) for k in range(4)] == [0, 0, 0, 0]
    oblong = trimesh.creation.box((1, 0.5, 0.6))
    assert [real_answers._visible(oblong, k) for k in range(4)] == [0, 1, 0, 3]
    assert real_answers._visible(chair[1].to_trimesh(), 2) == 2


def test_oracle_finds_our_own_shape(chair):
    model, shape = chair
    mesh = shape.to_trimesh()
    params, distance = oracle(model, mesh, replace(QUICK, random=60, sweeps=3, tries=2))
    assert distance == chamfer(model.build(params).to_trimesh(), mesh)
    assert distance < 0.0005


@pytest.mark.parametrize("name", ["mesh", "500 points"])
def test_answer_is_measured_in_the_objects_frame(chair, name):
    """The file is Y up and faces +Z; a wrong axis anywhere would cost ten times as much."""
    model, shape = chair
    found = real_answers.INPUTS[name](model, shape.to_trimesh(), 0)
    assert found.d_chamfer < 0.0012
    assert found.turn == 0
    assert found.iou is None


def test_rows_are_kept_and_told(folder, tmp_path, monkeypatch):
    options = table2.Table2Options(
        data=(folder,), classes=("chair",), inputs=("mesh",), oracle=QUICK, work=tmp_path / "work"
    )
    (row,) = next(table2.run(options))
    assert (row.data, row.class_name, row.object, row.input) == ("things", "chair", "own", "mesh")
    assert row.d_chamfer is not None
    assert row.oracle <= row.d_chamfer < 0.001
    assert Table2Row.from_json(json.loads(json.dumps(row.as_json()))) == row
    assert (tmp_path / "work" / "table2" / "things_chair_own.jpg").is_file()

    def fails(*_):
        raise ReconstructionError("no common inside")

    monkeypatch.setitem(real_answers.INPUTS, "mesh", fails)
    assert next(table2.run(options)) == [row]  # not measured again
    monkeypatch.setitem(real_answers.INPUTS, "4 masks", fails)
    both = next(table2.run(replace(options, inputs=("mesh", "4 masks"))))
    assert both[0] == row
    assert both[1].error == "no common inside"
    assert "| chair | 4 masks | 0 of 1 |" in table2.summary(both)
    assert [r.input for r in table2.worst(both, "4 masks")["chair"]] == ["4 masks"]
    assert table2.write_worst(both, tmp_path / "work")[0].is_file()


def row(class_name, data="ShapeNetCore.v2", **changes):
    given = {"input": "mesh", "object": "a", "d_chamfer": 0.002, "oracle": 0.001, "turn": 0, "iou": None}
    return Table2Row(data, class_name, **{**given, "seconds": 1.0, "params": {"w": 0.5}, **changes})


def test_summary_stands_beside_oracle_and_paper(tmp_path):
    rows = [row("bed"), row("bed", object="b", d_chamfer=0.004, turn=1)]
    line = table2.summary(rows).splitlines()[2]
    assert line.split(" | ")[2:9] == ["2", "0.0030", "0.0030", "0.0010", "3.00", "0.0023", "50 %"]
    table2.write_csv(rows, tmp_path / "rows.csv")
    assert (tmp_path / "rows.csv").read_text().splitlines()[1].startswith("ShapeNetCore.v2,bed,mesh,a,0.002,0.001")


def test_readme_prints_the_kept_rows():
    root = Path(__file__).parents[2]
    rows = [Table2Row.from_json(r) for r in json.loads((root / "docs/results/table2.json").read_text())]
    assert {r.class_name for r in rows} == {"bed", "chair", "shelf", "sofa", "table"}
    assert table2.summary(rows) in (root / "docs/results.md").read_text()


def test_table3_prints_published_figures_and_says_what_ours_are_of():
    text = table3.summary([row("chair"), row("table"), row("table", object="b", d_chamfer=0.004)])
    assert "| ShapeAssembly, as published by the paper | 0.0068 | 0.0048 | 0.0071 |" in text
    assert "| ours (objects) | 0.0020 (1) |  | 0.0030 (2) |" in text
    assert "not on ShapeNet" not in text
    assert "not on ShapeNet" in table3.summary([row("chair", "Scopia")])


def test_command_says_what_is_wrong(folder, tmp_path, capsys):
    assert command.main(["table2", "--class", "chair"]) == 2
    assert "--data" in capsys.readouterr().err
    assert command.main(["table2", "--data", str(tmp_path / "nowhere"), "--class", "chair"]) == 2
    assert "nowhere" in capsys.readouterr().err
    assert command.main(["table2", "--data", str(folder), "--class", "bed"]) == 2
    assert "no bed in it" in capsys.readouterr().err
    file = tmp_path / "rows.json"
    table2.write_rows([row("chair")], file)
    assert command.main(["table3", "--show", str(file)]) == 0
    assert "ShapeAssembly" in capsys.readouterr().out
