"""Disturbed grids: each mishap does what its name says and no more; all depend on the rng alone."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, distance_transform_edt

from datasets.disturbed import DamageOptions, SplatOptions, boxed, damaged, met, moved, splat, stretched
from datasets.voxels import point_grid, spacing_of, splat_grid, surface_grid
from procmodels.parts.primitives import box
from procmodels.shape import normalised

ALL = np.ones((3, 3, 3), bool)
CLEAN = SplatOptions(points=(4000, 5000), one_sided=0.0, noise=0.0)


@pytest.fixture(scope="module")
def grid():
    legs = [box("leg", (x, y, 0), (x + 0.1, y + 0.1, 0.7)) for x in (0, 0.9) for y in (0, 0.5)]
    shape = normalised([*legs, box("top", (0, 0, 0.7), (1.0, 0.6, 0.8))])
    return surface_grid(shape.vertices(), shape.triangles())


def _only(name, value):
    """Damage of one kind, which happens always."""
    none = {f.name: (0.0, *v[1:]) if isinstance(v := f.default, tuple) else 0.0 for f in fields(DamageOptions)}
    return DamageOptions(**{**none, name: value})


@pytest.mark.parametrize("seed", range(5))
def test_a_splat_lies_on_the_surface(grid, seed):
    found = splat(grid, np.random.default_rng(seed), CLEAN)
    assert not (found & ~binary_dilation(grid, ALL)).any()
    assert (grid & binary_dilation(found, ALL)).sum() > 0.95 * grid.sum(), "and covers it"


def test_noise_moves_points_by_no_more_than_a_few_of_its_spreads(grid, rng):
    found = splat(grid, rng, replace(CLEAN, noise=0.01))
    assert distance_transform_edt(~grid)[found].max() < 1 + 64 * 0.01 * 5


def test_one_side_is_less_than_all(rng):
    shell = np.zeros((64, 64, 64), bool)
    shell[8:56, 8:56, 8:56] = True
    shell[9:55, 9:55, 9:55] = False
    seen = splat(shell, rng, replace(CLEAN, one_sided=1.0, points=(20_000, 20_001)))
    whole = splat(shell, rng, replace(CLEAN, points=(20_000, 20_001)))
    assert 0.2 * whole.sum() < seen.sum() < 0.65 * whole.sum()


@pytest.mark.parametrize(("count", "spread"), [(4000, 0.3), (600, 0.3), (300, 0.4), (30, 0.4)])
def test_splats_are_balls_peeled_to_their_middles(count, spread, rng):
    """The definition by distance transforms; balls of all sizes, up to those that are found by one."""
    points = np.clip(rng.normal(size=(count, 3)) * spread / 2, -0.5, 0.5)
    spacing = spacing_of(points)
    radius = 64 * 1.6 * spacing
    filled = point_grid(points)
    expected = filled
    if radius >= 1.5:
        balls = distance_transform_edt(~filled) <= radius
        expected = (distance_transform_edt(balls) > 0.7 * radius) | filled
    assert (splat_grid(points, spacing) == expected).all()


@pytest.mark.parametrize("seed", range(5))
def test_mishaps_do_what_they_say(grid, seed):
    def of(name, value):
        return damaged(grid, np.random.default_rng(seed), _only(name, value))

    for name, value, most in (
        ("dropped", (1.0, 0.4), 0.42),
        ("holes", (1.0, 4, 9.0), 1.0),
        ("cut", (1.0, 0.2), 0.21),
        ("chunk", (1.0, 0.3), 0.31),
    ):
        found = of(name, value)
        assert not (found & ~grid).any(), name
        assert 0 < (grid & ~found).sum() <= most * grid.sum(), name
    chunk = np.argwhere(grid & ~of("chunk", (1.0, 0.3)))
    assert np.ptp(chunk, axis=0).max() <= 48
    specks = of("specks", (1.0, 0.04))
    assert not (grid & ~specks).any()
    assert (specks & ~grid).sum() <= 0.04 * grid.sum()
    thick = of("thick", 1.0)
    assert (thick == binary_dilation(grid)).all()
    off = of("moved", (1.0, 1))
    assert any((off == moved(grid, np.array(s) - 1)).all() for s in np.ndindex(3, 3, 3))
    scaled = of("scaled", (1.0, 0.04))
    for a, b in zip(np.ptp(np.argwhere(grid), axis=0), np.ptp(np.argwhere(scaled), axis=0), strict=True):
        assert abs(a - b) <= 0.04 * 64 + 1


def test_damage_leaves_something_and_depends_on_the_rng_alone(grid):
    single = np.zeros_like(grid)
    single[20, 30, 40] = True
    changed = 0
    for seed in range(30):
        once, again = (damaged(grid, np.random.default_rng(seed)) for _ in range(2))
        assert (once == again).all()
        changed += (once != grid).any()
        assert damaged(single, np.random.default_rng(seed)).any()
        assert (splat(grid, np.random.default_rng(seed)) == splat(grid, np.random.default_rng(seed))).all()
    assert changed > 20


def test_moves_and_boxes(grid):
    there = moved(grid, np.array([1, 0, -1]))
    assert (there[1:, :, :-1] == grid[:-1, :, 1:]).all()
    assert not there[0].any()
    assert not there[:, :, -1].any()
    assert (stretched(grid, np.ones(3)) == grid).all()

    small = stretched(grid, np.full(3, 0.5))
    whole = boxed(small)
    where = np.argwhere(whole)
    assert np.ptp(where, axis=0).max() == 63
    assert np.abs(where.min(0) + where.max(0) - 63).max() <= 2, "centred"
    assert (boxed(whole) == whole).all()


def test_a_hull_is_met_as_it_is_or_in_its_own_box(grid):
    small = stretched(grid, np.full(3, 0.8))
    kinds = set()
    for seed in range(20):
        found = met(small, np.random.default_rng(seed))
        for i, kind in enumerate((small, boxed(small), binary_dilation(boxed(small)))):
            if (found == kind).all():
                kinds.add(i)
    assert kinds == {0, 1, 2}
