"""Points as text: a row a point, however its columns are separated, named and ordered.

Which columns are x, y and z: those named so in a heading; else the first three, after a column that counts the rows and
after colours, if the file begins with them. What was taken is said.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from recon.files.head import Head, decoded
from recon.files.names import axis_columns
from recon.files.rows import kept
from recon.files.shape import Cloud, Kind, Recognised
from recon.scene import InputError
from recon.system import limits

_COMMENT = ("#", "//", "%", "!", "*")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?|[-+]?(nan|inf(inity)?)", re.IGNORECASE)
_LOOKED_AT = 400  # rows that decide
_PORTION = 1 << 24  # bytes


@dataclass(frozen=True)
class Layout:
    """How the rows are written.

    separator  between columns; None is white space
    decimal    "." or ","
    columns    of x, y and z
    said       why these, in words; "" for a file of three columns
    skipped    lines before the first row
    """

    separator: str | None
    decimal: str
    columns: tuple[int, int, int]
    said: str
    skipped: int = 0

    def words(self, line: str) -> list[str]:
        """A line's columns, numbers with decimal points."""
        words = (
            line.split(self.separator)
            if self.separator
            else line.replace(",", " " if self.decimal == "." else ",").split()
        )
        return (
            [w.strip(" \t\"'").replace(",", ".") for w in words]
            if self.decimal == ","
            else [w.strip(" \t\"'") for w in words]
        )


def is_table(head: Head) -> bool:
    """Whether nearly all lines, after any number of others, are rows of at least three numbers."""
    return head.text is not None and not head.text.lstrip().startswith(("{", "<")) and _layout(head.text) is not None


def describe(path: Path) -> Recognised:
    """Raises InputError for columns that cannot be told apart."""
    layout = _found(path)
    return Recognised(Kind.CLOUD, "a point cloud (rows of numbers" + (f"; {layout.said})" if layout.said else ")"))


