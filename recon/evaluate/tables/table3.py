"""The paper's Table 3: meshes of whole ShapeNet classes, beside ShapeAssembly's and the paper's published figures.

    python -m recon.evaluate table3 --data ShapeNetCore.v2

Without ShapeNet any other data of datasets.catalogues goes, and the table says that the objects are others.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from recon.evaluate.tables.table2_rows import Table2Row

CLASSES = ("chair", "shelf", "table")
# Average chamfer distance over 5617, 1768 and 7654 ShapeNet shapes, as published in the paper's Table 3.
SHAPEASSEMBLY = {"chair": 0.0068, "shelf": 0.0048, "table": 0.0071}
PAPER = {"chair": 0.0081, "shelf": 0.0187, "table": 0.0065}


def summary(rows: list[Table2Row]) -> str:
    """A Markdown table from mesh rows of table2: published figures and ours; says which objects ours are."""
    done = {
        c: [r for r in rows if r.class_name == c and r.input == "mesh" and r.d_chamfer is not None] for c in CLASSES
    }
    lines = ["| method | " + " | ".join(CLASSES) + " |", "|---" * (1 + len(CLASSES)) + "|"]
    published = (("ShapeAssembly, as published by the paper", SHAPEASSEMBLY), ("the paper's method, published", PAPER))
    for name, figures in published:
        lines.append(f"| {name} | " + " | ".join(f"{figures[c]:.4f}" for c in CLASSES) + " |")
    means = {
        c: (_mean(r.d_chamfer for r in group), _mean(r.oracle for r in group)) for c, group in done.items() if group
    }
    ours = [f"{means[c][0]:.4f} ({len(done[c])})" if c in means else "" for c in CLASSES]
    best = [f"{means[c][1]:.4f}" if c in means else "" for c in CLASSES]
    lines.append("| ours (objects) | " + " | ".join(ours) + " |")
    lines.append("| oracle of our models | " + " | ".join(best) + " |")
    sources = sorted({r.data for group in done.values() for r in group})
    text = "\n".join(lines) + "\n"
    if sources and not all("shapenet" in s.lower() for s in sources):
        text += f"\nOurs on {', '.join(sources)}, not on ShapeNet: the published figures are of other objects.\n"
    return text


def _mean(values: Iterable[float | None]) -> float:
    return float(np.mean([v for v in values if v is not None]))
