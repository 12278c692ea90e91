"""Processes: children end with their parent, signals end the command cleanly, nothing is left, listeners may go."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from recon.system import scratch

ROOT = Path(__file__).parents[2]
SLEEP = "import time; time.sleep(60)"
COMMAND = "import sys; from recon.system import process; sys.exit(process.run(main))"


def python(code, tmp, **options):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp)}
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    return subprocess.Popen([sys.executable, "-c", code], text=True, env=environment, **options)


def gone(pid):
    """Whether a process ends within some seconds."""
    deadline = time.monotonic() + 20
    while scratch.started(pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not scratch.started(pid)


# ---- children ----


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_child_ends_with_its_parent(tmp_path, number):
    run = f"p = child.start('timeit', '-n1', '-r1', {SLEEP!r}); print(p.pid, flush=True); p.wait()"
    parent = python(f"from datasets.jobs import child; {run}", tmp_path)
    pid = int(parent.stdout.readline())
    time.sleep(0.5)
    assert scratch.started(pid)
    parent.send_signal(number)
    assert gone(pid)


def test_a_child_ends_with_its_parent_where_the_system_does_not_help(tmp_path):
    tie = "import os, sys; sys.platform = 'other'; from datasets.jobs import child; child.tie_to(os.getppid())"
    tied = f"{tie}; os.write(1, b'tied\\n'); {SLEEP}"
    start = f"subprocess.Popen([sys.executable, '-c', {tied!r}])"
    parent = python(f"import subprocess, sys; p = {start}; print(p.pid, flush=True); p.wait()", tmp_path)
    pid = int(parent.stdout.readline())
    assert parent.stdout.readline() == "tied\n"
    assert scratch.started(pid)
    parent.kill()
    assert gone(pid)


def test_a_child_whose_parent_was_gone_first_does_nothing(tmp_path):
    child = python("from datasets.jobs import child; child.tie_to(2 ** 22 + 1); print('worked')", tmp_path)
    assert child.communicate()[0] == ""
    assert child.returncode != 0


def test_a_child_is_the_module_with_its_arguments(tmp_path):
    run = "child.start('json.tool', '--indent', '3', stdin=subprocess.PIPE)"
    parent = python(f"import subprocess; from datasets.jobs import child; {run}.communicate('[1]')", tmp_path)
    assert parent.communicate()[0] == "[\n   1\n]\n"


# ---- folders of a process ----


def left_behind(tmp_path):
    """A folder of a process that was killed."""
    code = f"from recon.system import scratch; from pathlib import Path; s = scratch.folder(Path({str(tmp_path)!r}))"
    process = python(f"{code}; print(s.__enter__(), flush=True); {SLEEP}", tmp_path)
    path = Path(process.stdout.readline().strip())
    assert path.is_dir()
    scratch.sweep(tmp_path)
    assert path.is_dir(), "its process runs"
    process.kill()
    process.wait()
    return path


def test_what_killed_processes_left_is_swept_and_nothing_else(tmp_path):
    path = left_behind(tmp_path)
    elsewhere = path.with_name(path.name.replace(path.name.split("-")[1], "0" * 8))
    for other in (elsewhere, tmp_path / "scratch-notes", tmp_path / "photos"):
        other.mkdir()
    (path / "features.db").write_text("half")
    with scratch.folder(tmp_path) as own:
        assert own.is_dir()
        assert not path.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([elsewhere.name, "scratch-notes", "photos"])


def test_a_number_given_again_is_another_process(tmp_path):
    path = left_behind(tmp_path)
    _, machine, pid, when, rest = path.name.split("-")
    again = path.rename(path.with_name(f"scratch-{machine}-{os.getpid()}-{when}-{rest}"))
    scratch.sweep(tmp_path)
    assert not again.exists()
    assert pid != str(os.getpid())


def test_a_fresh_folder_takes_the_place_of_anything_and_follows_no_link(tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "photo.jpg").write_text("x")
    place = tmp_path / "place"
    for make in (
        lambda: place.write_text("file"),
        lambda: place.symlink_to(kept),
        lambda: (place / "inside").mkdir(parents=True),
        lambda: place.symlink_to(tmp_path / "nowhere"),
    ):
        make()
        assert list(scratch.fresh(place).iterdir()) == []
        assert not place.is_symlink()
        place.rmdir()
    assert (kept / "photo.jpg").read_text() == "x"


# ---- the command as a process ----


@pytest.mark.parametrize(
    ("number", "code", "said"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated"), (signal.SIGHUP, 129, "terminated")],
)
def test_signals_end_it_with_one_line_and_nothing_is_left(tmp_path, number, code, said):
    code_of_main = f"import tempfile; tempfile.mkdtemp(); print('begun', flush=True); {SLEEP}"
    process = python(f"def main():\n    {code_of_main}\n{COMMAND}", tmp_path)
    assert process.stdout.readline() == "begun\n"
    process.send_signal(number)
    message = process.communicate()[1]
    assert process.returncode == code
    assert message == f"{said}; run the same command again to go on from the last finished stage\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("again", [False, True])
def test_a_signal_that_foreign_code_swallows_ends_it_all_the_same(tmp_path, again):
    swallow = "import time, tempfile\ntempfile.mkdtemp()\nprint('begun', flush=True)\nwhile True:\n"
    swallow += "    try:\n        time.sleep(60)\n    except BaseException:\n        print('swallowed', flush=True)\n"
    code = "def main():\n" + "".join(f"    {line}\n" for line in swallow.splitlines()) + COMMAND
    process = python(code, tmp_path)
    assert process.stdout.readline() == "begun\n"
    time.sleep(0.5)
    process.terminate()
    assert process.stdout.readline() == "swallowed\n"
    if again:
        process.terminate()
    message = process.communicate()[1]
    assert process.returncode == 143
    assert message == "terminated; run the same command again to go on from the last finished stage\n"
    assert not list(tmp_path.iterdir())


def test_a_library_that_takes_signals_for_itself(tmp_path):
    """As pycolmap does when it is imported: a run ended with a stack trace."""
    load = "from recon.geometry import lenses; print(len(lenses.models()), flush=True)"
    code = f"def main():\n    {load}; {SLEEP}\n{COMMAND}"
    process = python(code, tmp_path)
    assert int(process.stdout.readline()) > 10
    process.terminate()
    assert process.communicate()[1] == "terminated; run the same command again to go on from the last finished stage\n"
    assert process.returncode == 143


def test_interrupts_in_callbacks_are_not_shown(tmp_path):
    """As in Blender's handlers: the error is printed where it arose, and all goes on."""
    callback = "class C:\n    def __del__(self):\n        os.kill(os.getpid(), signal.SIGTERM)\n        time.sleep(9)\n"
    code = f"import os, signal, time\n{callback}def main():\n    C()\n    time.sleep(60)\n{COMMAND}"
    process = python(code, tmp_path)
    assert process.communicate()[1].splitlines() == [
        "terminated; run the same command again to go on from the last finished stage"
    ]
    assert process.returncode == 143


