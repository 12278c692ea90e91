"""Readers that may crash, in a process of their own: `python -m MODULE FILE ... OUT.npz`, which writes arrays.

A file that ends such a process ends no more than that: the user is told in one line.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from recon.scene import InputError

SECONDS = 300  # after which a reader is given up


def arrays_of(path: Path, module: str, *arguments: str, advice: str) -> dict[str, np.ndarray]:
    """What `module` makes of a file, by name. Raises InputError, with the last line that it said and the advice."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "arrays.npz"
        try:
            done = subprocess.run(
                [sys.executable, "-m", module, *arguments, str(out)],
                cwd=Path(__file__).resolve().parents[2],  # where this package is found, installed or not
                env={**os.environ, "OMP_NUM_THREADS": "1"},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                stdin=subprocess.DEVNULL,
                timeout=SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise InputError(f"{path} kept its reader busy for {SECONDS} s; {advice}") from error
        if done.returncode or not out.exists():
            said = done.stderr.decode("utf-8", "replace").strip().splitlines() if done.returncode > 0 else []
            last = (said or ["its reader crashed"])[-1].removesuffix(", see console for detail")
            raise InputError(f"{path} is damaged, or of a kind that is not read here ({last[:200]}); {advice}")
        with np.load(out, allow_pickle=False) as found:
            return dict(found)
