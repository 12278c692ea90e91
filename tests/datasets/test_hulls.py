"""Visual hulls of generated shapes: they hold what cast the silhouettes, and no more than every view allows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion

from datasets.hulls import HullOptions, carve, hull, silhouette, skin, solid_hull, windows
from datasets.voxels import surface_grid, voxel_centres
from procmodels.classes import chair
from procmodels.parts.primitives import box
from procmodels.shape import Part, Shape, normalised

EXACT = HullOptions(agreement=1.0, shaky=0.0)
ALL = np.ones((3, 3, 3), bool)


@pytest.fixture(scope="module")
def table():
    legs = [box("leg", (x, y, 0), (x + 0.1, y + 0.1, 0.7)) for x in (0, 0.9) for y in (0, 0.5)]
    return normalised([*legs, box("top", (0, 0, 0.7), (1.0, 0.6, 0.8))])


def _surface(shape):
    return surface_grid(shape.vertices(), shape.triangles())


@pytest.mark.parametrize("seed", range(4))
def test_a_hull_holds_the_shape(table, seed):
    solid = solid_hull(table, np.random.default_rng(seed), EXACT)
    assert not (_surface(table) & ~binary_dilation(solid, ALL)).any()
    for part in table.parts:
        centres, (low, high) = voxel_centres(), (part.vertices.min(0), part.vertices.max(0))
        assert solid[((centres > low) & (centres < high)).all(-1)].all(), "the inside"


@pytest.mark.parametrize("seed", range(4))
def test_a_rich_chair_lies_in_its_hull_but_for_slivers(seed):
    rng = np.random.default_rng(seed)
    shape = normalised(chair.build(chair.SPACE.sample(rng)))
    surface, solid = _surface(shape), solid_hull(shape, rng, EXACT)
    assert (surface & ~binary_dilation(solid, ALL)).sum() < 0.03 * surface.sum()


def test_more_views_leave_less(table):
    cameras = windows(np.random.default_rng(1), replace(EXACT, views=(12, 12)))
    masks = [silhouette(table, c, EXACT.pixels) for c in cameras]
    few, many = carve(cameras[:4], masks[:4]), carve(cameras, masks)
    assert not (many & ~few).any()
    assert many.sum() < few.sum()
    forgiving = carve(cameras, masks, agreement=0.85)
    assert not (many & ~forgiving).any()


def test_carving_counts_the_views_that_see_a_voxels_centre_as_object(rng):
    cameras = windows(rng, replace(EXACT, views=(6, 6)))
    size = EXACT.pixels
    masks = [(rng.random((8, 8)) < 0.7).repeat(size // 8, 0).repeat(size // 8, 1).astype(np.uint8) for _ in cameras]
    centres = voxel_centres()
    votes = np.zeros((64,) * 3, int)
    for camera, mask in zip(cameras, masks, strict=True):
        x, y, depth = np.moveaxis(centres @ camera[:, :3].T + camera[:, 3], -1, 0)
        assert (depth > 0).all()
        column, row = np.floor(x / depth).astype(int), np.floor(y / depth).astype(int)
        assert ((column >= 0) & (row >= 0) & (column < size) & (row < size)).all(), "windows hold the cube"
        votes += mask[row, column]
    # Centres on the border of two pixels may fall into either.
    assert (carve(cameras, masks) != (votes == 6)).mean() < 1e-4
    assert (carve(cameras, masks, 0.5) != (votes >= 3)).mean() < 1e-4


def test_outlines_of_convex_parts_are_those_of_their_faces(table, rng):
    (camera, *_) = windows(rng, EXACT)
    faces = Shape(tuple(Part(p.name, p.vertices, p.faces, convex=False) for p in table.parts))
    by_hull, by_faces = (silhouette(s, camera, 192).astype(bool) for s in (table, faces))
    assert by_hull.any()
    assert (by_hull ^ by_faces).sum() < 0.01 * by_hull.sum()


def test_a_skin_is_what_touches_the_empty(rng):
    solid = rng.random((64, 64, 64)) < 0.97
    assert (skin(solid) == (solid & ~binary_erosion(solid, ALL))).all()


def test_cameras_stand_as_asked():
    options = replace(EXACT, low=0.0, distances=(2.0, 3.0))
    for seed in range(20):
        cameras = windows(np.random.default_rng(seed), options)
        assert 4 <= len(cameras) <= 24
        centres = np.array([-np.linalg.solve(c[:, :3], c[:, 3]) for c in cameras])
        distance = np.linalg.norm(centres, axis=1)
        assert 2.0 - 1e-6 <= distance[0] <= 3.0 + 1e-6
        assert np.ptp(distance) < 1e-6
        elevation = np.degrees(np.arcsin(centres[:, 2] / distance))
        assert -10 < elevation.min() <= elevation.max() < 65  # strays are normal, three degrees


def test_shaky_hulls_are_still_near_and_all_depend_on_the_rng_alone(table):
    surface = _surface(table)
    for seed in range(4):
        shaky = replace(HullOptions(), shaky=1.0)
        once, again, exact = (
            hull(table, np.random.default_rng(seed), o) for o in (shaky, shaky, replace(shaky, shaky=0.0))
        )
        assert (once == again).all()
        assert (once != exact).any()
        near = binary_dilation(surface, ALL, iterations=5)
        assert (once & near).sum() > 0.5 * once.sum()
        assert (surface & binary_dilation(once, ALL, iterations=3)).sum() > 0.7 * surface.sum()
