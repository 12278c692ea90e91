"""The `speed` command on sizes that take seconds: its rows, files and counts. No test asserts a time."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import nn

from nnproc.latent_fit import FitOptions
from recon.evaluate import __main__ as command
from recon.evaluate.data import held_out
from recon.evaluate.speed import command as speed
from recon.evaluate.speed import limits, pairs
from recon.evaluate.speed.growth import operator_bytes, orbit, step_mb
from recon.evaluate.speed.rows import (
    GROWTH,
    LIMIT,
    STAGE,
    Side,
    SpeedOptions,
    SpeedRow,
    in_turn,
    quick,
    read_rows,
    write_rows,
)

KEYS = ["what", "against", "ratio", "seconds", "against_seconds"]


@pytest.fixture(scope="module")
def options(tmp_path_factory):
    return SpeedOptions(
        repeats=1,
        least=0.0,
        size=8,
        samples=(4, 6),
        fit=FitOptions(bank=0, starts=2, keep=1, prune_at=1, steps=2),
        published_steps=1,
        latents=1,
        view_size=8,
        views=(1, 2, 4),
        sides=(4, 8),
        starts=(1, 2),
        grids=(8, 16),
        jacobian_views=2,
        jacobian_size=24,
        copied_mb=1,
        matrix=32,
        command=False,
        work=tmp_path_factory.mktemp("evaluate"),
    )


@pytest.fixture(scope="module")
def rows(options):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(held_out, "BANK", 8)
        patch.setattr(limits, "PHOTO_VIEWS", 2)
        patch.setattr("recon.evaluate.tables.methods.EVALUATIONS", 20)
        return list(speed.run(options))


def test_rows_have_the_promised_keys_and_ratio(rows):
    for row in rows:
        values = row.as_json()
        assert list(values) == KEYS + ["memory_mb"] * row.what.startswith(GROWTH)
        assert values["seconds"] > 0
        assert values["ratio"] == pytest.approx(values["against_seconds"] / values["seconds"])


def test_every_comparison_has_its_rows(rows):
    wanted = {"silhouettes": 2, "latent fit": 1, "Task 4": 2, "derivatives": 2, GROWTH: 9, LIMIT: 6}
    kinds = [k for r in rows for k in wanted if r.what.startswith(k)]
    assert kinds == [k for k, count in wanted.items() for _ in range(count)]
    assert len({(r.what, r.against) for r in rows}) == len(rows)


def test_each_growth_starts_at_itself_and_takes_ever_more_memory(rows):
    grown = [r for r in rows if r.what.startswith(GROWTH)]
    for first in dict.fromkeys(r.against for r in grown):
        same = [r for r in grown if r.against == first]
        assert same[0].what.endswith(first)
        assert same[0].ratio == 1
        assert [r.memory_mb for r in same] == sorted({r.memory_mb for r in same})


def test_exact_derivatives_are_those_that_finite_differences_find(rows):
    said = [float(r.against.split()[-4]) for r in rows if r.what.startswith("derivatives")]
    assert len(said) == 2
    assert max(said) < 3e-3


def test_memory_counts_both_orders_of_the_matrix():
    few, many = orbit(2, 8), orbit(4, 8)
    assert operator_bytes(many) > operator_bytes(few) >= 2 * 8 * len(few.weight.values())
    assert step_mb(few, 3) - step_mb(few, 1) == pytest.approx(2 * 2 * 4 * (64**3 + few.n_rays) / 1e6)


def test_the_published_decoder_has_full_resolution():
    decoder = pairs.PublishedDecoder()
    with torch.no_grad():
        assert decoder(torch.zeros(2, 128)).shape == (2, 64, 64, 64)
    kernels = [m.kernel_size for m in decoder.modules() if isinstance(m, nn.Conv3d)]
    assert kernels == [(3, 3, 3)] * 6


def test_operations_are_two_a_product():
    net = nn.Sequential(nn.Conv3d(2, 3, 3, padding=1), nn.ReLU(), nn.Flatten(), nn.Linear(3 * 8, 5))
    assert limits.operations(net, torch.zeros(4, 2, 2, 2, 2)) == 4 * 2 * (8 * 3 * 2 * 27 + 24 * 5)
    assert not any(m._forward_hooks for m in net)


def test_sides_take_turns_after_a_warm_up():
    seen: list[str] = []
    sides = [Side(lambda: seen.append("a")), Side(lambda: seen.append("b"), warm=lambda: seen.append("warm b"))]
    assert len(in_turn(sides, 3, 0)) == 2
    assert seen == ["a", "warm b", *"ababab"]


def test_a_side_is_scaled(monkeypatch):
    clock = iter(range(100))
    monkeypatch.setattr("recon.evaluate.speed.rows.time.process_time", lambda: float(next(clock)))
    once, scaled = in_turn([Side(int), Side(int, scale=20)], 1, 0)
    assert scaled == 20 * once


def test_json_is_written_whole_and_read_again(rows, tmp_path):
    path = tmp_path / "deep" / "speed.json"
    write_rows(rows, path)
    assert read_rows(path) == rows
    assert [p.name for p in path.parent.iterdir()] == ["speed.json"], "nothing half-written is left"


def test_stages_stand_against_the_total():
    rows = limits.stage_rows({"poses": 6.0, "align": 0.0, "total": 12.0})
    assert [(r.what, r.ratio) for r in rows] == [(f"{STAGE}poses", 2), (f"{STAGE}align", 1200), (f"{STAGE}total", 1)]


def test_the_short_table_keeps_the_largest_of_each_growth():
    grown = [SpeedRow(f"{GROWTH}{n}", first, 1, 1, 8.0) for first, n in (("a", 1), ("a", 2), ("b", 3), ("b", 4))]
    rows = [SpeedRow("fit", "other", 1, 25), *grown, SpeedRow(f"{STAGE}fit", "all", 1, 2)]
    text = speed.compact(rows)
    assert [line.split(" | ")[0] for line in text.splitlines()[2:]] == ["| fit", f"| {GROWTH}2", f"| {GROWTH}4"]
    assert "| fit | other | 25.0 | 1.00 | 25.0 |  |" in text


def test_the_command_prints_and_writes(rows, options, tmp_path, capsys, monkeypatch):
    asked = []
    monkeypatch.setattr(speed, "run", lambda o: asked.append(o) or iter(rows))
    path = tmp_path / "speed.json"
    arguments = ["speed", "--repeats", "3", "--work", str(options.work), "--json", str(path)]
    assert command.main(arguments) == 0
    assert command.main([*arguments, "--quick"]) == 0
    assert asked == [SpeedOptions(repeats=3, work=options.work), quick(asked[0])]
    assert asked[0].command
    assert not asked[1].command
    assert json.loads(path.read_text()) == [r.as_json() for r in rows]
    assert f"| {rows[0].what} | {rows[0].against} |" in capsys.readouterr().out
    assert command.main(["speed", "--show", str(path)]) == 0
    assert capsys.readouterr().out == speed.compact(rows)


def test_senseless_numbers_are_refused(options, capsys):
    assert command.main(["speed", "--repeats", "0"]) == 2
    assert "at least 1" in capsys.readouterr().err
    with pytest.raises(ValueError, match="divide"):
        pairs.subject(replace(options, size=100))


def test_the_readme_prints_the_kept_results():
    root = Path(__file__).parents[2]
    assert speed.compact(read_rows(root / "docs/results/speed.json")) in (root / "docs/results.md").read_text()
