"""The bed model: canonical frame, parameters that do what their names say, sound meshes at every corner."""

import itertools

import numpy as np
import pytest
import trimesh

import procmodels
from datasets.voxels import surface_grid
from procmodels.paper import bed as model
from procmodels.parts.cushions import pillow

ENDS = {
    "width": (0.6, 1.6),
    "leg_height": (0.1, 0.3),
    "headboard_height": (0, 0.55),
    "footboard_height": (0, 0.55),
    "mattress_height": (0.1, 0.25),
    "legs": ("basic", "split", "box"),
    "pillows": (0, 1, 2),
}
BASE = {
    "width": 0.9,
    "leg_height": 0.2,
    "headboard_height": 0.4,
    "footboard_height": 0.2,
    "mattress_height": 0.15,
    "legs": "basic",
    "pillows": 2,
}
CORNERS = [dict(zip(ENDS, values, strict=True)) for values in itertools.product(*ENDS.values())]


@pytest.fixture(scope="module")
def bed():
    return procmodels.load("bed")


@pytest.fixture(scope="module")
def corners():
    """Every corner of the space with its parts by name, in the model's own unit."""
    return [(params, _parts(**params)) for params in CORNERS]


def _parts(**changes):
    return {p.name: p for p in model.build({**BASE, **changes})}


def _bounds(part):
    return part.vertices.min(0), part.vertices.max(0)


def test_the_space_is_the_papers(bed):
    assert bed.space.grid_size == 10_125
    assert [p.grid_steps for p in bed.space.parameters] == [5, 3, 5, 5, 3, 3, 3]
    assert {s.name: (s.low, s.high) for s in bed.space.scalars} == dict(list(ENDS.items())[:5])
    assert {p.name: p.values for p in bed.space.discrete} == dict(list(ENDS.items())[5:])


def test_every_corner_is_canonical(bed):
    for params in CORNERS:
        shape = bed.build(params)
        low, high = shape.bounds()
        assert (high - low).max() == pytest.approx(1)
        assert low + high == pytest.approx(0, abs=1e-9)
        assert len({p.name for p in shape.parts}) == len(shape.parts), "part names are unique"


def test_parts_are_closed_and_face_outwards(corners):
    checked = set()
    for params, parts in corners:
        for name, part in parts.items():
            key = (name, part.vertices.tobytes())
            if key in checked:
                continue
            checked.add(key)
            mesh = trimesh.Trimesh(part.vertices, part.triangles(), process=False)
            assert mesh.is_watertight, (params, name)
            assert mesh.is_winding_consistent, (params, name)
            assert mesh.volume > 0, (params, name)
            assert mesh.is_convex == part.convex, (params, name)


def test_every_part_touches_another_and_none_enters_another(corners):
    for params, parts in corners:
        boxes = [_bounds(p) for p in parts.values()]
        reached, todo = {0}, [0]
        while todo:
            i = todo.pop()
            for j, (low, high) in enumerate(boxes):
                # How far the two bounding boxes reach into each other along each axis; below 0 it is a gap.
                shared = np.minimum(boxes[i][1], high) - np.maximum(boxes[i][0], low)
                assert i == j or shared.min() < 1e-6, (params, list(parts)[i], list(parts)[j])
                if shared.min() > -1e-6 and j not in reached:
                    reached.add(j)
                    todo.append(j)
        assert len(reached) == len(boxes), params


def test_beds_are_symmetric_left_to_right(corners):
    for params, parts in corners[::7]:
        vertices = np.concatenate([p.vertices for p in parts.values()])
        there, mirrored = ({tuple(v) for v in np.rint(1e5 * vertices * [s, 1, 1]).astype(int)} for s in (1, -1))
        assert there == mirrored, params


