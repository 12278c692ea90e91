"""Generated bad inputs through the real commands: exit code 0, 2 or 3, one line, no file changed, bounded memory.

`python -m tests.bad_inputs` runs any number of them and says what each came to.
"""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def run(*words):
    """Forks after it has loaded everything, so it has a process of its own, without the threads of other tests."""
    command = [sys.executable, "-m", "tests.bad_inputs", *map(str, words)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_forty_bad_inputs():
    assert run("--count", 40, "--seed", 11).startswith("40 bad inputs in ")


@pytest.mark.slow
def test_three_hundred_bad_inputs():
    assert run("--count", 300, "--seed", 0).startswith("300 bad inputs in ")


@pytest.mark.slow
def test_what_is_accepted_ends_well():
    """With the searches for the shape, which go on with whatever was read."""
    assert run("--count", 40, "--seed", 12, "--whole").startswith("40 bad inputs in ")
