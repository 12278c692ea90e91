"""Nothing that nobody foresaw reaches the user as a traceback: one line, exit code 3, and a log for repairs."""

import json
import logging
import os
import resource
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.cameras import known_cameras
from recon.command import main
from recon.files.image_library import Library
from recon.fitting import shape_fit
from recon.scene import InputError, ReconstructionError
from recon.system import limits, net, user_files

ROOT = Path(__file__).parents[2]
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def raising(error):
    def work(about):
        about.what = "chair.obj"
        raise error

    return work


def test_errors_with_words_of_their_own_pass(capsys):
    for error, code in ((InputError("a.obj is empty"), 2), (ReconstructionError("too few photos"), 3)):
        assert net.run(raising(error)) == code
        assert capsys.readouterr().err == f"error: {error}\n"


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ZeroDivisionError("division by zero"), "ZeroDivisionError (division by zero), which was not foreseen"),
        (MemoryError(), "there is not enough memory"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried 8 bytes"), "there is not enough memory"),
        (RecursionError("maximum recursion depth exceeded"), "nested too deeply"),
        (PermissionError(13, "Permission denied", b"caf\xe9.jpg"), "Permission denied (caf\\xe9.jpg)"),
        (OSError(28, "No space left on device"), "the disk is full"),
        (ImportError("libz.so: failed to map segment"), "a library cannot be loaded (libz.so: failed to map segment)"),
        (SystemExit(0), "something asked the program to end"),
        (ValueError("two\nlines\r\n of \x1b[31m words"), "ValueError (two lines of \\x1b[31m words)"),
        (ValueError("x" * 10**6), "x ... x"),
    ],
)
def test_what_nobody_foresaw_is_one_line_and_a_log(capsys, tmp_path, monkeypatch, error, words):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert net.run(raising(error)) == net.FAILED
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.startswith("error: chair.obj: failed at the stage looking at the input: ")
    assert words in said
    (log,) = tmp_path.glob("recon-failed-*.log")
    assert str(log) in said
    assert "Traceback" in log.read_text()


def test_an_interrupt_is_no_failure():
    with pytest.raises(KeyboardInterrupt):
        net.run(raising(KeyboardInterrupt()))


def test_the_stage_is_named_and_the_log_lies_with_the_run(tmp_path, capsys, monkeypatch, caplog):
    caplog.set_level(logging.INFO, "recon")

    def broken(*args):
        raise IndexError("list index out of range")

    (tmp_path / "a.obj").write_text(TETRAHEDRON)
    monkeypatch.setattr(shape_fit, "run", broken)
    out = tmp_path / "out"
    assert main([str(tmp_path / "a.obj"), "--out", str(out)]) == 3
    last = capsys.readouterr().err.splitlines()[-1]
    assert "a.obj: failed at the stage fit: IndexError (list index out of range)" in last
    log = Path(last.rsplit("details are in ", 1)[1])
    assert "in broken" in log.read_text()
    assert [p.name for p in out.iterdir()] == [".recon"], "no results, but the stage that was finished"


def test_where_no_log_can_be_written_that_is_said(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    assert net.run(raising(KeyError("a"))) == 3
    assert "no log could be written" in capsys.readouterr().err


@pytest.mark.parametrize("flag", ["-v", "-d"])
def test_too_little_memory_is_said_before_libraries_are_loaded(tmp_path, flag):
    """With less than they need they wait for ever or end the process."""
    (tmp_path / "a.obj").write_text(TETRAHEDRON)
    command = f'ulimit {flag} 300000; exec "{sys.executable}" run_recon.py "{tmp_path}/a.obj" --out "{tmp_path}/out"'
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, timeout=100)
    assert done.returncode == 3
    assert done.stderr.startswith("error: this process may take 292 MB of memory, and ")
    assert done.stderr.count("\n") == 1


def test_enough_memory_is_enough():
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    assert allowed == resource.RLIM_INFINITY or allowed >= limits.ADDRESS_SPACE
    assert net.run(lambda about: 0) == 0


def odd_paths(folder):
    """Paths that are neither files nor folders, and what is said of them."""
    os.mkfifo(folder / "pipe")
    (folder / "nowhere").symlink_to("gone")
    (folder / "loop").symlink_to("loop")
    (folder / "zero").symlink_to("/dev/zero")
    yield folder / "pipe", "is a pipe, a socket or a device"
    yield folder / "zero", "is a pipe, a socket or a device"
    yield folder / "nowhere", "is a link to gone, which does not exist"
    yield folder / "loop", "cannot be opened (Too many levels of symbolic links)"
    yield folder / ("n" * 300), "cannot be opened (File name too long)"
    yield folder / "two\nlines", "two\\nlines does not exist"
    yield folder / "caf\udce9", "caf\\xe9 does not exist"


