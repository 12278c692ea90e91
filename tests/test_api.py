"""The project as a library: the truth comes back, in silence, from any folder; nothing heavy loads with the name."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import procmodels
import recon

ROOT = Path(__file__).parents[1]
TRUTH = {"width": 0.72, "depth": 0.5, "leg_height": 0.36, "legs": "basic", "arms": "none", "back": "hbar"}
PROGRAM = """
import json, sys
import recon
heavy = [m for m in ("numpy", "torch", "cv2", "bpy", "open3d") if m in sys.modules]
found = recon.reconstruct(sys.argv[1], class_name="paper/chair", up="z", height=0.9)
with open(sys.argv[2], "w") as file:
    json.dump([heavy, found.params, str(found.folder), found.size.tolist()], file)
"""


@pytest.fixture(scope="module")
def file(chair, tmp_path_factory):
    path = tmp_path_factory.mktemp("mesh") / "chair.ply"
    chair.build(TRUTH).to_trimesh().export(path)
    return path


@pytest.fixture(scope="module")
def found(file, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "chair"
    return recon.reconstruct(file, class_name="paper/chair", up="z", height=0.9, out=out)


def _is_the_truth(params):
    assert {k: v for k, v in params.items() if isinstance(v, str)} == {k: v for k, v in TRUTH.items() if k[-1] in "sk"}
    return all(abs(params[k] - TRUTH[k]) < 0.02 for k in ("width", "depth", "leg_height"))


def test_the_truth_comes_back_with_all_that_is_known_of_it(found, chair):
    assert _is_the_truth(found.params)
    assert found.class_name == "paper/chair"
    assert found.belongs
    assert found.confidence > 0.8
    assert found.mean_iou is None
    assert found.distance < 1e-3
    true = np.ptp(chair.build(TRUTH).bounds(), axis=0)
    np.testing.assert_allclose(found.size, true / true[2] * 0.9, atol=0.02)
    np.testing.assert_allclose(found.world_from_canonical, np.eye(4), atol=0.02)
    built = procmodels.load("paper/chair").build(found.params)
    np.testing.assert_array_equal(found.shape().vertices(), built.vertices())
    assert json.loads((found.folder / "report.json").read_text()) == found.report
    assert (found.folder / "model.blend").is_file()


def test_in_silence_from_any_folder_leaving_nothing(file, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "tmp").mkdir()
    words = [sys.executable, "-c", PROGRAM, str(file), str(tmp_path / "answer.json")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path / "tmp")}
    run = subprocess.run(words, cwd=tmp_path / "empty", env=environment, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")
    heavy, params, folder, size = json.loads((tmp_path / "answer.json").read_text())
    assert heavy == []
    assert _is_the_truth(params)
    assert (folder, size[2]) == ("None", pytest.approx(0.9, abs=0.01))
    assert [*(tmp_path / "empty").iterdir(), *(tmp_path / "tmp").iterdir()] == []


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"frames": 3}, "--frames is not for a mesh"),
        ({"class_name": "spoon"}, "there is no model 'spoon'"),
        ({"height": 0.001}, "--height is in metres"),
        ({"box": (1, 2, 3, 4)}, "--box is not for a mesh"),
        ({"input": "sculpture"}, "kinds: "),
        ({"masks": "/nowhere/masks"}, "--masks /nowhere/masks does not exist"),
    ],
)
def test_what_cannot_be_used_is_an_error_for_people(file, tmp_path, options, said):
    with pytest.raises(recon.InputError, match=said):
        recon.reconstruct(file, out=tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_other_names_are_none_of_it():
    assert set(recon.__all__) <= set(dir(recon))
    with pytest.raises(AttributeError, match="has no attribute 'rekonstruct'"):
        _ = recon.rekonstruct