def test_temporary_files_of_a_killed_one_go_with_the_next(tmp_path):
    process = python(
        f"def main():\n    import tempfile; print(tempfile.mkdtemp(), flush=True); {SLEEP}\n{COMMAND}", tmp_path
    )
    left = Path(process.stdout.readline().strip())
    process.kill()
    process.wait()
    assert left.is_dir()
    assert python(f"def main():\n    return 0\n{COMMAND}", tmp_path).wait() == 0
    assert not list(tmp_path.iterdir())


TALKS = f"""
def main():
    import logging, sys
    logging.basicConfig(stream=sys.stderr, level=logging.INFO)
    for i in range(2000):
        logging.info('line %d', i)
        print('result', i)
    open({{done!r}}, 'w').write('done')
    return 0
{COMMAND}"""


@pytest.mark.parametrize("how", ["gone", "closed", "full"])
def test_it_works_on_when_nobody_listens(tmp_path, how):
    done = tmp_path / "done"
    code = TALKS.format(done=str(done))
    if how == "closed":
        command = f'exec "{sys.executable}" -c "$CODE" <&- >&- 2>&-'
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "CODE": code}
        assert subprocess.run(["sh", "-c", command], env=environment, check=False).returncode == 0
    elif how == "full":
        with open("/dev/full", "w") as full:
            assert python(code, tmp_path, stdout=full, stderr=full).wait() == 0
    else:
        process = python(code, tmp_path)
        process.stdout.close()
        process.stderr.close()
        assert process.wait() == 0
    assert done.read_text() == "done"
