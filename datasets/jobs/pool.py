"""Jobs on this machine: in this process, or by a pool of others."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from datasets.jobs.crew import Member
from datasets.jobs.limits import Limits
from datasets.jobs.outcome import Job, Outcome, name_of


@dataclass(frozen=True)
class Here:
    """In this process, one job after the other; what a function raises passes through."""

    def map(self, function: Callable[[Any], Any], jobs: Iterable[Job]) -> Iterator[Outcome]:
        """See datasets.jobs.outcome.Backend."""
        for number, job in enumerate(jobs):
            yield Outcome(number, function(job))


@dataclass(frozen=True)
class Pool:
    """By so many processes of this machine, each of which does one job at a time."""

    workers: int = 2
    limits: Limits = field(default_factory=Limits)

    def map(self, function: Callable[[Any], Any], jobs: Iterable[Job]) -> Iterator[Outcome]:
        """See datasets.jobs.outcome.Backend. The processes end with the iterator."""
        shared = _Shared(jobs)
        crew = [Member(name_of(function), self.limits) for _ in range(self.workers)]
        threads = [threading.Thread(target=shared.work_off, args=(member,), daemon=True) for member in crew]
        try:
            for thread in threads:
                thread.start()
            yield from shared.outcomes(len(threads))
        finally:
            shared.close()
            for member in crew:
                member.stop()
            for thread in threads:
                thread.join()


class _Shared:
    """Jobs that many threads take from and outcomes that they put down."""

    def __init__(self, jobs: Iterable[Job]) -> None:
        self._jobs, self._lock = enumerate(jobs), threading.Lock()
        self._done: queue.SimpleQueue[Outcome | BaseException | None] = queue.SimpleQueue()
        self._closed = False

    def work_off(self, member: Member) -> None:
        """What a thread does: jobs by one worker, until there are no more."""
        try:
            while (taken := self._next()) is not None:
                number, job = taken
                self._done.put(Outcome(number, **member.do(job)))
            self._done.put(None)
        except BaseException as error:  # the jobs themselves failed to come, or are nothing that JSON knows
            self._done.put(error)

    def outcomes(self, threads: int) -> Iterator[Outcome]:
        """As they are put down, until all threads have ended."""
        while threads:
            done = self._done.get()
            if isinstance(done, BaseException):
                raise done
            if done is None:
                threads -= 1
            else:
                yield done

    def close(self) -> None:
        """Nobody gets another job."""
        self._closed = True

    def _next(self) -> tuple[int, Job] | None:
        with self._lock:
            return None if self._closed else next(self._jobs, None)
