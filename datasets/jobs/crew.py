"""A worker as those see it who give it jobs: it is started when it is needed, and a dead one is replaced."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import threading
from typing import Any

from datasets.jobs import child
from datasets.jobs.limits import TOO_LARGE, Limits
from datasets.jobs.outcome import Job

# Sums that are split over threads depend on how many are free: with one, every worker gives the same result. It is
# also the fastest for many jobs.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
QUIET = {"OMP_WAIT_POLICY": "PASSIVE"}


class Member:
    """One worker process for a function, by its name (name_of in outcome.py). One thread uses it, any may `stop` it."""

    def __init__(self, function: str, limits: Limits) -> None:
        self.function, self.limits = function, limits
        self._process: subprocess.Popen[str] | None = None
        self._lock, self._stopped = threading.Lock(), False

    def do(self, job: Job) -> dict[str, Any]:
        """{"value", "tries"}, or {"error", "details", "tries"} after so many accidents as are forgiven."""
        text, answer = json.dumps(job), {}
        for tries in range(1, self.limits.tries + 1):
            answer = {**self._tried(text), "tries": tries}
            if "value" in answer or self._stopped:
                break
        return answer

    def stop(self) -> None:
        """End the process, now and for ever."""
        with self._lock:
            self._stopped = True
            self._end()

    def _tried(self, job: str) -> dict[str, Any]:
        """The worker's answer to a job, or what became of the worker."""
        process = self._started()
        if process is None or process.stdin is None or process.stdout is None:
            return {"error": "stopped"}
        late = threading.Event()
        timer = None
        if self.limits.seconds is not None:
            timer = threading.Timer(self.limits.seconds, _end_late, (process, late))
            timer.start()
        try:
            process.stdin.write(job + "\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except OSError:  # it died before it listened
            line = ""
        finally:
            if timer is not None:
                timer.cancel()
        try:
            answer = json.loads(line)
        except ValueError:  # cut short
            return {"error": self._death(process, late.is_set())}
        if answer.pop("last"):
            with self._lock:
                self._end()
        return answer

    def _started(self) -> subprocess.Popen[str] | None:
        with self._lock:
            if self._stopped:
                return None
            if self._process is None:
                words = self.function, str(self.limits.memory), str(self.limits.kept)
                self._process = child.start(
                    "datasets.jobs.worker",
                    *words,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    encoding="utf-8",
                    start_new_session=True,  # Ctrl-C is the driver's
                    env={**QUIET, **os.environ, **ONE_THREAD},
                )
            return self._process

    def _death(self, process: subprocess.Popen[str], late: bool) -> str:
        """What ended a worker; it is gone then."""
        with self._lock:
            self._end()
        code = process.returncode
        if late:
            return f"it took longer than {self.limits.seconds:g} s"
        if code == TOO_LARGE:
            return f"it took more than {self.limits.memory >> 20} MB of memory"
        if code < 0:
            with contextlib.suppress(ValueError):
                return f"its process was ended by {signal.Signals(-code).name}"
        return f"its process ended with code {code}"

    def _end(self) -> None:
        if self._process is None:
            return
        self._process.kill()
        for pipe in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):
                if pipe is not None:
                    pipe.close()
        self._process.wait()
        self._process = None


def _end_late(process: subprocess.Popen[str], late: threading.Event) -> None:
    """End a process that takes too long, and say so."""
    late.set()
    process.kill()
