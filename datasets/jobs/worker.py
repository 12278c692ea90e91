"""A process that does one job after the other: python -m datasets.jobs.worker FUNCTION MEMORY KEPT.

Orders come by its standard input and answers go out by its standard output, a line of JSON each. What the work prints
goes to standard error. It ends with the process that started it, when its input ends, and when it takes more memory
than it may.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from datasets.jobs.limits import TOO_LARGE

LOOK = 0.25  # seconds between looks at it


def main(words: list[str]) -> int:
    """Do what comes in until nothing comes any more."""
    name, memory, kept = words[0], int(words[1]), float(words[2])
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    threading.Thread(target=_watch, args=(memory,), daemon=True).start()
    function: Callable[[Any], Any] | None = None
    for line in sys.stdin:
        try:
            function = function or _found(name)
            answer = {"value": function(json.loads(line))}
        except Exception as error:
            text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
            answer = {"error": text, "details": traceback.format_exc()}
        full = resident() > kept * memory
        _say(answers, {**answer, "last": full})
        if full:
            break
    return 0


def _found(name: str) -> Callable[[Any], Any]:
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(module), function)


def _say(answers: IO[str], answer: dict[str, Any]) -> None:
    answers.write(json.dumps(answer) + "\n")
    answers.flush()


def resident() -> int:
    """Bytes of memory that this process holds; 0 where the system does not say."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return 0


def _watch(memory: int) -> None:
    while resident() <= memory:
        time.sleep(LOOK)
    os._exit(TOO_LARGE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
