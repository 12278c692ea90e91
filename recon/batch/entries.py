"""What LIST says: inputs, each with its options and the name of its results."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from recon.batch import catalogues, folder
from recon.batch.options import Option, known_options, words_of
from recon.scene import InputError
from recon.system.folders import exists
from recon.system.names import plain, unique
from recon.system.user_files import read_bytes, read_json

RESERVED = ("table.csv", "table.json", "index.html", "thumbs")  # names in DIR that are no object's
_YES, _NO = ("yes", "true", "1", "x"), ("no", "false", "0")


@dataclass(frozen=True)
class Entry:
    """One object.

    name    of the folder of its results below DIR
    source  the input as a person would give it
    words   what a command line would say: INPUT, then flags; paths are absolute
    reads   the files and folders that it names, INPUT first
    wrong   what is wrong with its line of the list; it is not run then
    """

    name: str
    source: str
    words: tuple[str, ...]
    reads: tuple[Path, ...]
    wrong: str | None = None


@dataclass(frozen=True)
class Said:
    """A line of a list before names are given: an input, options by flag, and the name that the list gives it."""

    source: Path
    options: dict[str, Any] = field(default_factory=dict)
    name: str = ""
    wrong: str | None = None


def entries(given: Path, common: Mapping[str, Any], out: Path, limit: int | None = None) -> list[Entry]:
    """The objects of LIST, the first `limit` of them; `common` are options of all, by flag ("camera-off").

    Raises InputError when LIST is nothing that is known, or an option in it is none.
    """
    if not exists(given):
        raise InputError(f"LIST {given} does not exist; give a folder of inputs, a CSV or JSON list, or a data set")
    said = _in_folder(given, common, out) if given.is_dir() else _in_file(given)
    if not said:
        raise InputError(f"{given} lists nothing")
    chosen = said[:limit]
    names = unique([plain(s.name or s.source.stem or s.source.name) for s in chosen], RESERVED)
    return [_entry(s, n, common) for s, n in zip(chosen, names, strict=True)]


def _in_folder(given: Path, common: Mapping[str, Any], out: Path) -> list[Said]:
    if (found := catalogues.listed(given, common.get("class"))) is not None:
        return [Said(f.source, f.options, f.name) for f in found]
    return [Said(path, name=path.stem if path.is_file() else path.name) for path in folder.inputs(given, common, out)]


def _in_file(given: Path) -> list[Said]:
    """The rows of a CSV or JSON list."""
    if given.suffix.lower() == ".json":
        rows = read_json(given, "a list of inputs")
        if not isinstance(rows, list):
            raise InputError(f'{given} is not a list: [{{"input": "a.obj", "class": "table"}}, ...] is expected')
        rows = [{"input": row} if isinstance(row, str) else row for row in rows]
    else:
        rows = _csv_rows(given)
    options = known_options()
    return [_said(given, number, row, options) for number, row in enumerate(rows, 1)]


def _csv_rows(given: Path) -> list[dict[str, Any]]:
    """Rows by column. Commas, semicolons or tabs: whatever the first line has most of."""
    try:
        text = read_bytes(given).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{given} is no text in UTF-8; LIST is a folder, or a list as CSV or JSON") from error
    head = text.partition("\n")[0]
    reader = csv.DictReader(io.StringIO(text, newline=""), delimiter=max(",;\t", key=head.count), strict=True)
    try:
        columns, rows = reader.fieldnames or [], [row for row in reader if any(map(_filled, row.values()))]
    except csv.Error as error:
        raise InputError(f"{given}, line {reader.line_num}: {error}") from error
    if "input" not in [c.strip().lower() for c in columns]:
        raise InputError(f'{given} has no column "input"; it has {", ".join(map(repr, columns)) or "no first line"}')
    return [{str(k).strip().lower(): v for k, v in row.items() if k is not None} for row in rows]


def _said(given: Path, number: int, row: Any, options: Mapping[str, Option]) -> Said:
    """A row, its paths below the list's folder. Raises InputError for columns that are none."""
    place = f"{given}, entry {number}"
    if not isinstance(row, dict):
        raise InputError(f"{place}: a text or an object with options is expected, got {str(row)[:80]}")
    filled = {str(k).lower().replace("_", "-"): v for k, v in row.items() if _filled(v)}
    if unknown := sorted(filled.keys() - {"input", "name"} - options.keys()):
        known = ", ".join(["input", "name", *options])
        raise InputError(f"{place}: there is no option {', '.join(unknown)}; known: {known}")
    source, name = filled.pop("input", None), str(filled.pop("name", ""))
    if not isinstance(source, str):
        return Said(Path(f"entry-{number}"), {}, name, f"{place} names no input")
    try:
        read = {k: _value(given.parent, options[k], v) for k, v in filled.items()}
    except ValueError as error:
        return Said(given.parent / source.strip(), {}, name, f"{place}: {error}")
    return Said(given.parent / source.strip(), {k: v for k, v in read.items() if v is not False}, name)


def _filled(value: Any) -> bool:
    return value is not None and (not isinstance(value, str) or value.strip() != "")


def _value(base: Path, option: Option, value: Any) -> Any:
    """An option's value: True or False of a switch, else a text; paths are below `base`. Raises ValueError."""
    if option.switch:
        word = str(value).strip().lower()
        if word not in (*_YES, *_NO):
            raise ValueError(f"{option.flag} is yes or no, got {value!r}")
        return word in _YES
    if isinstance(value, list):
        return ",".join(str(v) for v in value)
    text = str(value).strip()
    return str(base / text) if option.is_path(text) else text


def _entry(said: Said, name: str, common: Mapping[str, Any]) -> Entry:
    source = said.source.absolute()
    options = known_options()
    both = {**common, **said.options}
    both = {k: str(Path(v).absolute()) if options[k].is_path(v) else v for k, v in both.items()}
    files = [Path(v) for k, v in both.items() if options[k].is_path(v)]
    return Entry(name, str(said.source), (str(source), *words_of(both)), tuple(_unlike([source, *files])), said.wrong)


def _unlike(paths: Iterable[Path]) -> list[Path]:
    return list(dict.fromkeys(paths))
