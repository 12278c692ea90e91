"""The command line's words, checked as they are read: a path is named, a number is one, and an error is one line."""

from __future__ import annotations

import argparse
import math
import os
import stat
from pathlib import Path
from typing import NoReturn

from recon.scene import InputError

MOST_SEED = 10**9  # every generator of random numbers takes these


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; --help has the rest."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; {self.prog} --help lists all options")


def path(text: str) -> Path:
    """A path that names something, which need not be there."""
    if not text.strip():
        raise argparse.ArgumentTypeError("a file or folder must be named, and this is empty")
    return Path(text)


def readable(given: Path, option: str) -> None:
    """Raise InputError unless a file or folder is there and can be read: no pipe, no device, no link to nowhere."""
    try:
        mode = given.stat().st_mode
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        raise InputError(f"{option} {_not_there(given, error)}") from error
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise InputError(f"{option} {given} is a pipe, a socket or a device; give a file or a folder")
    if not os.access(given, os.R_OK | (os.X_OK if stat.S_ISDIR(mode) else 0)):
        raise InputError(f"{option} {given} cannot be read; check its permissions")


def nameable(given: Path, option: str) -> None:
    """Raise InputError unless a file or folder can have this name, whether it is there or not."""
    try:
        given.stat()
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as error:
        raise InputError(f"{option} {_not_there(given, error)}; choose another name") from error


def _not_there(given: Path, error: OSError | ValueError) -> str:
    if isinstance(error, FileNotFoundError):
        link = f" is a link to {os.readlink(given)}, which" if given.is_symlink() else ""
        return f"{given}{link} does not exist: it is not a folder and not a file"
    return f"{given} cannot be opened ({getattr(error, 'strerror', None) or error})"


def seed(text: str) -> int:
    """A whole number from 0."""
    value = whole(text)
    if not 0 <= value <= MOST_SEED:
        raise argparse.ArgumentTypeError(f"a seed is a whole number from 0 to {MOST_SEED}, got {value}")
    return value


def whole(text: str) -> int:
    """A whole number; digits without end are none."""
    try:
        return int(text[:30])
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"a whole number is wanted, got {text!r}") from error


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"a number is wanted, got {text!r}") from error
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"a finite number is wanted, got {text!r}")
    return value
