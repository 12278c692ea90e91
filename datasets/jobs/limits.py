"""What one worker may take, and how often an accident is forgiven."""

from __future__ import annotations

from dataclasses import dataclass

TOO_LARGE = 97  # exit code of a worker that took too much memory


@dataclass(frozen=True)
class Limits:
    """memory  bytes that a worker may hold; one that takes more is ended, and its job tried by a fresh one
    kept     share of `memory` above which a worker that has done its job makes way for a fresh one
    tries    how often a job is begun at most
    seconds  that a job may take before its worker is ended; None for any
    """

    memory: int = 6 << 30
    kept: float = 0.5
    tries: int = 3
    seconds: float | None = None
