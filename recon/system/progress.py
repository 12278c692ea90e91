"""Progress bars: shown on terminals, by commands alone; hidden while a program of somebody else's uses this one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_hidden: ContextVar[bool] = ContextVar("hidden", default=False)


def hidden() -> bool | None:
    """What tqdm takes as `disable`: None leaves it to whether there is a terminal."""
    return True if _hidden.get() else None


@contextmanager
def no_bars() -> Iterator[None]:
    """No bars within the block."""
    token = _hidden.set(True)
    try:
        yield
    finally:
        _hidden.reset(token)