@pytest.mark.parametrize("option", ["", "--masks", "--mask", "--pix3d", "--cameras"])
def test_what_is_no_file_is_refused_by_name(tmp_path, capsys, option):
    (tmp_path / "a.obj").write_text(TETRAHEDRON)
    for path, words in odd_paths(tmp_path):
        given = [option, str(path)] if option else []
        assert main([str(tmp_path / "a.obj") if option else str(path), *given, "--out", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"error: {option or 'INPUT'} ")
        assert words in said.replace("two lines", "two\\nlines")
        assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--seed=-1"], "a seed is a whole number from 0 to"),
        (["--seed=1e9"], "a whole number is wanted, got '1e9'"),
        ([f"--seed={'9' * 5000}"], "a seed is a whole number from 0 to"),
        (["--height=nan"], "a finite number is wanted"),
        (["--height=-1"], "--height is in metres, from 0.01 to 100"),
        (["--camera-off=inf"], "a finite number is wanted"),
        (["--frames=many"], "a whole number is wanted, got 'many'"),
        (["--out="], "a file or folder must be named"),
        (["--masks= "], "a file or folder must be named"),
        (["--nothing"], "unrecognized arguments: --nothing"),
        (["--height"], "expected one argument"),
    ],
)
def test_options_that_make_no_sense(tmp_path, capsys, words, message):
    (tmp_path / "a.obj").write_text(TETRAHEDRON)
    assert main([str(tmp_path / "a.obj"), "--out", str(tmp_path / "out"), *words]) == 2
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert message in errors[0]


@pytest.mark.parametrize("name", ["n" * 300, "loop", "loop/below", "a.obj/below"])
def test_results_need_a_name_that_a_folder_can_have(tmp_path, capsys, name):
    (tmp_path / "a.obj").write_text(TETRAHEDRON)
    (tmp_path / "loop").symlink_to("loop")
    assert main([str(tmp_path / "a.obj"), "--out", str(tmp_path / name)]) == 2
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert name in errors[0]


def test_films_and_huge_frames_are_no_videos_of_furniture(tmp_path, monkeypatch):
    from recon.files import video

    path = tmp_path / "v.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (160, 120))
    for i in range(20):
        writer.write(np.roll(np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8), 9 * i, 1))
    writer.release()
    for name, value, words in (
        ("FRAME_PIXELS", 160 * 120 - 1, "frames of 160 x 120"),
        ("VIDEO_FRAMES", 19, "frames or"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(limits, name, value)
            with pytest.raises(InputError, match=words):
                video.extract(path, tmp_path / "frames", video.VideoOptions(count=3))
    assert video.extract(path, tmp_path / "frames", video.VideoOptions(count=3)) == ()


def test_files_that_are_read_whole_have_a_size(tmp_path):
    path = tmp_path / "pix3d.json"
    with path.open("wb") as file:
        file.truncate(limits.JSON + 1)
    with pytest.raises(InputError, match=r"pix3d\.json is too large: 64 MB, at most 64 are read"):
        user_files.read_json(path, "Pix3D's pix3d.json")
    path.write_bytes(b"\xef\xbb\xbf[1]")
    assert user_files.read_json(path, "a list") == [1]
    path.write_bytes(b"[" * 100_000)
    with pytest.raises(InputError, match=r"as a list .it is nested too deeply"):
        user_files.read_json(path, "a list")
    with pytest.raises(InputError, match="is not there, or is no file"):
        user_files.read_json(tmp_path, "a list")


def test_cameras_a_world_away(tmp_path):
    matrix = np.eye(4)
    matrix[0, 3] = 1e300
    frame = {"file_path": "a.png", "fl_x": 100.0, "w": 90, "h": 80, "transform_matrix": matrix.tolist()}
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": [frame]}))
    source = tmp_path / "transforms.json"
    with pytest.raises(InputError, match=r"transforms\.json: the camera of a\.png stands 1e\+300 units away"):
        known_cameras.read(source, Library(tmp_path, source))


@pytest.mark.parametrize("data", [b"PK\5\6" + bytes(18), b"\x93NUMPY\1\0v\0{'descr': '<f8', 'shape': (3,".ljust(200)])
def test_what_is_called_npy_and_is_none(tmp_path, capsys, data):
    (tmp_path / "a.npy").write_bytes(data)
    assert main([str(tmp_path / "a.npy"), "--out", str(tmp_path / "out")]) == 2
    assert "a.npy is " in capsys.readouterr().err
