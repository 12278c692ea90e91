"""Table 1 as a command: rows of the promised shape, kept between runs, merged into JSON by name. Two shapes only."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procmodels import load
from recon.evaluate import __main__ as command
from recon.evaluate.data.held_out import Case
from recon.evaluate.tables import table1, table1_rows
from recon.evaluate.tables.table1 import Table1Options
from recon.evaluate.tables.table1_rows import Table1Row

KEYS = [
    "class",
    "grid",
    "task",
    "method",
    "shapes",
    "d_chamfer",
    "floor",
    "d_voxel",
    "discrete_accuracy",
    "scalar_error",
    "seconds",
    "visible_right",
]


@pytest.fixture(scope="module")
def options(tmp_path_factory):
    work = tmp_path_factory.mktemp("evaluate")
    return Table1Options(shapes=2, methods=("spread", "ours"), tasks=("1", "2"), grids=("on",), work=work)


@pytest.fixture(scope="module")
def rows(options):
    return list(table1.run(["chair"], options))


def test_rows_have_the_promised_keys(rows):
    assert [(r.task, r.method) for r in rows] == [("spread", "spread"), ("1", "ours"), ("2", "ours")]
    for row in rows:
        assert list(row.as_json()) == KEYS
        assert (row.as_json()["class"], row.grid, row.shapes) == ("chair", "on", 2)


def test_each_task_fills_its_own_measures(rows):
    spread, shape, direct = rows
    assert spread.d_chamfer > 1e-3
    assert spread.floor is None
    assert spread.seconds is None
    assert 0 < shape.d_voxel < 1
    assert shape.seconds > 0
    assert shape.d_chamfer is None
    assert direct.d_chamfer < 2 * direct.floor
    assert direct.discrete_accuracy == 1
    assert 0 <= direct.scalar_error < 0.1
    assert direct.seconds > 0


def test_a_choice_that_the_masks_hide_does_not_count():
    model = load("shelf")
    true = {p.name: p.grid_value(0) for p in model.space.discrete}
    true |= {s.name: s.value_from_unit(0.5) for s in model.space.scalars} | {"rows": 2, "columns": 2}
    true |= {"filled_sides": True, "filled_back": True}
    shape = model.build(true)
    case = Case(true, shape, shape.to_trimesh(), np.zeros((64,) * 3, bool))
    right = table1._visible_right(model, "4 spread", [true], [case])
    boards_behind_walls = table1._visible_right(model, "4 spread", [{**true, "rows": 5}], [case])
    open_sides = table1._visible_right(model, "4 spread", [{**true, "filled_sides": False}], [case])
    assert right == 1
    assert open_sides < boards_behind_walls


def test_a_kept_row_is_not_measured_again(rows, options, monkeypatch):
    def refuse(*_):
        raise AssertionError("measured again")

    monkeypatch.setattr(table1, "_measured", refuse)
    assert list(table1.run(["chair"], options)) == rows
    with pytest.raises(AssertionError, match="again"):
        list(table1.run(["chair"], replace(options, shapes=3)))


def test_a_row_in_json_takes_the_place_of_its_namesake(tmp_path):
    path = tmp_path / "deep" / "rows.json"
    first = [Table1Row("chair", "on", task, "ours", 2, d_voxel=1.0) for task in ("1", "2")]
    command._add_rows(path, first)
    command._add_rows(path, [Table1Row("chair", "on", "1", "ours", 5, d_voxel=0.5)])
    command._add_rows(path, [Table1Row("chair", "off", "1", "ours", 2, d_voxel=0.7)])
    written = json.loads(path.read_text())
    assert [(r["grid"], r["task"], r["shapes"], r["d_voxel"]) for r in written] == [
        ("on", "1", 5, 0.5),
        ("on", "2", 2, 1.0),
        ("off", "1", 2, 0.7),
    ]
    assert all(list(r) == KEYS for r in written)
    assert [p.name for p in path.parent.iterdir()] == ["rows.json"], "nothing half-written is left"


def test_the_command_prints_and_writes(rows, options, tmp_path, capsys):
    path = tmp_path / "rows.json"
    arguments = ["table1", "--class", "chair", "--shapes", "2", "--task", "1", "--method", "ours", "--grid", "on"]
    assert command.main([*arguments, "--work", str(options.work), "--json", str(path)]) == 0
    assert json.loads(path.read_text()) == [rows[1].as_json()]
    assert "| chair | on | 1 | ours | 2 |" in capsys.readouterr().out


def test_senseless_numbers_of_shapes_are_refused(capsys):
    for count in ("1", "301"):
        assert command.main(["table1", "--class", "chair", "--shapes", count]) == 2
        assert "2 to 300" in capsys.readouterr().err


def test_the_papers_figure_stands_beside_ours_alone():
    ours = Table1Row("table", "on", "2", "ours", 2, d_chamfer=0.00021, floor=0.0001)
    text = table1_rows.markdown([ours, replace(ours, grid="off"), replace(ours, method="cobyqa")])
    assert [line.count("0.0003") for line in text.splitlines()[2:]] == [1, 0, 0]


def test_the_readme_prints_the_kept_results():
    root = Path(__file__).parents[2]
    rows = [Table1Row.from_json(r) for r in json.loads((root / "docs/results/table1.json").read_text())]
    assert all(r.shapes <= 300 for r in rows)
    assert table1_rows.compact(rows) in (root / "docs/results.md").read_text()
