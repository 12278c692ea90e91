"""Jobs for tests: {"number", "marks", ...}, where `marks` is a folder in which traces are left."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def square(job):
    print("what work prints is no answer")  # noqa: T201
    os.write(1, b"nor is this\n")
    return {"squared": job["number"] ** 2, "text": "\udcff ä"}


def process(job):
    return os.getpid()


def unlucky(job):
    """Ends its process the first time for `once`, always for `always`; raises for `raises`."""
    _mark(job, os.getpid())
    begun = len(list(Path(job["marks"]).glob(f"{job['number']}-*")))
    if job.get("fate") == "always" or (job.get("fate") == "once" and begun == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    if job.get("fate") == "raises":
        raise ValueError("no such thing")
    return job["number"]


def greedy(job):
    held = bytearray(job["bytes"])
    held[::4096] = b"x" * len(held[::4096])
    time.sleep(job.get("seconds", 0))
    return len(held)


def slow(job):
    _mark(job, os.getpid())
    time.sleep(job["seconds"])
    return job["number"]


def _mark(job, pid):
    (Path(job["marks"]) / f"{job['number']}-{pid}-{time.monotonic_ns()}").touch()
