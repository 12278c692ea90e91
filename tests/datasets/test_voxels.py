"""Surface grids: every voxel a triangle touches, in the stated axes."""

import numpy as np
import pytest
import trimesh

from datasets.voxels import pack, point_grid, surface_grid, unpack, voxel_centres


def _box_grid(low, high):
    mesh = trimesh.creation.box(bounds=[low, high])
    return surface_grid(mesh.vertices, mesh.faces)


def test_a_box_is_its_skin():
    # Faces in the middle of voxels 8 and 40 along x, 20 and 30 along y, 4 and 60 along z.
    low, high = (np.array([8, 20, 4]) + 0.5) / 64 - 0.5, (np.array([40, 30, 60]) + 0.5) / 64 - 0.5
    expected = np.zeros((64, 64, 64), bool)
    expected[8:41, 20:31, 4:61] = True
    expected[9:40, 21:30, 5:60] = False
    assert (_box_grid(low, high) == expected).all()


def test_the_whole_cube_touches_every_side():
    grid = _box_grid([-0.5] * 3, [0.5] * 3)
    for axis in range(3):
        assert grid.take(0, axis).all()
        assert grid.take(63, axis).all()
    assert not grid[1:-1, 1:-1, 1:-1].any()


def test_thin_boards_survive():
    assert _box_grid([-0.5, -0.3, 0.1], [0.5, 0.3, 0.101]).any(2).sum() >= 64 * 38


def test_points_fall_into_the_voxel_of_their_centre(rng):
    index = rng.integers(0, 64, (200, 3))
    grid = point_grid(voxel_centres()[tuple(index.T)])
    assert grid[tuple(index.T)].all()
    assert grid.sum() == len(np.unique(index, axis=0))
    assert not point_grid(np.array([[2.0, 0, 0]])).any()


def test_mesh_points_lie_in_touched_voxels(chair, rng):
    for _ in range(3):
        mesh = chair.build(chair.space.sample(rng)).to_trimesh()
        grid = surface_grid(mesh.vertices, mesh.faces)
        points, _ = trimesh.sample.sample_surface(mesh, 20000, seed=1)
        assert not (point_grid(points) & ~grid).any()


def test_packing_round_trips(rng):
    grids = rng.random((3, 64, 64, 64)) < 0.1
    bits = pack(grids)
    assert bits.shape == (3, 32768)
    assert bits.dtype == np.uint8
    assert (unpack(bits) == grids).all()


def test_a_grid_without_triangles_is_empty():
    assert surface_grid(np.zeros((3, 3)) + 9, np.array([[0, 1, 2]])).sum() == pytest.approx(0)


def test_grids_read_through_a_file_are_the_same(rng, tmp_path):
    vertices = rng.uniform(-0.6, 0.6, (30, 3))
    triangles = rng.integers(0, 30, (20, 3))
    scratch = tmp_path / "voxels.ply"
    for _ in range(2):  # the second writes over the first
        assert (surface_grid(vertices, triangles, scratch=scratch) == surface_grid(vertices, triangles)).all()
    assert scratch.is_file()
    unwritable = tmp_path / "none" / "voxels.ply"
    assert (surface_grid(vertices, triangles, scratch=unwritable) == surface_grid(vertices, triangles)).all()