def read(path: Path) -> Cloud:
    """All rows, or limits.POINTS of them; rows of other lengths are left out. Raises InputError when there is none."""
    layout, parts = _found(path), [np.zeros((0, 3))]
    size = path.stat().st_size
    if size > limits.TEXT:
        raise InputError(
            f"{path} is a text file of more than {limits.TEXT >> 30} GB; thin it out, or save it as binary PLY"
        )
    portions = -(-size // _PORTION)
    for number, lines in enumerate(_portions(path)):
        lines = lines[layout.skipped :] if number == 0 else lines
        chosen = kept(len(lines), -(-limits.POINTS // portions), number)
        parts.append(_numbers([lines[i] for i in chosen], layout))
    points = np.concatenate(parts)
    if not len(points):
        raise InputError(f"{path} has no rows of three numbers; save points as x y z, one a line")
    return Cloud(points)


def _found(path: Path) -> Layout:
    with path.open("rb") as file:
        head = Head(path, file.read(1 << 16), path.stat().st_size)
    layout = _layout(head.text or "")
    if layout is None:
        raise InputError(f"{path} has no rows of three numbers; save points as x y z, one a line")
    if layout.decimal == "?":
        raise InputError(
            f"{path}: commas both separate its columns and stand in its numbers; save it with semicolons between"
        )
    return layout


def _portions(path: Path) -> Iterator[list[str]]:
    with path.open("rb") as file:
        if file.read(2) in (b"\xff\xfe", b"\xfe\xff"):
            yield (decoded(path.read_bytes()) or "").split("\n")
            return
        file.seek(0)
        rest = b""
        while data := file.read(_PORTION):
            whole, found, last = (rest + data).replace(b"\r\n", b"\n").replace(b"\r", b"\n").rpartition(b"\n")
            rest = last if found else b""
            text = decoded(whole if found else last)
            if text is None:
                raise ValueError("it is no text all through")
            yield text.split("\n")
        if rest:
            yield (decoded(rest) or "").split("\n")


def _numbers(lines: list[str], layout: Layout) -> np.ndarray:
    """(n, 3) float of the lines that have numbers in the three columns."""
    rows, need = [], max(layout.columns)
    for line in lines:
        words = layout.words(line)
        if len(words) > need:
            try:
                rows.append([float(words[c]) for c in layout.columns])
            except ValueError:
                continue
    return np.array(rows).reshape(-1, 3)


def _layout(text: str) -> Layout | None:
    """How a text's rows are written, from its beginning; None when they are no rows of numbers."""
    lines = text.lstrip("\ufeff").split("\n")
    for separator, decimal in _separations(lines):
        trial = Layout(separator, decimal, (0, 1, 2), "")
        rows = [
            (i, trial.words(line))
            for i, line in islice(enumerate(lines), 4 * _LOOKED_AT)
            if line.strip() and not _remark(line)
        ]
        good = [(i, words) for i, words in rows if sum(map(_is_number, words)) >= max(3, len(words) / 2)]
        if not good or len(good) < 0.9 * sum(i >= good[0][0] for i, _ in rows):
            continue
        first = _after_scanner(lines, good[0][0])
        table = [words for i, words in good if i >= first][:_LOOKED_AT]
        return _with_columns(trial, lines[:first], table, first)
    return None


def _remark(line: str) -> bool:
    return line.lstrip().startswith(_COMMENT)


def _separations(lines: list[str]) -> Iterator[tuple[str | None, str]]:
    """(separator, decimal sign) that the lines may have, the surest first; "?" when commas are both."""
    some = [line for line in lines[:_LOOKED_AT] if any(map(str.isdigit, line)) and not _remark(line)]
    body = some[len(some) // 2 :] or some
    for separator in (";", "\t", "|"):
        if body and all(line.count(separator) >= 2 for line in body[:50]):
            yield separator, _decimal(body, separator)
    spaced = [line.split() for line in body]
    if spaced and all(
        len(w) >= 3 and all(re.fullmatch(r"[-+]?\d+(,\d+)?([eE][-+]?\d+)?", x) for x in w[:3]) for w in spaced
    ):
        yield None, "," if any("," in x for w in spaced for x in w[:3]) else "."
        return
    if body and all(line.count(",") >= 2 for line in body[:50]):
        halves = [line.replace(" ", "").split(",") for line in body]
        # 0,1704,-0,1924,0,4700: no number of its own has a leading zero, or is "-0".
        both = sum(any(re.fullmatch(r"-0|0\d+", word) for word in words) for words in halves) > 0.2 * len(halves)
        yield ",", "?" if both and not any("." in line for line in body) else "."
    yield None, "."


def _decimal(body: list[str], separator: str) -> str:
    words = [word for line in body for word in line.split(separator)]
    return "," if any("," in w for w in words) and not any(re.search(r"\d\.\d", w) for w in words) else "."


def _is_number(word: str) -> bool:
    return _NUMBER.fullmatch(word) is not None


def _after_scanner(lines: list[str], first: int) -> int:
    """The first row of points behind a PTX file's ten lines: two counts, a scanner's place and axes, a matrix."""
    widths = [len(line.split()) for line in lines[max(0, first - 2) : first + 8]]
    return first + 8 if widths == [1, 1, 3, 3, 3, 3, 4, 4, 4, 4] else first


def _with_columns(layout: Layout, before: list[str], table: list[list[str]], first: int) -> Layout:
    """The same with the columns of x, y and z: by their names, else by what the columns hold."""
    width = int(np.median([len(row) for row in table]))
    for line in reversed([b for b in before if b.strip()][-3:]):
        for words in (layout.words(line), re.split(r"[\s,;|]+", line.strip(" \t#/%!*"))):
            named = axis_columns([w for w in words if w.strip("#/%!*")])
            if named is not None:
                said = _said(named, "as its heading names them") if width > 3 or named != (0, 1, 2) else ""
                return Layout(layout.separator, layout.decimal, named, said, first)
    numeric = [c for c in range(width) if all(len(r) > c and _is_number(r[c]) for r in table)]
    values = {c: np.array([float(r[c].lower().replace("d", "e")) for r in table]) for c in numeric}
    reason = ""
    if len(numeric) > 3 and len(table) > 3 and (np.diff(values[numeric[0]]) == 1).all():
        numeric, reason = numeric[1:], "the first counts the rows"
    if (
        len(numeric) >= 6
        and _colours([values[c] for c in numeric[:3]])
        and not _colours([values[c] for c in numeric[3:6]])
    ):
        numeric, reason = numeric[3:], "colours come first"
    if len(numeric) < 3:
        numeric = [0, 1, 2]
    columns = (numeric[0], numeric[1], numeric[2])
    return Layout(layout.separator, layout.decimal, columns, _said(columns, reason) if width > 3 else "", first)


def _said(columns: tuple[int, int, int], reason: str) -> str:
    numbers = ", ".join(str(c + 1) for c in columns)
    return f"columns {numbers} are taken as x, y, z" + (f": {reason}" if reason else "")


def _colours(columns: list[np.ndarray]) -> bool:
    """Whether three columns are whole numbers of 0 to 255."""
    both = np.stack(columns)
    return bool(
        np.isfinite(both).all()
        and (both == np.round(both)).all()
        and both.min() >= 0
        and both.max() <= 255
        and np.ptp(both) > 1
    )
