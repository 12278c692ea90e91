"""Batches of mixed inputs whose workers and driver are killed in the middle: what comes out is as if nobody had.

Forty inputs take a quarter of an hour on two idle cores, seven about two minutes.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from recon.batch import records
from tests.batch.mixed import BAD, listed
from tests.jobs.test_map import _all_gone

ROOT = Path(__file__).parents[2]
MARK = "BATCH_TEST"
SIZES = [
    pytest.param((7, 1), marks=pytest.mark.slow, id="seven"),
    pytest.param((40, 3), marks=pytest.mark.long, id="forty"),
]


class Batches:
    """Batches of one list as processes, with two workers each."""

    def __init__(self, folder, count, bad, *backend):
        self.folder, self.backend, self.count = folder, backend or ("--workers", "2"), count
        self.list = listed(folder / "list", count, bad) if not (folder / "list").exists() else folder / "list/list.csv"

    def start(self, out):
        words = [str(self.list), "--out", str(out), "--class", "paper/chair", *self.backend]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(self.folder / "cache")}
        environment[MARK] = mark()
        command = [sys.executable, "-m", "recon.batch", *words]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)

    def finished(self, out):
        """What a batch that ends by itself left behind, and what it said."""
        process = self.start(out)
        told, said = process.communicate()
        assert process.returncode == 3, said  # some are bad
        assert "Traceback" not in said, said
        return found(out), told, said


def mark():
    return str(os.getpid())


def workers():
    """Numbers of the worker processes that were started by this test."""
    return [pid for pid, words in _marked() if b"datasets.jobs.worker" in words]


def _marked():
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark()}\0".encode() in (entry / "environ").read_bytes():
                yield int(entry.name), (entry / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue


def found(out):
    """All that a batch found out: the rows without their times, and the meshes."""
    rows = json.loads((out / "table.json").read_text())
    for row in rows:
        row.pop("seconds", None)
    meshes = {r["name"]: (out / r["name"] / "mesh.obj").read_bytes() for r in rows if r["status"] == "done"}
    params = {name: json.loads((out / name / "params.json").read_text()) for name in meshes}
    return rows, meshes, params


def _until_done(process, out, least):
    """Wait until so many objects are done; how many are."""
    folder = out / records.WORK
    while (done := len(list(folder.glob("*.json")))) < least:
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    return done


def disturbed(batches, out, first, second):
    """A batch of which a worker is killed when `first` objects are done, and the driver when `second` are."""
    process = batches.start(out)
    _until_done(process, out, first)
    os.kill(workers()[0], signal.SIGKILL)
    _until_done(process, out, second)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    assert _all_gone(workers(), 120), "orphans"
    kept = len(list((out / records.WORK).glob("*.json")))
    answer, told, said = batches.finished(out)
    assert f"{kept} of {batches.count} are done" in said
    return answer, told


@pytest.fixture(scope="module", params=SIZES)
def undisturbed(request, tmp_path_factory):
    count, bad = request.param
    folder = tmp_path_factory.mktemp("batch")
    answer, told, _ = Batches(folder, count, bad).finished(folder / "undisturbed")
    return folder, count, bad, answer, told


@pytest.mark.timeout(7200)
def test_good_ones_are_done_and_bad_ones_explained(undisturbed):
    folder, count, bad, (rows, meshes, params), told = undisturbed
    assert told.startswith(f"{count - bad} of {count} reconstructed; {bad} refused\n")
    assert len(meshes) == len(params) == count - bad
    wrong = [r for r in rows if r["status"] != "done"]
    assert [r["name"].rpartition("-")[0] for r in wrong] == [BAD[i % len(BAD)] for i in range(bad)]
    for row in wrong:
        assert str(folder / "list") in row["error"], "the file is named"
        assert "Traceback" not in row["error"]
    assert all(r["confidence"] > 0.2 for r in rows if r["status"] == "done" and r["mean_iou"] is None)
    page = (folder / "undisturbed" / "index.html").read_text()
    assert page.count("<img ") == count - bad
    assert all((folder / "undisturbed" / "thumbs" / f"{name}.jpg").stat().st_size > 1000 for name in meshes)


@pytest.mark.timeout(7200)
def test_a_worker_and_the_driver_are_killed(undisturbed, tmp_path):
    folder, count, bad, truth, told = undisturbed
    answer, again = disturbed(Batches(folder, count, bad), tmp_path / "out", count // 6, count // 2)
    assert answer == truth
    assert again.replace(str(tmp_path / "out"), "") == told.replace(str(folder / "undisturbed"), "")


@pytest.mark.timeout(7200)
def test_one_worker_finds_the_same(undisturbed, tmp_path):
    folder, count, bad, truth, _ = undisturbed
    answer, _, _ = Batches(folder, count, bad, "--workers", "1").finished(tmp_path / "out")
    assert answer == truth


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_two_nodes_of_ray_find_the_same(undisturbed, tmp_path, monkeypatch):
    """The nodes start here and are ended here; a worker and the driver are killed in between."""
    pytest.importorskip("ray", reason="the extra `ray` is not installed")
    from ray.cluster_utils import Cluster

    folder, count, bad, truth, _ = undisturbed
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.setenv(MARK, mark())
    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        nodes.add_node(num_cpus=1)
        nodes.wait_for_nodes()
        batches = Batches(folder, count, bad, "--ray", nodes.address)
        answer, _ = disturbed(batches, tmp_path / "out", count // 6, count // 2)
    finally:
        nodes.shutdown()
    assert answer == truth
    assert _all_gone([pid for pid, _ in _marked() if pid != os.getpid()], 60)
