"""Jobs by the machines of a Ray cluster (extra `ray`); every node has this project installed and sees the same files.

Ray starts one keeper a worker and hands it jobs; the keeper has a worker process of its own, as a pool has, so that
memory, accidents and results are the same. A keeper that is lost with its node is replaced, its job tried again.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from datasets.jobs.crew import Member
from datasets.jobs.limits import Limits
from datasets.jobs.outcome import Job, JobError, Outcome, name_of

WAIT = 5.0  # seconds, so that a signal is heard
REACHED = 10.0  # seconds in which a cluster answers


class Keeper:
    """What runs on a node: one worker process and those who ask it."""

    def __init__(self, function: str, limits: Limits) -> None:
        self.member = Member(function, limits)

    def is_there(self) -> None:
        """Answers as soon as it runs somewhere."""

    def do(self, job: Job) -> dict[str, Any]:
        """As jobs.crew.Member.do."""
        return self.member.do(job)


@dataclass(frozen=True)
class RayNodes:
    """address  of the cluster: "auto" for one that runs here, HOST:PORT, or "local" for one that is started here
    workers  how many jobs at a time; None for as many as the cluster has processors
    """

    address: str = "auto"
    workers: int | None = None
    limits: Limits = field(default_factory=Limits)

    def map(self, function: Callable[[Any], Any], jobs: Iterable[Job]) -> Iterator[Outcome]:
        """See Backend in outcome.py. What was started here ends with the iterator. Raises JobError without Ray."""
        ray, name = _ray(), name_of(function)
        mine = not ray.is_initialized()
        if mine:
            try:
                _knock(self.address)
                ray.init(address=self.address, log_to_driver=False, logging_level="error")
            except (OSError, ValueError, RuntimeError) as error:
                raise JobError(
                    f"no Ray cluster answers at {self.address} ({error}); start one with ray start --head"
                ) from error
        count = self.workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        crew = _Crew(ray, name, self.limits, count)
        try:
            yield from crew.outcomes(jobs)
        finally:
            crew.end()
            if mine:
                ray.shutdown()


class _Crew:
    """The keepers: those that are coming, for want of a free processor or a node; the idle; and the busy."""

    def __init__(self, ray: Any, function: str, limits: Limits, count: int) -> None:
        self.ray, self.limits = ray, limits
        remote = ray.remote(num_cpus=1, max_restarts=0)(Keeper)
        self._made = lambda: remote.remote(function, limits)
        self.coming: dict[Any, Any] = {}  # by what will say that they are there
        self.idle: list[Any] = []
        self.busy: dict[Any, tuple[int, Job, Any, int]] = {}  # by what will be the answer
        self.waiting: list[tuple[int, Job, int]] = []  # number, job, and how often it is begun then
        self._losses = limits.tries * count  # of keepers before they are there: then something is wrong with all nodes
        for _ in range(count):
            self._call()

    def outcomes(self, jobs: Iterable[Job]) -> Iterator[Outcome]:
        """As they are done."""
        todo = enumerate(jobs)
        while True:
            while self._is_more(todo) and self.idle:
                self._give(*self.waiting.pop(), self.idle.pop())
            if not self.waiting and not self.busy:
                return
            ready, _ = self.ray.wait([*self.busy, *self.coming], num_returns=1, timeout=WAIT)
            for answer in ready:
                if answer in self.coming:
                    self._arrived(answer)
                elif (outcome := self._taken(answer)) is not None:
                    yield outcome

    def end(self) -> None:
        """End the keepers and, with them, their workers."""
        for keeper in (*self.idle, *self.coming.values(), *(b[2] for b in self.busy.values())):
            self.ray.kill(keeper)

    def _call(self) -> None:
        keeper = self._made()
        self.coming[keeper.is_there.remote()] = keeper

    def _arrived(self, answer: Any) -> None:
        """A keeper is there, or lost before it was. Raises JobError when too many were."""
        keeper = self.coming.pop(answer)
        try:
            self.ray.get(answer)
            self.idle.append(keeper)
        except self.ray.exceptions.RayError as error:
            self._losses -= 1
            if self._losses < 0:
                raise JobError(f"the nodes cannot work: {error}") from error
            self._call()

    def _is_more(self, todo: Iterator[tuple[int, Job]]) -> bool:
        """Whether a job is waiting; one more is taken when none is."""
        if not self.waiting and (taken := next(todo, None)) is not None:
            self.waiting.append((*taken, 1))
        return bool(self.waiting)

    def _give(self, number: int, job: Job, tries: int, keeper: Any) -> None:
        self.busy[keeper.do.remote(job)] = number, job, keeper, tries

    def _taken(self, answer: Any) -> Outcome | None:
        """The outcome of a job, or None when its keeper was lost and it waits to be tried again, by any."""
        number, job, keeper, tries = self.busy.pop(answer)
        try:
            found = self.ray.get(answer)
        except self.ray.exceptions.RayActorError as error:
            self._call()
            if tries < self.limits.tries:
                self.waiting.append((number, job, tries + 1))
                return None
            return Outcome(number, error=f"its node was lost ({error})", tries=tries)
        self.idle.append(keeper)
        return Outcome(number, **{**found, "tries": found["tries"] + tries - 1})


def _knock(address: str) -> None:
    """Raise OSError when nothing listens at HOST:PORT, for which Ray would wait for minutes."""
    host, colon, port = address.rpartition(":")
    if colon and port.isdigit():
        socket.create_connection((host, int(port)), timeout=REACHED).close()


def _ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise JobError(f'Ray is not installed ({error}): pip install "nnproc-recon[ray]"') from error
    return ray
