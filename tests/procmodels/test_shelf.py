"""The shelf model: counts, flags that always show, sound and separate parts all over the space."""

import itertools

import numpy as np
import pytest

import procmodels
from datasets.voxels import surface_grid

BASE = {
    "width": 1.2,
    "depth": 0.2,
    "leg_height": 0.1,
    "rows": 3,
    "columns": 2,
    "filled_back": False,
    "filled_sides": False,
    "filled_columns": False,
}
FLAGS = ("filled_back", "filled_sides", "filled_columns")


@pytest.fixture(scope="module")
def shelf():
    return procmodels.load("shelf")


def _corners():
    """Every combination of flags at every corner of the scalars and counts, in turn."""
    ends = itertools.product((0.2, 5.0), (0.1, 0.3), (0.0, 0.2), (1, 5), (1, 5))
    for numbers, flags in zip(ends, itertools.cycle(itertools.product((False, True), repeat=3)), strict=False):
        yield dict(zip(BASE, (*numbers, *flags), strict=True))
    for flags in itertools.product((False, True), repeat=3):
        yield dict(zip(BASE, (0.2, 0.1, 0.2, 5, 5, *flags), strict=True))
        yield dict(zip(BASE, (5.0, 0.1, 0.0, 5, 5, *flags), strict=True))


def _boxes(shelf, params):
    """(n, 2, 3): corners of the parts as built, all of them boxes."""
    return np.array([(p.vertices.min(0), p.vertices.max(0)) for p in shelf.build_parts(params)])


def _grid(shelf, params):
    shape = shelf.build(params)
    return surface_grid(shape.vertices(), shape.triangles())


def test_the_space_is_the_papers(shelf):
    assert shelf.space.grid_size == 14_400
    assert [(s.low, s.high, s.steps) for s in shelf.space.scalars] == [(0.2, 5, 8), (0.1, 0.3, 3), (0, 0.2, 3)]
    assert [p.name for p in shelf.space.parameters] == list(BASE)


def test_it_fills_its_size_and_stands_on_the_floor(shelf):
    for params in _corners():
        boxes = _boxes(shelf, params)
        w, d = params["width"], params["depth"]
        assert boxes[:, 0].min(0) == pytest.approx([-w / 2, -d / 2, 0], abs=1e-6), params
        assert boxes[:, 1].max(0) == pytest.approx([w / 2, d / 2, 1], abs=1e-6), params


def test_parts_are_closed_boxes_with_names_of_their_own(shelf):
    import trimesh

    for params in itertools.islice(_corners(), 0, None, 5):
        parts = shelf.build(params).parts
        assert len({p.name for p in parts}) == len(parts)
        for part in parts:
            mesh = trimesh.Trimesh(part.vertices, part.triangles(), process=False)
            assert mesh.is_watertight, (params, part.name)
            assert mesh.volume > 0, (params, part.name)
            assert part.convex


def test_no_part_floats(shelf):
    for params in _corners():
        boxes = _boxes(shelf, params)
        low, high = boxes[:, 0] - 5e-4, boxes[:, 1] + 5e-4
        touching = ((low[:, None] <= high[None]) & (low[None] <= high[:, None])).all(2)
        reached = touching[0]
        for _ in range(len(boxes)):
            reached = touching[reached].any(0)
        assert reached.all(), params


def test_no_part_pokes_into_another(shelf):
    for params in _corners():
        boxes = _boxes(shelf, params)
        shared = np.minimum(boxes[:, None, 1], boxes[None, :, 1]) - np.maximum(boxes[:, None, 0], boxes[None, :, 0])
        inside = (shared > 1e-6).all(2)
        assert not (inside & ~np.eye(len(boxes), dtype=bool)).any(), params


@pytest.mark.parametrize("rows", range(1, 6))
def test_boards_are_even_from_the_legs_to_the_top(shelf, rows):
    boards = [p for p in shelf.build_parts({**BASE, "rows": rows}) if p.name.startswith("board")]
    low = [p.vertices[:, 2].min() for p in boards]
    assert len(boards) == rows + 1
    assert low[0] == pytest.approx(0.1, abs=1e-6)
    assert np.diff(low) == pytest.approx(np.full(rows, 0.89 / rows), abs=1e-6)


@pytest.mark.parametrize("filled", [False, True])
@pytest.mark.parametrize("columns", range(1, 6))
def test_dividers_are_counted_and_even(shelf, columns, filled):
    parts = shelf.build_parts({**BASE, "columns": columns, "filled_columns": filled})
    places = {round(float(p.vertices[:, 0].mean()), 5) for p in parts if p.name.startswith("divider")}
    assert sorted(places) == pytest.approx([1.2 * ((i + 1) / (columns + 1) - 0.5) for i in range(columns)], abs=1e-5)


@pytest.mark.parametrize("flag", FLAGS)
def test_every_flag_shows_at_every_count(shelf, flag):
    for rows, columns in itertools.product(range(1, 6), repeat=2):
        params = {**BASE, "rows": rows, "columns": columns}
        differing = (_grid(shelf, params) ^ _grid(shelf, {**params, flag: True})).sum()
        assert differing > 40, (rows, columns)


@pytest.mark.parametrize("others", [False, True])
@pytest.mark.parametrize("flag", FLAGS)
def test_flags_show_on_the_longest_shelf(shelf, flag, others):
    """Two voxels deep: front and back posts would look like a filled side or divider there."""
    params = {**BASE, "width": 5.0, "depth": 0.1, **dict.fromkeys(FLAGS, others)}
    assert (_grid(shelf, {**params, flag: False}) ^ _grid(shelf, {**params, flag: True})).any()


@pytest.mark.parametrize("width", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("filled", [False, True])
def test_counts_show_in_the_grid(shelf, width, filled):
    for name in ("rows", "columns"):
        other = "columns" if name == "rows" else "rows"
        params = {**BASE, "width": width, other: 5, **dict.fromkeys(FLAGS, filled)}
        grids = [_grid(shelf, {**params, name: n}) for n in range(1, 6)]
        for a, b in itertools.combinations(grids, 2):
            assert (a ^ b).any(), name


def test_the_back_is_behind_and_the_front_is_open(shelf):
    params = {**BASE, **dict.fromkeys(FLAGS, True)}
    back = next(p for p in shelf.build_parts(params) if p.name == "back panel")
    assert back.vertices[:, 1].min() == pytest.approx(0.09, abs=1e-6)
    # Straight lines from the front meet nothing before the back in the middle of a bay.
    boxes = _boxes(shelf, params)
    x, z = 0.05, 0.1 + 0.89 / 6
    ahead = (boxes[:, 0, [0, 2]] < (x, z)).all(1) & (boxes[:, 1, [0, 2]] > (x, z)).all(1)
    assert ahead.sum() == 1


def test_shelves_are_symmetric_left_to_right(shelf):
    for params in _corners():
        vertices = shelf.build(params).vertices()
        nearest = np.abs(vertices[:, None] - (vertices * [-1, 1, 1])[None]).max(2).min(1)
        assert nearest.max() < 1e-6, params


def test_very_short_legs_leave_no_splinters(shelf):
    for height in (0.0, 1e-6, 1e-4):
        boxes = _boxes(shelf, {**BASE, "leg_height": height})
        assert (boxes[:, 1] - boxes[:, 0]).min() > 5e-3
