"""The command as a process: it ends cleanly when it is told to, outlives who listens to it, and leaves nothing behind.

Nothing here is about reconstruction, and nothing heavy is imported: it holds from the first moment.
"""

from __future__ import annotations

import ctypes
import io
import os
import shutil
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import IO, Any

from recon.system import scratch

PREFIX = "nnproc-recon-"  # of a process's folder for temporary files
PATIENCE = 5.0  # seconds for tidying up after a signal
_SIGNALS = {  # that end the process, and what they do to begin with
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}


class Stopped(KeyboardInterrupt):
    """A signal asked this process to end: Ctrl-C, another program, or the terminal that was closed."""


def run(main: Callable[[], int]) -> int:
    """`main` in this process, with all of the above; the exit code."""
    _open_standard_streams()
    sys.stdout, sys.stderr = _Patient(sys.stdout, 1), _Patient(sys.stderr, 2)
    stop = _Stop()
    try:
        with temporary_files() as stop.folder:
            return main()
    except BaseException:
        if not stop.number:
            raise
        sys.stderr.write(stop.words())
        return 128 + stop.number  # as shells say it
    finally:
        stop.over()


class _Stop:
    """Ends the process on a signal: by an exception, so that everything is tidied up; by force when that was swallowed
    or takes long, or when the signal comes again. `folder` is removed in any case."""

    def __init__(self) -> None:
        self.number = 0
        self.folder: Path | None = None
        self._asked, self._over = threading.Event(), threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()
        for number, usual in _SIGNALS.items():
            if signal.getsignal(number) == usual:  # nohup, for one, has SIGHUP ignored
                signal.signal(number, self._signalled)
        sys.excepthook = self._quietly(sys.excepthook)
        sys.unraisablehook = self._quietly(sys.unraisablehook)

    def words(self) -> str:
        what = "interrupted" if self.number == signal.SIGINT else "terminated"
        return f"{what}; run the same command again to go on from the last finished stage\n"

    def over(self) -> None:
        """From now on only Python's own tidying up is left."""
        self._over.set()
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_DFL)

    def _signalled(self, number: int, frame: FrameType | None) -> None:
        if self.number:
            self._end()
        self.number = number
        self._asked.set()
        raise Stopped

    def _watch(self) -> None:
        self._asked.wait()
        if not self._over.wait(PATIENCE):
            self._end()

    def _end(self) -> None:
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
        with suppress(OSError):
            os.write(2, self.words().encode())
        os._exit(128 + self.number)  # children go with this process

    def _quietly(self, hook: Callable[..., Any]) -> Callable[..., Any]:
        """Says nothing of interrupts, which foreign code may catch in callbacks of its own."""

        def said(*about: Any) -> None:
            kind = about[0] if isinstance(about[0], type) else about[0].exc_type
            if not issubclass(kind, KeyboardInterrupt):
                hook(*about)

        return said


@contextmanager
def signals_kept() -> Iterator[None]:
    """Keeps what signals do over the import of a library that takes them for itself; in any thread."""
    system, kept = ctypes.CDLL(None), {number: ctypes.create_string_buffer(512) for number in _SIGNALS}
    for number, action in kept.items():
        system.sigaction(int(number), None, action)
    yield
    for number, action in kept.items():
        system.sigaction(int(number), action, None)


@contextmanager
def temporary_files() -> Iterator[Path]:
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
        yield own


def lasting_folder() -> Path:
    """The folder for temporary files that stays when this process ends."""
    own = Path(tempfile.gettempdir())
    return own.parent if own.name.startswith(PREFIX) else own


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
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal may not know all letters of a file's name

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
