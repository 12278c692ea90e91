"""How the axes of outside files lie: tables in JSON, one a folder or catalogue.

    {"up": "y", "front": "-z", "files": {"chair/x.ply": {"front": "x", "note": "the step is its front"}}}

A folder's own `axes.json` comes first, then the file of the folder's (or catalogue's) name in datasets/axes, which was
made by looking at pictures (`python -m recon.evaluate.axes`). Other keys, such as "note", are for people.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from datasets.axis_rotations import turn
from datasets.catalogue_object import DataError

OWN_FILE = "axes.json"
KNOWN = Path(__file__).with_name("axes")


@dataclass(frozen=True)
class FileAxes:
    """A table of axes. where: the file it comes from, or None for the empty table, which leaves all as it is."""

    table: dict[str, Any]
    where: Path | None

    def turn(self, key: str, up: str, front: str) -> np.ndarray:
        """(3, 3) rotation, canonical from file: the entry of the file's `key` before the table's, these before `up`
        and `front`."""
        own = self.table.get("files", {}).get(key, {})
        up, front = (str(own.get(k, self.table.get(k, default))) for k, default in (("up", up), ("front", front)))
        try:
            return turn(up, front)
        except ValueError as error:
            raise DataError(f"{self.where}, for {key}: {error}") from error


def find(name: str, folder: Path | None = None) -> FileAxes:
    """The table for data of this name, kept in `folder` when they are a folder. Raises DataError for a broken one."""
    files = [KNOWN / f"{name}.json"] if folder is None else [folder / OWN_FILE, KNOWN / f"{name}.json"]
    where = next((f for f in files if f.is_file()), None)
    if where is None:
        return FileAxes({}, None)
    try:
        table = json.loads(where.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{where} is not readable as JSON ({error})") from error
    per_file = table.get("files", {}) if isinstance(table, dict) else None
    if not isinstance(per_file, dict) or not all(isinstance(v, dict) for v in per_file.values()):
        raise DataError(f'{where}: expected {{"up": "y", "front": "-z", "files": {{"chair/x.ply": {{"front": "x"}}}}}}')
    return FileAxes(table, where)
