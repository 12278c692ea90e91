"""Rows of the paper's Table 1 as measured here, and how they are printed beside the paper's figures."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TextIO

import torch

from recon.evaluate.rows import machine

GRIDS = ("on", "off")
# Figures of the paper's Table 1 for its own method, to print beside ours: D_voxel for Task 1, else D_chamfer.
PAPER_FIGURES = {
    "table": {"spread": 0.066, "1": 0.75, "2": 0.0003, "3": 0.0031, "4 paper": 0.0117},
    "sofa": {"spread": 0.0033, "1": 0.34, "2": 0.0002, "3": 0.0005, "4 paper": 0.0016},
    "chair": {"spread": 0.019, "1": 0.08, "2": 0.0001, "3": 0.0007, "4 paper": 0.0057},
    "shelf": {"spread": 0.036, "1": 0.25, "2": 0.0006, "3": 0.0031, "4 paper": 0.0063},
    "bed": {"spread": 0.014, "1": 0.23, "2": 0.0004, "3": 0.0015, "4 paper": 0.0109},
}

TASK_NAMES = {
    "spread": "random pairs: D_chamfer, D_voxel",
    "1": "1 parameters to grid, D_voxel",
    "2": "2 grid to parameters",
    "3": "3 by search",
    "4 paper": "4 four masks, the paper's cameras",
    "4 spread": "4 four masks, cameras all round",
}


@dataclass(frozen=True)
class Table1Row:
    """One figure; None where a measure does not apply. seconds is the mean wall time of the method a shape;
    visible_right is the share of the discrete parameters found among those that the masks show."""

    class_name: str
    grid: str
    task: str
    method: str
    shapes: int
    d_chamfer: float | None = None
    floor: float | None = None
    d_voxel: float | None = None
    discrete_accuracy: float | None = None
    scalar_error: float | None = None
    seconds: float | None = None
    visible_right: float | None = None

    @staticmethod
    def from_json(values: dict) -> Table1Row:
        """The inverse of as_json."""
        rest = {k: v for k, v in values.items() if k != "class"}
        return Table1Row(values["class"], **rest)

    def as_json(self) -> dict:
        """The row as written to files: `class` for class_name."""
        values = asdict(self)
        return {"class": values.pop("class_name"), **values}


def print_rows(rows: list[Table1Row], to: TextIO) -> None:
    """A Markdown table, the paper's figure beside each of ours where it gives one."""
    to.write(f"Measured on {machine()}, {torch.get_num_threads()} thread(s).\n\n")
    to.write(markdown(rows))


def markdown(rows: list[Table1Row]) -> str:
    """The table alone; docs/results.md prints the kept results through this."""
    head = "class grid task method shapes D_chamfer floor excess paper D_voxel_% discrete_right scalar_error s_a_shape"
    names = [h.replace("_", " ") if h != "D_chamfer" else h for h in head.split()]
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    for r in rows:
        paper = (
            PAPER_FIGURES.get(r.class_name, {}).get(r.task)
            if r.grid == "on" and r.method in ("ours", "spread")
            else None
        )
        excess = r.d_chamfer - r.floor if r.d_chamfer is not None and r.floor is not None else None
        cells = [r.class_name, r.grid, r.task, r.method, str(r.shapes), _number(r.d_chamfer, 5), _number(r.floor, 5)]
        cells += [_number(excess, 5), "" if paper is None else f"{paper:g}", _number(r.d_voxel, 3)]
        cells += [_percent(r.discrete_accuracy), _percent(r.scalar_error), _number(r.seconds, 4)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def compact(rows: list[Table1Row]) -> str:
    """A line a class and task, for docs/results.md: ours and refined on / off the grid beside the paper's figure."""
    names = [
        "class",
        "task",
        "ours, on-grid",
        "ours, off-grid",
        "refined, on-grid",
        "refined, off-grid",
        "floor",
        "paper",
        "discrete right, ours on / off",
        "discrete right, refined on / off",
        "where the masks show it",
        "other methods, on-grid",
    ]
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    found = {(r.class_name, r.task, r.method, r.grid): r for r in rows}
    for class_name, task in dict.fromkeys((r.class_name, r.task) for r in rows):
        own = ["spread"] if task == "spread" else ["ours", "refined"]
        figures = [[found.get((class_name, task, method, grid)) for grid in GRIDS] for method in own]
        figures += [[None, None]] * (2 - len(own))
        first = next((r for r in (*figures[0], *figures[1]) if r is not None), None)
        if first is None:
            continue
        here = [r for r in rows if (r.class_name, r.task, r.grid) == (class_name, task, "on")]
        cells = [class_name, TASK_NAMES[task]]
        cells += ["" if r is None else _figure(r) for pair in figures for r in pair] + [_number(first.floor, 5)]
        cells += [f"{PAPER_FIGURES[class_name][task]:g}" if task in PAPER_FIGURES.get(class_name, {}) else ""]
        cells += [
            " / ".join(_percent(r.discrete_accuracy) for r in pair if r is not None and r.discrete_accuracy)
            for pair in figures
        ]
        shown = [r.visible_right for r in figures[-1] if r is not None and r.visible_right is not None]
        cells += [" / ".join(map(_percent, shown))]
        cells += ["; ".join(f"{r.method} {_figure(r)}" for r in here if r.method not in own)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _figure(row: Table1Row) -> str:
    """The figure of a row's task with the number of shapes it is the mean of."""
    if row.task == "spread":
        return f"{_number(row.d_chamfer, 4)}, {_number(row.d_voxel, 2)} % ({row.shapes})"
    value = f"{_number(row.d_voxel, 3)} %" if row.d_chamfer is None else _number(row.d_chamfer, 5)
    return f"{value} ({row.shapes})"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.1f} %"
