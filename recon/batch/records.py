"""What became of every object so far, kept as it comes, so that a batch that is started again goes on.

DIR/.batch/NAME.json holds a key and a row. The key covers the words, the model, this version, and the files that the
words name, by size and date of all that lies below: what looks changed is run again, its stages then go by contents.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from procmodels import ModelError, load, names
from recon.batch.entries import Entry
from recon.batch.one import DONE, FAILED
from recon.pipelines.checks import AUTO
from recon.system import manifest
from recon.system.digests import code_version, digest, file_digest
from recon.system.whole_files import write_bytes

WORK = ".batch"
MOST_FILES = 100_000  # below one input that are looked at


def kept(out: Path, entry: Entry) -> dict[str, Any] | None:
    """The row of an object whose results are there and still hold; None when it is to be done."""
    try:
        content = json.loads(_file(out, entry).read_text(encoding="utf-8"))
        row, key = content["row"], content["key"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):  # absent, or cut short
        return None
    if key != key_of(entry) or row.get("status") == FAILED:
        return None
    if row.get("status") == DONE:
        results = out / entry.name
        whole = manifest.read(results).unchanged(results, "report.json")
        return row if whole and picture_of(out, entry).is_file() else None
    return row


def keep(out: Path, entry: Entry, row: dict[str, Any], key: str, details: str = "") -> None:
    """Store what became of an object; `details` are for repairs. Raises OSError."""
    content = {"key": key, "row": row} | ({"details": details} if details else {})
    write_bytes(_file(out, entry), (json.dumps(content) + "\n").encode(), durable=True)


def key_of(entry: Entry) -> str:
    """What the results of an object depend on."""
    class_name = next((w.removeprefix("--class=") for w in entry.words if w.startswith("--class=")), "chair")
    files = [list(_looks(path)) for path in entry.reads if path.suffix != ".py"]
    return digest(entry.words, files, _model_key(class_name), code_version())


def picture_of(out: Path, entry: Entry) -> Path:
    """Where the small picture of an object is."""
    return out / "thumbs" / f"{entry.name}.jpg"


def _file(out: Path, entry: Entry) -> Path:
    return out / WORK / f"{entry.name}.json"


def _looks(path: Path) -> Iterator[tuple[str, int, int]]:
    """Name, size and date of a file, or of all files below a folder."""
    for number, file in enumerate(_files(path)):
        if number >= MOST_FILES:
            return
        try:
            about = file.stat()
        except OSError:
            continue
        yield os.fsdecode(os.fsencode(file.relative_to(path.parent))), about.st_size, about.st_mtime_ns


def _files(path: Path) -> Iterator[Path]:
    if not path.is_dir():
        yield path
        return
    for place, folders, found in os.walk(path):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        yield from (Path(place) / name for name in sorted(found))


@cache
def _model_key(class_name: str) -> str:
    """The source of a class and its weights, or of all classes; a file of the user's is not run for that."""
    if class_name.endswith(".py"):
        files = [Path(class_name), Path(class_name).with_suffix(".safetensors")]
        return digest([_content(f) for f in files])
    try:
        models = [load(n) for n in (names() if class_name == AUTO else [class_name])]
    except ModelError:
        return "none"
    return digest([[m.name, m.space.hash, m.code, _content(m.weights)] for m in models])


def _content(file: Path) -> str:
    try:
        return file_digest(file)
    except OSError:
        return hashlib.sha256().hexdigest()
