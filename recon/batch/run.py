"""A batch: what is not done yet goes to the workers, and what comes back is kept, told and put into the table."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from datasets.jobs import Backend, Outcome
from recon.batch import one, page, records, tables
from recon.batch.entries import Entry
from recon.scene import InputError
from recon.system import run_lock
from recon.system.names import shown

log = logging.getLogger("recon")
EVERY = 60.0  # seconds between tables of a batch that is still going on


@dataclass
class Board:
    """Rows by the list's order, as far as they are known."""

    out: Path
    entries: list[Entry]
    rows: dict[int, dict[str, Any]]
    written: float = 0.0

    def put(self, number: int, row: dict[str, Any]) -> None:
        """A row that has just come; the tables are written now and then."""
        entry = self.entries[number]
        self.rows[number] = {"name": entry.name, "input": entry.source, **row}
        log.info("[%d/%d] %s: %s", len(self.rows), len(self.entries), shown(entry.name), said(row))
        if time.monotonic() > self.written + EVERY:
            self.write()

    def write(self) -> None:
        """The tables and the page. Raises OSError."""
        rows = [self.rows[n] for n in sorted(self.rows)]
        tables.write(rows, self.out)
        page.write(rows, self.out, len(self.entries))
        self.written = time.monotonic()


def run(entries: list[Entry], out: Path, backend: Backend) -> list[dict[str, Any]]:
    """The rows of all objects, in the list's order; results, tables and page are in `out`.

    Raises InputError when `out` cannot be used, or another batch works in it; jobs.JobError when there are no workers.
    """
    _check(out)
    try:
        (out / records.WORK).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {out} cannot be written ({error.strerror}); choose another folder") from error
    with run_lock.held(out / records.WORK, out):
        board = Board(out, entries, {}, time.monotonic())
        todo = _todo(board)
        if board.rows:
            log.info("%d of %d are done", len(board.rows), len(entries))
        try:
            for number, outcome, key in _done(backend, board, todo):
                row = outcome.value if outcome.error is None else _accident(outcome)
                records.keep(out, entries[number], row, key, outcome.details)
                board.put(number, row)
        finally:
            board.write()
        return [board.rows[n] for n in sorted(board.rows)]


def _todo(board: Board) -> list[int]:
    """Numbers of the entries that are to be run; the rows of the others are put on the board."""
    todo = []
    for number, entry in enumerate(board.entries):
        about = {"name": entry.name, "input": entry.source}
        if entry.wrong is not None:
            board.rows[number] = {**about, "status": one.REFUSED, "error": entry.wrong}
        elif (row := records.kept(board.out, entry)) is not None:
            board.rows[number] = {**about, **row}
        else:
            todo.append(number)
    return todo


def _done(backend: Backend, board: Board, todo: list[int]) -> Iterator[tuple[int, Outcome, str]]:
    """Number, outcome and key of each as it is done; the key is from before it was begun."""
    keys: dict[int, str] = {}

    def jobs() -> Iterator[dict[str, Any]]:
        for number in todo:
            entry = board.entries[number]
            keys[number] = records.key_of(entry)
            picture = records.picture_of(board.out, entry)
            yield {
                "words": list(entry.words),
                "out": str((board.out / entry.name).absolute()),
                "picture": str(picture.absolute()),
            }

    for outcome in backend.map(one.reconstructed, jobs()):
        number = todo[outcome.number]
        yield number, outcome, keys[number]


def _accident(outcome: Outcome) -> dict[str, Any]:
    times = f"{outcome.tries} times" if outcome.tries > 1 else "once"
    return {"status": one.FAILED, "error": f"failed {times}: {outcome.error}"}


def said(row: dict[str, Any]) -> str:
    """A row in a few words."""
    if row["status"] != one.DONE:
        return f"{row['status']}: {shown(row['error'])}"
    noun = row["class"].rpartition("/")[2]
    return f"{noun if row['belongs'] else f'no {noun}'}, confidence {row['confidence']:.2f}, {row['seconds']:.0f} s"


def _check(out: Path) -> None:
    """Raise InputError when `out` holds what is not a batch's."""
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out} is a file; give a folder")
    if out.is_dir() and not (out / records.WORK).is_dir() and any(out.iterdir()):
        raise InputError(
            f"--out {out} holds files, and is not the folder of an earlier batch; give a new or an empty folder"
        )
