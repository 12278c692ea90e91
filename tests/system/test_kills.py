"""Runs that are killed at any moment and started again at once: the same result, no orphan, nothing left behind.

60 kills take about 15 minutes on two idle cores, six about two. A run here is the whole pipeline on ten small photos
(tests/small_run.py), so that it takes seconds.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "datasets" / "samples" / "chair"
# What a run says, in this order; it is killed up to a second and a half after one of these.
MOMENTS = ("", "[1/8]", "[2/8]", "looking for", "comparing", "placing the", *(f"[{i}/8]" for i in range(3, 9)))
ENDS = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}
OWN = {"frames", "poses", "undistorted", "masks"}  # folders that the stages leave in .recon


class Runs:
    """Runs on one set of photos, with folders of their own for temporary files and caches."""

    def __init__(self, folder):
        self.folder, self.count = folder, 0
        for name in ("tmp", "cache", "photos", "masks"):
            (folder / name).mkdir()
        for photo in sorted((SHIPPED / "photos").iterdir())[::3]:
            image = Image.open(photo)
            image.resize((500, 375)).save(folder / "photos" / photo.name, quality=95, exif=image.info.get("exif", b""))
            mask = SHIPPED / "truth" / "masks" / f"{photo.stem}.png"
            (folder / "masks" / mask.name).write_bytes(mask.read_bytes())

    def start(self, out):
        """A run as a process, and the mark that all its children carry."""
        self.count += 1
        mark = f"KILLS_RUN={os.getpid()}-{self.count}-"
        name, _, value = mark.partition("=")
        places = {"TMPDIR": str(self.folder / "tmp"), "XDG_CACHE_HOME": str(self.folder / "cache")}
        environment = {**os.environ, **places, "PYTHONPATH": str(ROOT), name: value}
        inputs = [str(self.folder / "photos"), str(out), str(self.folder / "masks")]
        command = [sys.executable, "-m", "tests.small_run", *inputs]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True)
        return process, mark

    def finished(self, out):
        """Run to the end; what it found."""
        process, mark = self.start(out)
        said = process.communicate()[1]
        assert process.returncode == 0, said
        assert "damaged" not in said, said
        assert not alive(mark)
        assert not list((self.folder / "tmp").iterdir())
        assert {p.name for p in out.iterdir() if p.name.startswith(".")} == {".recon"}
        kept = [p.name for p in (out / ".recon").iterdir() if p.suffix not in (".json", ".npz")]
        assert set(kept) <= OWN, kept
        report = json.loads((out / "report.json").read_text())
        del report["seconds"]
        return json.loads((out / "params.json").read_text()), report, (out / "mesh.obj").read_bytes()

    def killed(self, out, moment, delay, number):
        """Start a run and end it by signal `number`, `delay` seconds after it said `moment`; False if it was through
        before that."""
        process, mark = self.start(out)
        said = ""
        while moment and moment not in said and (line := process.stderr.readline()):
            said += line
        try:
            process.wait(delay)
        except subprocess.TimeoutExpired:
            send = os.killpg if number == signal.SIGINT else os.kill  # as a terminal does, and as others do
            send(process.pid, number)
        said += process.stderr.read()
        code = process.wait()
        assert "Traceback" not in said, said
        assert code in (0, ENDS[number], -number), said  # -number: it was through, and Python tidied up
        assert code in (0, ENDS[number]) or (out / "report.json").exists(), said
        if code > 0:
            assert "; run the same command again to go on" in said.splitlines()[-1]
        return code != 0, mark


def alive(mark):
    """Processes that carry a mark in their environment."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (entry / "environ").read_bytes():
                found.append((entry / "cmdline").read_bytes())
        except OSError:
            continue
    return found


def campaign(runs, out, kills, rng):
    """Kill runs into one folder `kills` times, each started at once after the one before; how many were killed."""
    done, marks = 0, []
    for moment in sorted(rng.choices(range(len(MOMENTS)), k=kills)):
        number = rng.choices(list(ENDS), (8, 1, 1))[0]
        # At the first moment nothing is installed yet that could answer a signal.
        was_killed, mark = runs.killed(out, MOMENTS[moment], rng.uniform(0, 1.5), number if moment else signal.SIGKILL)
        done += was_killed
        marks.append(mark)
    deadline = time.monotonic() + 5
    while any(map(alive, marks)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(alive, marks)), "orphans"
    return done


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The runs, and what one finds that nobody disturbs."""
    runs = Runs(tmp_path_factory.mktemp("kills"))
    return runs, runs.finished(runs.folder / "undisturbed")


def survive(undisturbed, out, kills, each):
    (runs, truth), rng, done, campaigns = undisturbed, random.Random(10), 0, 0
    while done < kills:
        done += campaign(runs, out / str(campaigns), min(each, kills - done), rng)
        assert runs.finished(out / str(campaigns)) == truth
        campaigns += 1
        sys.stderr.write(f"{done} kills in {campaigns} folders\n")


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_sixty_kills(undisturbed, tmp_path):
    survive(undisturbed, tmp_path, 60, 4)


def test_six_kills(undisturbed, tmp_path):
    survive(undisturbed, tmp_path, 6, 6)


@pytest.mark.slow
def test_a_store_that_is_damaged_everywhere(undisturbed, tmp_path):
    """A bit, a working copy, an undistorted photo, and a file that was emptied: the same result, and all said."""
    runs, truth = undisturbed
    work = shutil.copytree(runs.folder / "undisturbed", tmp_path / "out") / ".recon"
    for path in (work / "align.json", next((work / "frames").iterdir()), next((work / "undistorted").iterdir())):
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 4
        path.write_bytes(data)
    (work / "refine.npz").write_bytes(b"")
    process, _ = runs.start(tmp_path / "out")
    said = process.communicate()[1]
    anew = [line.split()[4] for line in said.splitlines() if line.startswith("the stored result of ")]
    assert anew == ["frames", "poses", "align", "refine"], said
    assert runs.finished(tmp_path / "out") == truth
