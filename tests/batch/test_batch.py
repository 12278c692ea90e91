"""What a batch does around its jobs: it keeps what is done, runs what is not, and tells; the jobs here are made up."""

import csv
import json
from pathlib import Path

import pytest

from datasets.jobs import Here
from recon.batch import one, records, run
from recon.batch.__main__ import main, parser, summary
from recon.batch.entries import entries
from recon.batch.options import given
from recon.scene import InputError
from recon.system import manifest, run_lock
from tests.batch.test_entries import mesh

DONE = {
    "status": "done",
    "class": "paper/chair",
    "belongs": True,
    "confidence": 0.5,
    "mean_iou": None,
    "distance": 0.0002,
    "size": [0.5, 0.25, 1.0],
    "params": {"width": 0.512345, "legs": "basic"},
    "warnings": [],
    "seconds": 3.0,
}


@pytest.fixture
def folder(tmp_path):
    for name in "abc":
        mesh(tmp_path / "list" / f"{name}.obj")
    return tmp_path / "list"


@pytest.fixture
def done(monkeypatch):
    """Names of the objects that were run, by jobs that take no time; `done.fates` says what becomes of them."""

    class Done(list):
        pass

    seen = Done()
    seen.fates = {}

    def job(order):
        out = Path(order["out"])
        seen.append(out.name)
        row = seen.fates.get(out.name, {})
        if isinstance(row, Exception):
            raise row
        if row.get("status", "done") == "done":
            (out / ".recon").mkdir(parents=True, exist_ok=True)
            (out / "report.json").write_text(json.dumps({"of": out.name}))
            manifest.write(out, manifest.Manifest({"report.json": manifest.file_hash(out / "report.json")}))
            Path(order["picture"]).parent.mkdir(exist_ok=True)
            Path(order["picture"]).write_bytes(b"picture")
        return {**DONE, **row} if row.get("status", "done") == "done" else row

    monkeypatch.setattr(one, "reconstructed", job)
    return seen


def _rows(folder, out, common=None):
    return run.run(entries(folder, common or {}, out), out, Here())


def test_the_table_is_in_the_lists_order_and_says_all(folder, tmp_path, done):
    done.fates = {
        "b": {"status": "refused", "error": 'b.obj, "bad"; throw it away'},
        "c": {"belongs": False, "warnings": ["so", "so"]},
    }
    rows = _rows(folder, tmp_path / "out")
    assert json.loads((tmp_path / "out" / "table.json").read_text()) == rows
    with (tmp_path / "out" / "table.csv").open(newline="", encoding="utf-8-sig") as file:
        a, b, c = csv.DictReader(file)
    assert (a["name"], a["params"], a["height"], a["mean_iou"]) == ("a", "width=0.5123 legs=basic", "1.0", "")
    assert (b["status"], b["error"], b["confidence"]) == ("refused", 'b.obj, "bad"; throw it away', "")
    assert (c["belongs"], c["warnings"]) == ("False", "so | so")
    page = (tmp_path / "out" / "index.html").read_text()
    assert page.index("a/report.html") < page.index("throw it away") < page.index("c/report.html")
    assert 'src="thumbs/a.jpg"' in page
    assert "&quot;bad&quot;" in page
    assert "http" not in page
    assert summary(rows, Path("out")).splitlines()[0] == "2 of 3 reconstructed; 1 refused"


def test_what_is_done_is_not_done_again(folder, tmp_path, done):
    out = tmp_path / "out"
    done.fates = {"b": {"status": "refused", "error": "no"}}
    rows = _rows(folder, out)
    assert _rows(folder, out) == rows
    assert done == ["a", "b", "c"]


@pytest.mark.parametrize("harm", ["input", "results", "picture", "record"])
def test_what_changed_or_is_gone_is_done_again(folder, tmp_path, done, harm):
    out = tmp_path / "out"
    _rows(folder, out)
    if harm == "input":
        (folder / "b.obj").write_text((folder / "b.obj").read_text() + "# longer\n")
    elif harm == "results":
        (out / "b" / "report.json").write_text("{}")
    elif harm == "picture":
        (out / "thumbs" / "b.jpg").unlink()
    else:
        record = out / records.WORK / "b.json"
        record.write_bytes(record.read_bytes()[:40])
    _rows(folder, out)
    assert done == ["a", "b", "c", "b"]


