"""The last net under a command: whatever nobody foresaw ends with one line for people and a log for repairs.

Errors that say themselves what to do (those with an exit_code, such as recon.scene.ReconError) pass as their line.
"""

from __future__ import annotations

import datetime
import errno
import logging
import os
import re
import resource
import shlex
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from recon.system import limits, process
from recon.system.names import shown

FAILED = 3
LOG = ".failed.log"  # its name in the work folder of a run
_LONGEST = 1500  # characters of a line for people
_STAGE = re.compile(r"\[\d+/\d+\] (.+)")  # as the pipelines say them
_NO_MEMORY = ("alloc", "insufficient memory", "out of memory", "cannot allocate")


class Stage(logging.Handler):
    """Remembers the last stage that a pipeline said it begins."""

    def __init__(self) -> None:
        super().__init__()
        self.name_now = "looking at the input"

    def emit(self, record: logging.LogRecord) -> None:
        if found := _STAGE.fullmatch(record.getMessage()):
            self.name_now = found[1]


@dataclass
class About:
    """What a command is about, as far as it knows: the file that it works on, and its work folder, which takes logs."""

    what: object = None
    log_folder: Path | None = None


def run(work: Callable[[About], int]) -> int:
    """The exit code of `work`, or of the one line on stderr that it ended with. `work` fills in what it is about."""
    about, stage = About(), Stage()
    logging.getLogger("recon").addHandler(stage)
    try:
        _refuse_too_little_memory()
        return work(about)
    except BaseException as error:  # SystemExit of foreign code as well
        if _interrupted(error) or (isinstance(error, SystemExit) and about.what is None):  # or --help
            raise
        if (code := getattr(error, "exit_code", None)) is not None:
            say(f"error: {error}")
            return int(code)
        log = _write_log(about.log_folder)
        kept = f"details are in {log}" if log else "no log could be written"
        say(f"error: {about.what or 'the command'}: failed at the stage {stage.name_now}: {reason(error)}; {kept}")
        return FAILED
    finally:
        logging.getLogger("recon").removeHandler(stage)


def say(text: str) -> None:
    """One line on stderr, whatever is in the text: file names may hold line ends, and bytes that are no characters."""
    short = text if len(text) <= _LONGEST else text[: _LONGEST // 2] + " ... " + text[-_LONGEST // 2 :]
    line = re.sub(r"\s*[\r\n\v\f\x1c-\x1e\x85\u2028\u2029]+\s*", " ", short.strip())
    with suppress(OSError, ValueError):  # stderr may be closed
        sys.stderr.write(shown(line) + "\n")
        sys.stderr.flush()


def quiet(verbose: bool) -> None:
    """Libraries' warnings are noise to the user; --verbose shows them. Call before the libraries are imported."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR" if verbose else "OFF")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    logging.captureWarnings(True)
    if not sys.warnoptions:
        warnings.simplefilter("default" if verbose else "ignore")
    for noisy in ("PIL", "trimesh", "matplotlib", "py.warnings"):
        logging.getLogger(noisy).setLevel(logging.WARNING if verbose else logging.CRITICAL)


def reason(error: BaseException) -> str:
    """What an unforeseen error means to the user."""
    text = str(error) or type(error).__name__
    if isinstance(error, MemoryError) or any(word in text.lower() for word in _NO_MEMORY):
        return "there is not enough memory; give smaller or fewer files, or allow the process more memory"
    if isinstance(error, RecursionError):
        return "the file is nested too deeply; simplify it"
    if isinstance(error, ImportError):
        return f"a library cannot be loaded ({text}); run the installation again"
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return f"the disk is full ({text}); make room, or choose another folder with --out"
    if isinstance(error, OSError) and error.strerror:
        file = "" if error.filename is None else f" ({os.fsdecode(error.filename)})"
        return f"{error.strerror}{file}"
    if isinstance(error, SystemExit):
        return "something asked the program to end"
    return f"{type(error).__name__} ({text}), which was not foreseen; please report it with the log"


def _interrupted(error: BaseException | None) -> bool:
    """Whether an error is an interrupt, or what foreign code made of one."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _write_log(folder: Path | None) -> Path | None:
    """The present error's traceback in a file; None when it cannot be written."""
    when = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
    try:
        text = f"{when}\n{shlex.join(sys.argv)}\n{traceback.format_exc()}"
    except (MemoryError, RecursionError):
        text = f"{when}\n{sys.exc_info()[0]} and no room for a traceback\n"
    data = text.encode("utf-8", "backslashreplace")
    with suppress(OSError, ValueError):  # a name that no file can have
        if folder is not None and folder.is_dir() and not folder.is_symlink():
            (folder / LOG).write_bytes(data)
            return folder / LOG
    with suppress(OSError):
        handle, name = tempfile.mkstemp(prefix="recon-failed-", suffix=".log", dir=process.lasting_folder())
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        return Path(name)
    return None


class TooLittleMemory(Exception):
    """The process may not take as much memory as the libraries need."""

    exit_code = FAILED


def _refuse_too_little_memory() -> None:
    """Raise TooLittleMemory before a library is loaded: with less they fail in ways that nothing here can catch."""
    for kind, least, flag in (
        (resource.RLIMIT_AS, limits.ADDRESS_SPACE, "-v"),
        (resource.RLIMIT_DATA, limits.DATA, "-d"),
    ):
        allowed, _ = resource.getrlimit(kind)
        if allowed != resource.RLIM_INFINITY and allowed < least:
            raise TooLittleMemory(
                f"this process may take {allowed >> 20} MB of memory, and {least >> 20} MB are needed; raise the limit "
                f"(ulimit {flag} unlimited)"
            )
