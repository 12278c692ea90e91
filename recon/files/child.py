"""Readers that may crash, in a process of their own: `python -m MODULE FILE ... OUT.npz`, which writes arrays.

A file that ends such a process ends no more than that: the user is told in one line.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from datasets.jobs import child
from recon.scene import InputError

SECONDS = 300  # after which a reader is given up


def arrays_of(path: Path, module: str, *arguments: str, advice: str) -> dict[str, np.ndarray]:
    """What `module` makes of a file, by name. Raises InputError, with the last line that it said and the advice."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "arrays.npz"
        process = child.start(
            module,
            *arguments,
            str(out),
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
        )
        try:
            chatter = process.communicate(timeout=SECONDS)[1]
        except subprocess.TimeoutExpired as error:
            raise InputError(f"{path} kept its reader busy for {SECONDS} s; {advice}") from error
        finally:
            process.kill()
            process.wait()
        if process.returncode or not out.exists():
            said = chatter.strip().splitlines() if process.returncode > 0 else []
            last = (said or ["its reader crashed"])[-1].removesuffix(", see console for detail")
            raise InputError(f"{path} is damaged, or of a kind that is not read here ({last[:200]}); {advice}")
        with np.load(out, allow_pickle=False) as found:
            return dict(found)