def test_the_head_is_behind_and_the_legs_stand_on_the_floor(bed):
    for legs in ENDS["legs"]:
        shape = bed.build({**BASE, "legs": legs})
        middle = {p.name: p.vertices.mean(0)[1] for p in shape.parts}
        assert middle["headboard"] > middle["pillow 1"] > middle["mattress"] > middle["footboard"]
        feet = {round(p.vertices[:, 2].min() - shape.bounds()[0, 2], 9) for p in shape.parts if "leg" in p.name}
        assert feet == {0}


def test_width_and_leg_height_place_the_platform(corners):
    for params, parts in corners:
        low, high = _bounds(parts["platform"])
        assert high[0] - low[0] == pytest.approx(params["width"], abs=1e-6)
        assert low[2] == pytest.approx(params["leg_height"], abs=1e-6)
        legs = [p for name, p in parts.items() if name.startswith("leg")]
        assert max(p.vertices[:, 2].max() for p in legs) == pytest.approx(low[2], abs=1e-6)


@pytest.mark.parametrize("board", ["headboard", "footboard"])
def test_a_boards_height_is_counted_from_the_platform(board):
    for height in (0.001, 0.1375, 0.55):
        parts = _parts(**{f"{board}_height": height})
        assert np.ptp(parts[board].vertices[:, 2]) == pytest.approx(height, abs=1e-6)
        assert _bounds(parts[board])[0][2] == pytest.approx(_bounds(parts["platform"])[1][2], abs=1e-6)
    assert board not in _parts(**{f"{board}_height": 0})


def test_mattress_height_is_its_thickness():
    for height in (0.1, 0.18, 0.25):
        assert np.ptp(_parts(mattress_height=height)["mattress"].vertices[:, 2]) == pytest.approx(height, abs=1e-6)


@pytest.mark.parametrize(("legs", "count", "boards"), [("basic", 4, 0), ("split", 2, 2), ("box", 4, 4)])
def test_the_kinds_of_legs(legs, count, boards):
    found = [name for name in _parts(legs=legs) if name.startswith("leg")]
    assert len(found) == count
    assert sum("board" in name for name in found) == boards


def test_pillows_lie_on_the_mattress_by_the_headboard(corners):
    for params, parts in corners:
        pillows = [_bounds(p) for name, p in parts.items() if name.startswith("pillow")]
        assert len(pillows) == params["pillows"]
        soft_low, soft_high = _bounds(parts["mattress"])
        for low, high in pillows:
            assert low[2] == pytest.approx(soft_high[2], abs=1e-6)
            assert (low[:2] > soft_low[:2]).all()
            assert (high[:2] < soft_high[:2]).all()
            assert soft_high[1] - high[1] < 0.05 * model.LENGTH
        if len(pillows) == 2:
            assert pillows[0][1][0] < 0 < pillows[1][0][0], "side by side with a gap"


def test_neighbours_on_the_grid_differ(bed, rng):
    """No parameter may be lost anywhere: a step of any one changes the voxels."""
    for _ in range(2):
        params = bed.space.sample(rng, on_grid=True)
        for p in bed.space.parameters:
            grids = []
            for i in range(p.grid_steps):
                shape = bed.build({**params, p.name: p.grid_value(i)})
                grids.append(surface_grid(shape.vertices(), shape.triangles()))
            for a, b in itertools.combinations(grids, 2):
                assert (a != b).sum() > 100, (params, p.name)


def test_pillows_are_soft():
    part = pillow("pillow", (0.1, 0.2, 0.3), 0.5, 0.3, 0.1)
    low, high = _bounds(part)
    assert [*low, *high] == pytest.approx([-0.15, 0.05, 0.3, 0.35, 0.35, 0.4])
    mesh = trimesh.Trimesh(part.vertices, part.triangles(), process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 2
    assert 0.3 < mesh.volume / (0.5 * 0.3 * 0.1) < 0.7, "its rim is thinner than its middle"
    pressed = part.vertices[np.isclose(part.vertices[:, 2], 0.3)]
    assert (np.ptp(pressed[:, :2], axis=0) > [0.1, 0.06]).all(), "it lies on a face, not on a point"
