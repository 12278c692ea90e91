"""Jobs by processes: the same outcomes whoever does them, and no accident of one is another's."""

import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from datasets.jobs import Here, JobError, Limits, Outcome, Pool
from tests.jobs import work

ROOT = Path(__file__).parents[2]
MB = 1 << 20


def _by_number(outcomes):
    return sorted(outcomes, key=lambda outcome: outcome.number)


def test_workers_say_nothing_of_their_own(capfd):
    assert [o.value for o in Pool(1).map(abs, [-3])] == [3]
    assert capfd.readouterr() == ("", "")


def _runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def _all_gone(pids, seconds=20.0):
    until = time.monotonic() + seconds
    while any(map(_runs, pids)) and time.monotonic() < until:
        time.sleep(0.05)
    return not any(map(_runs, pids))


def _begun(folder, count=1, seconds=60.0):
    """Process numbers of workers that began a job, once there are so many."""
    until = time.monotonic() + seconds
    while len(found := list(folder.iterdir())) < count and time.monotonic() < until:
        time.sleep(0.02)
    assert len(found) >= count
    return [int(p.name.split("-")[1]) for p in found]


@pytest.mark.parametrize("workers", [1, 3])
def test_the_outcomes_are_those_of_doing_it_here(workers):
    jobs = [{"number": n} for n in range(7)]
    here = list(Here().map(work.square, jobs))
    assert here == [Outcome(n, {"squared": n * n, "text": "\udcff ä"}) for n in range(7)]
    assert _by_number(Pool(workers).map(work.square, jobs)) == here
    assert list(Pool(workers).map(work.square, [])) == []


def test_a_worker_does_one_job_after_the_other_and_others_work_beside_it():
    pids = [o.value for o in Pool(2).map(work.process, range(12))]
    assert 1 <= len(set(pids)) <= 2
    assert os.getpid() not in pids
    assert _all_gone(pids)


def test_accidents_are_forgiven_and_are_nobody_elses(tmp_path):
    fates = {1: "once", 3: "always", 4: "raises"}
    jobs = [{"number": n, "marks": str(tmp_path), "fate": fates.get(n)} for n in range(6)]
    found = _by_number(Pool(2, Limits(tries=3)).map(work.unlucky, jobs))
    assert [o.value for o in found] == [0, 1, 2, None, None, 5]
    assert [o.tries for o in found] == [1, 2, 1, 3, 3, 1]
    assert [len(list(tmp_path.glob(f"{n}-*"))) for n in range(6)] == [o.tries for o in found]
    assert found[3].error == "its process was ended by SIGKILL"
    assert found[4].error == "ValueError: no such thing"
    assert "in unlucky" in found[4].details
    assert all(o.error is None for o in found if o.number not in (3, 4))


def test_a_worker_that_is_killed_from_outside_loses_nothing(tmp_path):
    jobs = [{"number": n, "marks": str(tmp_path), "seconds": 1.0} for n in range(3)]
    outcomes = Pool(1).map(work.slow, iter(jobs))
    first = next(outcomes)
    (pid,) = {int(p.name.split("-")[1]) for p in tmp_path.iterdir()}
    os.kill(pid, signal.SIGKILL)
    assert [o.value for o in (first, *outcomes)] == [0, 1, 2]


def test_memory_is_bounded():
    small, large = {"bytes": 4 * MB}, {"bytes": 400 * MB, "seconds": 30}
    found = _by_number(Pool(1, Limits(memory=200 * MB, tries=2)).map(work.greedy, [small, large, small]))
    assert [o.value for o in found] == [4 * MB, None, 4 * MB]
    assert found[1].error == "it took more than 200 MB of memory"
    assert found[1].tries == 2


def test_a_worker_that_has_grown_makes_way_for_a_fresh_one():
    pids = [o.value for o in Pool(1, Limits(kept=0.0)).map(work.process, range(3))]
    assert len(set(pids)) == 3


def test_a_job_that_never_ends_is_ended(tmp_path):
    job = {"number": 0, "marks": str(tmp_path), "seconds": 600}
    (found,) = Pool(1, Limits(seconds=0.5, tries=1)).map(work.slow, [job])
    assert (found.value, found.error) == (None, "it took longer than 0.5 s")


def test_jobs_are_taken_as_they_are_needed_and_workers_go_with_the_iterator(tmp_path):
    taken = []

    def endless():
        for n in itertools.count():
            taken.append(n)
            yield {"number": n, "marks": str(tmp_path), "seconds": 0.01}

    outcomes = Pool(2).map(work.slow, endless())
    assert {next(outcomes).error for _ in range(5)} == {None}
    outcomes.close()
    assert _all_gone({int(p.name.split("-")[1]) for p in tmp_path.iterdir()})
    assert len(taken) < 1000


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_driver_that_is_killed_leaves_no_orphan(tmp_path, number):
    driver = subprocess.Popen(
        [sys.executable, "-m", "tests.jobs.driver", str(tmp_path)], env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    pids = _begun(tmp_path, 2)
    assert all(map(_runs, pids))
    driver.send_signal(number)
    driver.wait(20)
    assert _all_gone(pids)


def test_what_cannot_be_sent_to_a_worker_is_said():
    with pytest.raises(JobError, match="use a function of a module"):
        list(Pool(1).map(lambda job: job, [1]))
    with pytest.raises(TypeError, match="JSON"):
        list(Pool(1).map(work.square, [{"number": {1, 2}}]))
