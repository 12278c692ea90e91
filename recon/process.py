"""The command as a process: it ends cleanly when it is told to, outlives who listens to it, and leaves nothing behind.

Nothing here is about reconstruction, and nothing heavy is imported: it holds from the first moment.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import IO, Any

from recon import scratch

PREFIX = "nnproc-recon-"  # of a process's folder for temporary files


class Terminated(KeyboardInterrupt):
    """What an interrupt does, asked for by a signal of another program or the end of the terminal."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def run(main: Callable[[], int]) -> int:
    """`main` in this process, with all of the above; the exit code."""
    _open_standard_streams()
    sys.stdout, sys.stderr = _Patient(sys.stdout, 1), _Patient(sys.stderr, 2)
    for one in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(one) == signal.SIG_DFL:  # nohup has SIGHUP ignored
            signal.signal(one, _stop)
    try:
        with _temporary_files():
            return main()
    except KeyboardInterrupt as error:
        number = error.number if isinstance(error, Terminated) else signal.SIGINT
        what = "interrupted" if number == signal.SIGINT else "terminated"
        sys.stderr.write(f"{what}; run the same command again to go on from the last finished stage\n")
        return 128 + number  # as shells say it
    finally:
        for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # only Python's own tidying up is left
            signal.signal(one, signal.SIG_DFL)


def _stop(number: int, frame: FrameType | None) -> None:
    raise Terminated(number)


@contextmanager
def _temporary_files() -> Iterator[None]:
    """All temporary files, of libraries and children too, in one folder that goes with this process.

    A killed process cannot remove its own; the next one does.
    """
    with ExitStack() as stack:
        try:
            own = stack.enter_context(scratch.folder(Path(tempfile.gettempdir()), PREFIX))
        except OSError as error:
            sys.stderr.write(f"error: there is no place for temporary files ({error}); make room, or set TMPDIR\n")
            raise SystemExit(2) from error
        os.environ["TMPDIR"] = tempfile.tempdir = str(own)
        yield


def _open_standard_streams() -> None:
    """Opens those that were closed from the start, lest a file gets their number and what libraries print."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free: this one


class _Patient:
    """A standard stream whose reader may go away, or that was closed from the start: only what is said then is lost."""

    def __init__(self, stream: IO[str] | None, descriptor: int) -> None:
        self._stream = open(os.devnull, "w") if stream is None else stream  # noqa: SIM115 (as long as the process)
        self._descriptor = descriptor

    def write(self, text: str) -> int:
        self._trying(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        self._trying(self._stream.flush)

    def _trying(self, talk: Callable[[], object]) -> None:
        try:
            talk()
        except BlockingIOError:
            pass
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._descriptor)
            os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
