"""Child processes that end with the process that started them, however that one ends.

`start(module, ...)` runs `python -m datasets.jobs PARENT MODULE ARGUMENTS` (__main__.py): the tie is made first, then
MODULE runs as if it had been started itself. (A hook between fork and exec would be simpler, but may hang where threads
run.)
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[2]  # where the packages are found, installed or not
_PR_SET_PDEATHSIG = 1
_LOOK = 0.5  # seconds between looks at the parent


def start(module: str, *arguments: str, **options: Any) -> subprocess.Popen[str]:
    """Run a module of this project as a child; `options` are subprocess.Popen's."""
    command = [sys.executable, "-m", "datasets.jobs", str(os.getpid()), module, *arguments]
    return subprocess.Popen(command, text=True, errors="replace", cwd=_ROOT, **options)


def tie_to(parent: int) -> None:
    """From now on this process is killed when its parent, process number `parent`, ends; or now, when it has ended."""
    if sys.platform == "linux":  # at once, whatever this process is doing
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()  # everywhere
    if os.getppid() != parent:  # it ended before the tie was made
        os._exit(1)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOK)
    os._exit(1)
