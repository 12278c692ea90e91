"""The beginning of a file, which tells what it is."""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

HEAD = 1 << 16  # bytes that are looked at

_MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))


@dataclass(frozen=True)
class Head:
    """The first bytes of a file, and its size in bytes."""

    path: Path
    start: bytes
    size: int

    @cached_property
    def text(self) -> str | None:
        """The beginning as text with whole lines, or None when it is no text."""
        text = decoded(
            self.start[: len(self.start) // 2 * 2] if self.start[:2] in (b"\xff\xfe", b"\xfe\xff") else self.start
        )
        if text is None or len(self.start) == self.size:
            return text
        return text.rsplit("\n", 1)[0]

    @cached_property
    def members(self) -> tuple[str, ...]:
        """Names in a zip archive; () for anything else, and for a damaged one."""
        if self.start[:2] != b"PK":
            return ()
        try:
            with zipfile.ZipFile(self.path) as archive:
                return tuple(archive.namelist())
        except (zipfile.BadZipFile, zlib.error, OSError, ValueError, NotImplementedError):
            return ()


def head_of(path: Path) -> Head:
    """Raises OSError."""
    with path.open("rb") as file:
        return Head(path, file.read(HEAD), path.stat().st_size)


def decoded(data: bytes) -> str | None:
    """Text in UTF-8, UTF-16 (with its mark) or Latin-1, lines ended by a newline alone; None for what is no text."""
    for mark, name in _MARKS:
        if data.startswith(mark):
            return _lines(data.decode(name, "replace"))
    if b"\0" in data:
        return None
    try:
        return _lines(data.decode("utf-8"))
    except UnicodeDecodeError:
        return _lines(data.decode("latin-1"))


def _lines(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n")


def text_of(path: Path) -> str:
    """A whole text file. Raises ValueError when it is none."""
    text = decoded(path.read_bytes())
    if text is None:
        raise ValueError("it is no text")
    return text
