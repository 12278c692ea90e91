"""One object of a list, done by a worker: what the command does, and a row of the table in place of words."""

from __future__ import annotations

import atexit
import time
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recon.command import asked_of, parser
from recon.system import net, process
from recon.system.progress import no_bars

if TYPE_CHECKING:
    from recon.api import Result
    from recon.pipelines.inputs import Asked

DONE, REFUSED, NO_RESULT, FAILED = "done", "refused", "no result", "failed"
PATIENCE = 60.0  # seconds for which a folder may be in use by a worker whose end is near
_CODES = {2: REFUSED, 3: NO_RESULT}  # of errors that say themselves what to do


def reconstructed(job: dict[str, Any]) -> dict[str, Any]:
    """A row for a job {"words", "out", "picture"}: the command line, and where results and their picture go.

    What is wrong with the input is in the row. What it raises is an accident: a full disk, a mistake of ours.
    """
    _settle()
    from recon.outputs.publish import DiskFull

    out, started = Path(job["out"]), time.monotonic()
    try:
        with no_bars():
            found = _patiently(asked_of(parser().parse_args(job["words"]), out))
        _write_picture(out, Path(job["picture"]))
    except DiskFull:
        raise
    except Exception as error:
        status = _CODES.get(getattr(error, "exit_code", None) or 0)
        if status is None:
            raise
        return {"status": status, "error": str(error), "seconds": round(time.monotonic() - started, 1)}
    return row_of(found)


def row_of(found: Result) -> dict[str, Any]:
    """What the table says of a result."""
    return {
        "status": DONE,
        "class": found.class_name,
        "belongs": found.belongs,
        "confidence": found.confidence,
        "mean_iou": found.mean_iou,
        "distance": found.distance,
        "size": [round(float(v), 5) for v in found.size],
        "params": found.params,
        "warnings": list(found.warnings),
        "seconds": found.report["seconds"]["total"],
    }


def _patiently(asked: Asked) -> Result:
    """The result; a folder that is in use is waited for: a batch that was killed leaves its workers a moment."""
    from recon import api
    from recon.system.run_lock import Busy

    until = time.monotonic() + PATIENCE
    while True:
        try:
            return api.run(asked)
        except Busy:
            if time.monotonic() > until:
                raise
            time.sleep(1.0)


def _write_picture(out: Path, picture: Path) -> None:
    from recon.outputs.thumbnail import thumbnail
    from recon.system.whole_files import write_bytes

    picture.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(picture, thumbnail(out / "report.html"))


@cache
def _settle() -> None:
    """Once a worker: libraries are quiet, and temporary files go with the process."""
    net.quiet(verbose=False)
    stack = ExitStack()
    stack.enter_context(process.temporary_files())
    atexit.register(stack.close)
