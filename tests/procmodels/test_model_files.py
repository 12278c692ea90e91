"""Model files of users that do not do what they should: one line with file and line number, never more."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import procmodels
from procmodels import ModelError, model_file
from recon.command import main
from recon.pipelines import class_selection
from tests.procmodels.touching import all_touch

ROOT = Path(__file__).parents[2]
HEAD = """from procmodels.parts.primitives import box
from procmodels.space import ParamSpace, Scalar
SPACE = ParamSpace('my_stool', (Scalar('depth', 0.2, 1.0, 3),))
"""
BUILD = "def build(params):\n    return [box('seat', (0, 0, 0), (1, params['depth'], 0.5))]\n"


def file(tmp_path, text):
    path = tmp_path / "my_stool.py"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("import sys\nsys.exit(7)\n", 2, "the model file ends the program (SystemExit: 7)"),
        ("x = 1\nraise SystemExit\n", 2, "the model file ends the program"),
        ("x = 1\n\ndef f(:\n", 3, "SyntaxError: invalid syntax"),
        ("x = (1,\n", 1, "SyntaxError: '(' was never closed"),
        ("import nothing_like_it\n", 1, "ModuleNotFoundError: No module named 'nothing_like_it'"),
        ("\n\n1 / 0\n", 3, "ZeroDivisionError: division by zero"),
        ("def f():\n    f()\nf()\n", 2, "RecursionError"),
        ("raise ValueError('two\\nlines')\n", 1, "ValueError: two lines"),
        ("assert False\n", 1, "AssertionError"),
        (HEAD + "def build(params):\n    raise KeyError('legs')\n", 5, "KeyError: 'legs'"),
        (HEAD + "def build(params):\n    exit()\n", 5, "ends the program"),
        (HEAD + "def build():\n    return []\n", 4, "TypeError"),
        (HEAD + "def build(params):\n    return []\n", 4, "must return a list of Parts, not []"),
        (HEAD + "def build(params):\n    return None\n", 4, "must return a list of Parts, not None"),
        (HEAD + BUILD.replace("1, params", "float('nan'), params"), 4, "none of them infinite or NaN"),
        (HEAD + BUILD.replace("(1, params['depth'], 0.5)", "(0, 0, 0)"), 4, "single point"),
        (HEAD.replace("0.2, 1.0", "1.0, 0.2") + BUILD, None, "out of range"),
        (b"x = 1\ny = '\xff'\n", None, "SyntaxError"),
        (b"x = 1\0\n", None, "null bytes"),
        ("", None, "defines SPACE (a ParamSpace) and build(params)"),
        ("SPACE, build = 1, 2\n", None, "defines SPACE (a ParamSpace) and build(params)"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path, text, line, said):
    path = file(tmp_path, text)
    with pytest.raises(ModelError) as caught:
        procmodels.load(str(path))
    message = str(caught.value)
    assert message.startswith(f"{path}, line {line}: " if line else str(path))
    assert said in message
    assert "\n" not in message
    assert list(tmp_path.iterdir()) == [path], "nothing is left beside it"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("import time\ntime.sleep(30)\n", 2),
        ("while True:\n    try:\n        pass\n    except Exception:\n        pass\n", None),
        (HEAD + "def build(params):\n    while True:\n        pass\n", None),
    ],
)
def test_a_file_that_never_ends_is_given_up(tmp_path, monkeypatch, text, line):
    monkeypatch.setattr(model_file, "SECONDS", 0.5)
    with pytest.raises(ModelError, match="has not finished after") as caught:
        procmodels.load(str(file(tmp_path, text)))
    assert f"my_stool.py, line {line or ''}" in str(caught.value)


def test_a_model_that_fails_on_some_shapes_only(tmp_path):
    few = "def build(params):\n    assert params['depth'] < 0.99\n" + BUILD.splitlines()[1]
    model = procmodels.load(str(file(tmp_path, HEAD + few)))
    with pytest.raises(ModelError, match=r"my_stool\.py, line 5: AssertionError"):
        model.build({"depth": 1.0})


def test_other_functions_of_a_file_say_where_they_fail(tmp_path):
    text = HEAD + BUILD + "def turned_round(params):\n    return params['colour']\n"
    model = procmodels.load(str(file(tmp_path, text)))
    with pytest.raises(ModelError, match=r"my_stool\.py, line 7: KeyError: 'colour'"):
        model.turned_round({"depth": 0.5})


def test_a_dataclass_with_annotations_as_text(tmp_path):
    text = "from __future__ import annotations\nfrom dataclasses import dataclass\n" + HEAD + BUILD
    text += "@dataclass\nclass Leg:\n    height: float\n"
    assert procmodels.load(str(file(tmp_path, text))).name == "my_stool"


@pytest.mark.parametrize("code", ["raise SystemExit(0)", "1 / 0"])
def test_the_command_ends_with_one_line(tmp_path, capsys, code):
    path = file(tmp_path, code)
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    out = tmp_path / "out"
    assert main([str(tmp_path / "a.obj"), "--class", str(path), "--out", str(out)]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"error: {path}, line 1: ")
    assert not out.exists()


def test_what_a_file_prints_stays_out_of_the_summary(tmp_path, capsys):
    path = file(tmp_path, "print('hello')\n")
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    assert main([str(tmp_path / "a.obj"), "--class", str(path), "--out", str(tmp_path / "out")]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "hello" in captured.err


def test_help_says_that_a_file_is_run(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "code that is run" in " ".join(capsys.readouterr().out.split())


def test_another_build_makes_fits_stale(tmp_path):
    """Also when size and date of the file stay the same."""
    path = file(tmp_path, HEAD + BUILD)
    path.with_suffix(".safetensors").write_bytes(b"weights")
    dates = (path.stat().st_atime_ns, path.stat().st_mtime_ns)
    first = class_selection.key(procmodels.load(str(path)))
    assert class_selection.key(procmodels.load(str(path))) == first
    path.write_text(HEAD + BUILD.replace("0.5", "0.6"))
    os.utime(path, ns=dates)
    changed = procmodels.load(str(path))
    assert changed.build({"depth": 1.0}).bounds()[1, 2] == pytest.approx(0.3)
    assert class_selection.key(changed) != first
    path.write_text(HEAD + BUILD)
    path.with_suffix(".safetensors").write_bytes(b"Weights")
    assert class_selection.key(procmodels.load(str(path))) != first


def test_the_key_of_our_own_models_follows_their_sources(tmp_path):
    """Of a copy of the package, one of whose shared parts is edited."""
    copy = tmp_path / "procmodels"
    copy.mkdir()
    for source in (ROOT / "procmodels").rglob("*.py"):
        target = copy / source.relative_to(ROOT / "procmodels")
        target.parent.mkdir(exist_ok=True)
        target.write_text(source.read_text())
    ask = [sys.executable, "-c", "import procmodels; print(procmodels.load('chair').code)"]
    codes = []
    for _ in range(2):
        codes.append(subprocess.run(ask, capture_output=True, text=True, cwd=tmp_path, check=True).stdout)
        with (copy / "shape.py").open("a") as shared:
            shared.write("\n# edited\n")
    assert codes[0] != codes[1]
    assert codes[0].strip() == procmodels.load("chair").code


def test_the_model_of_the_documentation_builds_what_it_says(tmp_path):
    page = (ROOT / "docs" / "own-models.md").read_text()
    model = procmodels.load(str(file(tmp_path, page.split("```python\n")[1].split("```")[0])))
    values = {"width": 0.8, "roundness": 0.5, "legs": "four", "splay": 10.0}
    shape = model.build(values)
    assert [p.name for p in shape.parts] == ["seat", "leg 1", "leg 2", "leg 3", "leg 4"]
    assert all_touch(shape.parts)
    assert model.space.active({**values, "legs": "block"}) == {"width", "roundness", "legs"}
    assert [p.name for p in model.build({**values, "legs": "block"}).parts] == ["seat", "block"]
