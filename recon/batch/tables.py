"""The table of a batch: table.csv for people, table.json for programs, both written whole or not at all."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

from recon.system.names import all_shown
from recon.system.whole_files import write_bytes

# Of the CSV. Seconds come last: all before them is the same whenever and by however many workers it was made.
COLUMNS = (
    *("name", "input", "status", "class", "belongs", "confidence", "mean_iou", "distance", "width", "depth", "height"),
    *("params", "warnings", "error", "seconds"),
)


def write(rows: list[dict[str, Any]], out: Path) -> None:
    """Both tables, in the list's order. Raises OSError."""
    lines = ",\n".join(json.dumps(all_shown(row)) for row in rows)
    write_bytes(out / "table.json", f"[\n{lines}\n]\n".encode())
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, restval="", extrasaction="ignore")
    writer.writeheader()
    for row in rows:
        writer.writerow(_flat(all_shown(row)))
    write_bytes(out / "table.csv", text.getvalue().encode("utf-8-sig"))  # spreadsheets need the mark


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """Lists and dicts as texts, what is not known as nothing."""
    size = row.get("size") or ("", "", "")
    flat = {k: "" if v is None else v for k, v in row.items()}
    flat |= dict(zip(("width", "depth", "height"), size, strict=True))
    values = row.get("params", {}).items()
    flat["params"] = " ".join(f"{k}={v:.4g}" if isinstance(v, float) else f"{k}={v}" for k, v in values)
    flat["warnings"] = " | ".join(row.get("warnings", []))
    return flat