def test_another_option_or_class_is_another_result(folder, tmp_path, done):
    out = tmp_path / "out"
    for common in ({}, {"seed": "3"}, {"seed": "3", "class": "table"}, {"seed": "3", "class": "table"}):
        _rows(folder, out, common)
    assert len(done) == 9


def test_accidents_are_told_and_tried_again_by_the_next_batch(folder, tmp_path, done):
    class Unlucky(Here):
        def map(self, function, jobs):
            for outcome in super().map(lambda job: job, jobs):
                error = "its process was ended by SIGKILL" if outcome.number == 1 else None
                value = None if error else one.reconstructed(outcome.value)
                yield type(outcome)(outcome.number, value, error, "Traceback ...", tries=3)

    out = tmp_path / "out"
    rows = run.run(entries(folder, {}, out), out, Unlucky())
    assert rows[1]["error"] == "failed 3 times: its process was ended by SIGKILL"
    assert json.loads((out / records.WORK / "b.json").read_text())["details"] == "Traceback ..."
    assert [r["status"] for r in _rows(folder, out)] == ["done"] * 3
    assert done == ["a", "c", "b"]


def test_a_batch_that_ends_in_the_middle_has_a_table_and_goes_on(folder, tmp_path, done):
    out = tmp_path / "out"
    done.fates = {"b": KeyboardInterrupt()}
    with pytest.raises(KeyboardInterrupt):
        _interrupted(folder, out, done)
    assert [r["name"] for r in json.loads((out / "table.json").read_text())] == ["a"]
    assert "2 still to come" in (out / "index.html").read_text()
    done.fates = {}
    assert [r["status"] for r in _rows(folder, out)] == ["done"] * 3
    assert done == ["a", "b", "b", "c"]


def _interrupted(folder, out, done):
    class Ended(Here):
        def map(self, function, jobs):
            for outcome in super().map(lambda job: job, jobs):
                if outcome.number == 1:
                    done.append("b")
                    raise KeyboardInterrupt
                yield type(outcome)(outcome.number, one.reconstructed(outcome.value))

    run.run(entries(folder, {}, out), out, Ended())


def test_a_folder_of_something_else_is_not_touched(folder, tmp_path, done):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="not the folder of an earlier batch"):
        _rows(folder, tmp_path / "mine")
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["letter.txt"]
    with pytest.raises(InputError, match="is a file"):
        _rows(folder, tmp_path / "mine" / "letter.txt")


def test_one_batch_at_a_time(folder, tmp_path, done):
    out = tmp_path / "out"
    _rows(folder, out)
    with run_lock.held(out / records.WORK, out), pytest.raises(InputError, match="in use by another run"):
        _rows(folder, out)


def test_options_of_all_are_those_that_were_said():
    args = parser().parse_args(
        ["list", "--out", "o", "--class", "chair", "--turntable", "--height", "0.9", "--workers", "2"]
    )
    assert given(args) == {"class": "chair", "turntable": True, "height": "0.9"}
    assert given(parser().parse_args(["list", "--out", "o"])) == {}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere", "--out", "o"], "LIST nowhere does not exist"),
        (["LIST"], "--out"),
        (["LIST", "--out", "o", "--workers", "0"], "--workers is at least 1"),
        (["LIST", "--out", "o", "--memory", "0.1"], "--memory is in GB"),
        (["LIST", "--out", "o", "--heights", "1"], "unrecognized arguments: --heights"),
        (["LIST", "--out", "o", "--height", "tall"], "a number is wanted"),
    ],
)
def test_what_is_wrong_with_the_command_is_said_at_once(folder, tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    assert main([str(folder) if w == "LIST" else w for w in words]) == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "o").exists()
