"""Jobs by the machines of a Ray cluster (extra `ray`); every node has this project installed and sees the same files.

Ray starts one keeper a worker and hands it jobs; the keeper has a worker process of its own, as a pool has, so that
memory, accidents and results are the same. A keeper that is lost with its node is replaced, its job tried again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from datasets.jobs.crew import Member
from datasets.jobs.limits import Limits
from datasets.jobs.outcome import Job, JobError, Outcome, name_of

WAIT = 5.0  # seconds, so that a signal is heard


class Keeper:
    """What runs on a node: one worker process and those who ask it."""

    def __init__(self, function: str, limits: Limits) -> None:
        self.member = Member(function, limits)

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
                ray.init(address=self.address, log_to_driver=False, include_dashboard=False, logging_level="error")
            except (ConnectionError, ValueError, RuntimeError) as error:
                raise JobError(f"no Ray cluster answers at {self.address} ({error}); start one: ray start") from error
        count = self.workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        crew = _Crew(ray, name, self.limits, count)
        try:
            yield from crew.outcomes(jobs)
        finally:
            crew.end()
            if mine:
                ray.shutdown()


class _Crew:
    """The keepers, and which job each of them has."""

    def __init__(self, ray: Any, function: str, limits: Limits, count: int) -> None:
        self.ray, self.limits = ray, limits
        remote = ray.remote(num_cpus=1, max_restarts=0)(Keeper)
        self.made = lambda: remote.remote(function, limits)
        self.idle = [self.made() for _ in range(count)]
        self.busy: dict[Any, tuple[int, Job, Any, int]] = {}  # by what will be the answer

    def outcomes(self, jobs: Iterable[Job]) -> Iterator[Outcome]:
        """As they are done."""
        todo = enumerate(jobs)
        while True:
            while self.idle and (taken := next(todo, None)) is not None:
                self._give(*taken, self.idle.pop(), 1)
            if not self.busy:
                return
            ready, _ = self.ray.wait(list(self.busy), num_returns=1, timeout=WAIT)
            for answer in ready:
                if (outcome := self._taken(answer)) is not None:
                    yield outcome

    def end(self) -> None:
        """End the keepers and, with them, their workers."""
        for keeper in (*self.idle, *(b[2] for b in self.busy.values())):
            self.ray.kill(keeper)

    def _give(self, number: int, job: Job, keeper: Any, tries: int) -> None:
        self.busy[keeper.do.remote(job)] = number, job, keeper, tries

    def _taken(self, answer: Any) -> Outcome | None:
        """The outcome of a job, or None when its keeper was lost and it is tried again."""
        number, job, keeper, tries = self.busy.pop(answer)
        try:
            found = self.ray.get(answer)
        except self.ray.exceptions.RayActorError as error:
            self.idle.append(self.made())
            if tries < self.limits.tries:
                self._give(number, job, self.idle.pop(), tries + 1)
                return None
            return Outcome(number, error=f"its node was lost ({error})", tries=tries)
        self.idle.append(keeper)
        return Outcome(number, **{**found, "tries": found["tries"] + tries - 1})


def _ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise JobError(f'Ray is not installed ({error}): pip install "nnproc-recon[ray]"') from error
    return ray
