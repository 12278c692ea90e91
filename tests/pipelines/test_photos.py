"""The command as a person meets it: bad input is explained, nothing is lost, an interrupted run goes on."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.command import main
from recon.pipelines.photos import STAGES
from tests.results import assert_opens

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "datasets" / "samples" / "chair"


def _photo(path, seed=0, size=(240, 180)):
    noise = np.random.default_rng(seed).integers(0, 255, (size[1] // 8, size[0] // 8, 3)).astype(np.uint8)
    cv2.imwrite(str(path), cv2.resize(noise, size))


@pytest.fixture
def photos(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for i in range(8):
        _photo(folder / f"p{i}.jpg", i)
    return folder


def _fails(capsys, *arguments, code=2):
    assert main([str(a) for a in arguments]) == code
    message = capsys.readouterr().err
    assert "Traceback" not in message
    assert "error: " in message
    return message


def test_no_such_folder(tmp_path, capsys):
    assert "not a folder" in _fails(capsys, tmp_path / "nowhere", "--out", tmp_path / "o")


def test_an_empty_folder(tmp_path, capsys):
    (tmp_path / "photos").mkdir()
    assert "photos" in _fails(capsys, tmp_path / "photos", "--out", tmp_path / "o")


def test_a_folder_without_photos(tmp_path, capsys):
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "notes.txt").write_text("hello")
    (folder / "fake.jpg").write_text("not a picture")
    assert str(folder) in _fails(capsys, folder, "--out", tmp_path / "o")


def test_one_photo_without_a_mask(tmp_path, capsys):
    folder = tmp_path / "photos"
    folder.mkdir()
    _photo(folder / "only.jpg")
    assert "mask" in _fails(capsys, folder, "--out", tmp_path / "o")


def test_photos_that_are_all_the_same(photos, tmp_path, capsys):
    first, *others = sorted(photos.iterdir())
    for other in others:
        shutil.copy(first, other)
    assert "identical" in _fails(capsys, photos, "--out", tmp_path / "o")
    assert not (tmp_path / "o" / "report.json").exists()


def test_unknown_class_lists_the_known(photos, tmp_path, capsys):
    message = _fails(capsys, photos, "--class", "throne", "--out", tmp_path / "o")
    assert "throne" in message
    assert "chair" in message


def test_unknown_stage_and_senseless_height(photos, tmp_path, capsys):
    assert "frames, poses" in _fails(capsys, photos, "--from", "cooking", "--out", tmp_path / "o")
    assert "metres" in _fails(capsys, photos, "--height", "-1", "--out", tmp_path / "o")


def test_an_output_folder_that_cannot_be_written(photos, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert "--out" in _fails(capsys, photos, "--out", tmp_path / "file" / "o")


def test_weights_missing_or_of_another_space(photos, tmp_path, capsys, monkeypatch):
    from procmodels import registry

    monkeypatch.setattr(registry, "weights_of", lambda file: tmp_path / file.with_suffix(".safetensors").name)
    assert "nnproc.train" in _fails(capsys, photos, "--out", tmp_path / "o")


def test_blender_that_does_not_load(photos, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", None)
    message = _fails(capsys, photos, "--out", tmp_path / "o")
    assert "apt-get install" in message
    assert "bpy==" in message


def test_too_few_photos_register(photos, tmp_path, capsys):
    """Noise has features and no two photos show the same: nothing can be placed."""
    message = _fails(capsys, photos, "--out", tmp_path / "o", code=3)
    assert "of 8 photos" in message
    assert "texture" in message or "overlap" in message


def test_help_names_every_flag(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    for flag in ("--class", "--out", "--masks", "--height", "--seed", "--force", "--from", "--verbose"):
        assert flag in text


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The shipped set with the user's own (here: the true) masks, once for all the tests below."""
    out = tmp_path_factory.mktemp("finished") / "out"
    code = main([*_command(), "--out", str(out), "--height", "0.9"])
    assert code == 0
    return out


def _command():
    return [str(SHIPPED / "photos"), "--class", "chair", "--masks", str(SHIPPED / "truth" / "masks")]


@pytest.mark.slow
def test_everything_promised_is_written(finished):
    for name in ("mesh.glb", "mesh.obj", "model.blend", "params.json", "report.json", "report.html"):
        assert_opens(finished / name)
    assert "map_Kd texture.jpg" in (finished / "mesh.mtl").read_text()
    assert (finished / "texture.jpg").stat().st_size > 50_000
    assert "seat" in json.loads((finished / "params.json").read_text())["colours"]
    assert_opens(finished / "contact_sheet.png")
    assert len(list((finished / "masks").glob("*.png"))) >= 25
    report = json.loads((finished / "report.json").read_text())
    assert {
        "class",
        "params",
        "views",
        "mean_iou",
        "registered",
        "confidence",
        "seconds",
        "warnings",
        "versions",
    } <= set(report)
    assert report["registered"]["of"] == 28
    assert report["registered"]["n"] >= 26
    assert report["seconds"]["total"] > 0
    assert all({"name", "iou", "used"} <= set(v) for v in report["views"])


@pytest.mark.slow
def test_finished_stages_are_skipped_and_the_result_is_the_same(finished, caplog):
    before = (finished / "params.json").read_text()
    with caplog.at_level("INFO", "recon"):
        assert main([*_command(), "--out", str(finished), "--height", "0.9"]) == 0
    assert caplog.text.count("skipped") == len(STAGES) - 1
    assert (finished / "params.json").read_text() == before


@pytest.mark.slow
def test_a_run_that_was_killed_goes_on_and_ends_the_same(finished, tmp_path):
    """Killed while it refines (everything before is taken from the finished run's store)."""
    out = tmp_path / "out"
    shutil.copytree(finished / ".recon", out / ".recon")
    for name in ("refine.json", "fit.json"):
        (out / ".recon" / name).unlink()
    command = [sys.executable, str(ROOT / "run_recon.py"), *_command(), "--out", str(out), "--height", "0.9"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stderr is not None
    for line in process.stderr:
        if "refine" in line:
            os.kill(process.pid, signal.SIGKILL)
            break
    process.wait()
    assert not (out / "report.json").exists(), "nothing half-written"
    assert (out / ".recon" / "fit.json").exists()
    assert subprocess.run(command, capture_output=True, cwd=ROOT, check=False).returncode == 0
    assert json.loads((out / "params.json").read_text()) == json.loads((finished / "params.json").read_text())
