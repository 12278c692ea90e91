"""python -m procmodels build: the shape of a params.json again, in every format; errors are for people."""

import json

import numpy as np
import pytest
import trimesh

import procmodels
from procmodels.__main__ import main
from procmodels.file_kinds import KINDS
from tests.made_up import CHAIR
from tests.results import assert_opens

PARAMS = {"class": "paper/chair", "values": CHAIR, "height_metres": 0.9}


@pytest.fixture
def params(tmp_path):
    path = tmp_path / "params.json"
    path.write_text(json.dumps(PARAMS))
    return path


def fails(capsys, *arguments):
    assert main(["build", *map(str, arguments)]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    return said


@pytest.mark.parametrize("kind", [".glb", ".obj", ".stl", ".blend", ".usdz"])
def test_every_kind_opens(params, kind):
    out = params.with_name(f"chair{kind}")
    assert main(["build", str(params), "--out", str(out)]) == 0
    assert_opens(out)
    assert sorted(p.name for p in out.parent.iterdir()) == sorted(["params.json", out.name]), "nothing is left about"
    assert kind in KINDS


def test_size_and_axes_are_as_in_a_result(params):
    for up, axis in (("y", 1), ("z", 2)):
        out = params.with_name(f"{up}.obj")
        assert main(["build", str(params), "--out", str(out), "--obj-up", up]) == 0
        mesh = trimesh.load_mesh(out)
        assert mesh.extents[axis] == pytest.approx(0.9, rel=1e-5)
        assert mesh.bounds[0, axis] == pytest.approx(0, abs=1e-6)
    assert main(["build", str(params), "--out", str(params.with_name("a.glb")), "--height", "1.8"]) == 0
    assert trimesh.load_scene(params.with_name("a.glb")).extents[1] == pytest.approx(1.8, rel=1e-5)


def test_other_values_keep_the_height(params):
    params.write_text(json.dumps(PARAMS | {"values": CHAIR | {"width": 1.0, "leg_height": 0.3}}))
    assert main(["build", str(params), "--out", str(params.with_name("b.stl"))]) == 0
    mesh = trimesh.load_mesh(params.with_name("b.stl"))
    assert mesh.extents[2] == pytest.approx(900, rel=1e-3)
    assert mesh.extents[0] == pytest.approx(900, rel=1e-2), "as wide as high"


def test_nothing_is_replaced(params, capsys):
    out = params.with_name("mine.stl")
    out.write_text("mine")
    assert "is not replaced" in fails(capsys, params, "--out", out)
    assert out.read_text() == "mine"


def test_values_that_do_not_fit_are_named(params, capsys):
    params.write_text(json.dumps(PARAMS | {"values": CHAIR | {"width": 7, "legs": "golden", "wings": 2}}))
    said = fails(capsys, params, "--out", params.with_name("a.glb"))
    for word in ("width = 7", "golden", "wings: unknown"):
        assert word in said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not JSON"),
        ("[1]", "an object"),
        ('{"class": "chair"}', '"values"'),
        ('{"values": {}}', '"class"'),
        ('{"class": "throne", "values": {}}', "throne"),
        ('{"class": "evil.py", "values": {}}', "only when --class names it"),
        (json.dumps(PARAMS | {"height_metres": "tall"}), "height_metres"),
        (json.dumps(PARAMS | {"world_from_canonical": [1, 2]}), "world_from_canonical"),
    ],
)
def test_files_that_cannot_be_used(params, capsys, text, words):
    params.write_text(text)
    assert words in fails(capsys, params, "--out", params.with_name("a.glb"))
    assert not params.with_name("a.glb").exists()


def test_endings_and_folders(params, capsys):
    assert ".stl" in fails(capsys, params, "--out", params.with_name("a.step"))
    assert "does not exist" in fails(capsys, params, "--out", params.with_name("none") / "a.glb")
    assert "cannot be read" in fails(capsys, params.with_name("gone.json"), "--out", params.with_name("a.glb"))
    with pytest.raises(SystemExit):
        main(["build", str(params), "--out", "a.glb", "--height", "-1"])


def test_another_version_of_the_class_is_said(params, capsys):
    params.write_text(json.dumps(PARAMS | {"space_hash": "0" * 16}))
    assert main(["build", str(params), "--out", str(params.with_name("a.obj"))]) == 0
    assert "another version" in capsys.readouterr().err


def test_a_models_own_file(params):
    """What --class names is run, as everywhere; the values are those of its space."""
    own = procmodels.registry.HERE / "paper" / "table.py"
    values = procmodels.load("paper/table").space.sample(np.random.default_rng(0))
    params.write_text(json.dumps({"class": "stool", "values": values}))
    assert main(["build", str(params), "--out", str(params.with_name("a.stl")), "--class", str(own)]) == 0
    assert_opens(params.with_name("a.stl"))
