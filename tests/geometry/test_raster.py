"""Silhouettes of shapes: exact at pixel centres, equal to ray casting, and quiet about what is behind the camera."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import procmodels
from procmodels.shape import Part, Shape
from recon.geometry.raster import coverage, iou, silhouettes

CUBE_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def cube(side: float = 0.5) -> Shape:
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * side / 2
    return Shape((Part("cube", corners, CUBE_FACES, convex=True),))


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(4, 4) cam_from_canonical, OpenCV axes, Z up."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ eye
    return matrix


def cameras(rng: np.random.Generator, n: int, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    eyes = rng.normal(size=(n, 3)) + np.array([0, 0, 0.5])
    eyes *= (rng.uniform(1.6, 2.4, n) / np.linalg.norm(eyes, axis=1))[:, None]
    poses = np.stack([look_at(eye, rng.uniform(-0.1, 0.1, 3)) for eye in eyes])
    K = np.tile(np.array([(1.3 * width, 0, width * 0.52), (0, 1.28 * width, height * 0.49), (0, 0, 1)]), (n, 1, 1))
    return K, poses, np.tile((width, height), (n, 1))


def projected(points: np.ndarray, K: np.ndarray, pose: np.ndarray) -> np.ndarray:
    pixels = (points @ pose[:3, :3].T + pose[:3, 3]) @ K.T
    return pixels[:, :2] / pixels[:, 2:]


def centres(width: int, height: int) -> np.ndarray:
    rows, columns = np.indices((height, width))
    return np.stack([columns, rows], -1).reshape(-1, 2) + 0.5


def ray_cast(shape: Shape, K: np.ndarray, pose: np.ndarray, size: np.ndarray) -> np.ndarray:
    width, height = size
    pixels = np.concatenate([centres(width, height), np.ones((width * height, 1))], 1)
    directions = pixels @ np.linalg.inv(K).T @ pose[:3, :3]
    origin = -pose[:3, :3].T @ pose[:3, 3]
    hit = np.zeros(len(pixels), bool)
    for a, b, c in shape.vertices()[
        shape.triangles()
    ]:  # Moeller and Trumbore; trimesh's caster needs a further package
        cross = np.cross(directions, c - a)
        determinant = cross @ (b - a)
        determinant[np.abs(determinant) < 1e-12] = np.nan
        u = cross @ (origin - a) / determinant
        v = directions @ np.cross(origin - a, b - a) / determinant
        hit |= (u >= 0) & (v >= 0) & (u + v <= 1)
    return hit.reshape(height, width)


def test_cube_is_the_hull_of_its_projected_corners():
    K, poses, sizes = cameras(np.random.default_rng(0), 8, 90, 70)
    for k, pose, mask in zip(K, poses, silhouettes(cube(), K, poses, sizes), strict=True):
        hull = ConvexHull(projected(cube().vertices(), k, pose))
        expected = (centres(90, 70) @ hull.equations[:, :2].T + hull.equations[:, 2] <= 0).all(1)
        assert mask.shape == (70, 90)
        assert mask.dtype == bool
        np.testing.assert_array_equal(mask.ravel(), expected)


def test_agrees_with_ray_casting_on_chairs():
    rng = np.random.default_rng(1)
    chair = procmodels.load("paper/chair")
    K, poses, sizes = cameras(rng, 3, 60, 48)
    for k, pose, size in zip(K, poses, sizes, strict=True):
        shape = chair.build(chair.space.sample(rng))
        mask = silhouettes(shape, k[None], pose[None], size[None])[0]
        assert iou(mask, ray_cast(shape, k, pose, size)) > 0.995


def test_winding_and_convexity_do_not_matter():
    K, poses, sizes = cameras(np.random.default_rng(2), 4, 60, 50)
    part = cube().parts[0]
    mixed = tuple(f[::-1] if i % 2 else f for i, f in enumerate(part.faces))
    soup = Shape((Part("soup", part.vertices, mixed),))
    for a, b in zip(silhouettes(cube(), K, poses, sizes), silhouettes(soup, K, poses, sizes), strict=True):
        np.testing.assert_array_equal(a, b)


def test_holes_stay_open():
    bars = [(-0.5, -0.3), (0.3, 0.5)]
    parts = tuple(cube(0.2).parts[0].moved(np.diag([1, 1, 5, 1]) + _shift(sum(b) / 2)) for b in bars)
    pose = look_at(np.array([0, -4.0, 0]), np.zeros(3))
    K = np.array([(100.0, 0, 25), (0, 100.0, 25), (0, 0, 1)])
    mask = silhouettes(Shape(parts), K[None], pose[None], np.array([(50, 50)]))[0]
    assert not mask[25, 25]
    assert mask[25, 15]
    assert mask[25, 35]


def _shift(x: float) -> np.ndarray:
    matrix = np.zeros((4, 4))
    matrix[0, 3] = x
    return matrix


def test_views_of_different_sizes_do_not_disturb_each_other():
    K, poses, sizes = cameras(np.random.default_rng(3), 3, 64, 48)
    sizes = np.array([(64, 48), (30, 48), (64, 20)])
    together = silhouettes(cube(), K, poses, sizes)
    for i, mask in enumerate(together):
        alone = silhouettes(cube(), K[i : i + 1], poses[i : i + 1], sizes[i : i + 1])[0]
        assert mask.shape == (sizes[i, 1], sizes[i, 0])
        np.testing.assert_array_equal(mask, alone)


def test_behind_the_camera_nothing_and_inside_everything():
    K = np.array([(50.0, 0, 25), (0, 50.0, 20), (0, 0, 1)])
    away = look_at(np.array([0, -3.0, 0]), np.array([0, -9.0, 0]))
    inside = look_at(np.array([0.01, 0.02, 0]), np.array([1.0, 0, 0.1]))
    front = look_at(np.array([0, -3.0, 0]), np.zeros(3))
    poses = np.stack([away, inside, front])
    masks = silhouettes(cube(), np.stack([K] * 3), poses, np.tile((50, 40), (3, 1)))
    assert not masks[0].any()
    assert masks[1].all()
    assert 0 < masks[2].mean() < 0.1


def test_partly_behind_the_camera_is_cut_not_mirrored():
    # A floor board that runs under the camera: it fills the lower half and nothing above the horizon.
    board = Shape((cube(1).parts[0].moved(np.diag([100.0, 100, 0.1, 1])),))
    K = np.array([(50.0, 0, 25), (0, 50.0, 20), (0, 0, 1)])
    pose = look_at(np.array([0, 0, 1.0]), np.array([0, 1.0, 1.0]))
    mask = silhouettes(board, K[None], pose[None], np.array([(50, 40)]))[0]
    assert not mask[:20].any()
    assert mask[22:].all()


def test_iou():
    a, b = np.zeros((4, 4), bool), np.zeros((4, 4), bool)
    assert iou(a, b) == 1
    a[:2], b[1:3] = True, True
    assert iou(a, b) == pytest.approx(1 / 3)
    with pytest.raises(ValueError, match="one shape"):
        iou(a, b[:2])


def test_one_camera_a_view_is_asked_for():
    K, poses, sizes = cameras(np.random.default_rng(3), 3, 64, 48)
    with pytest.raises(ValueError, match="2 sizes"):
        silhouettes(cube(), K, poses, sizes[:2])


def test_speed(capsys):
    rng = np.random.default_rng(4)
    chair = procmodels.load("paper/chair")
    shape = chair.build(chair.space.sample(rng))
    with capsys.disabled():
        for width, height in ((200, 150), (1000, 750)):
            K, poses, sizes = cameras(rng, 28, width, height)
            silhouettes(shape, K, poses, sizes)
            start = time.perf_counter()
            for _ in range(5):
                silhouettes(shape, K, poses, sizes)
            print(f" 28 views of {width} x {height}: {(time.perf_counter() - start) / 5 * 1e3:.1f} ms")  # noqa: T201


def test_coverage_is_the_silhouette_with_soft_edges(rng):
    model = procmodels.load("paper/chair")
    K, poses, sizes = cameras(rng, 6, 120, 100)
    shape = model.build(model.space.sample(rng))
    for hard, soft in zip(silhouettes(shape, K, poses, sizes), coverage(shape, K, poses, sizes), strict=True):
        assert soft.dtype == np.float32
        assert ((soft >= 0) & (soft <= 1)).all()
        assert np.mean((soft > 0.5) != hard) < 5e-3
        assert soft.sum() == pytest.approx(hard.sum(), rel=0.03)


def test_coverage_of_a_convex_shape_is_its_polygon():
    """The shares sum to the area of the hull of the projected corners, and each is what 32 x 32 pixel centres give."""
    K, poses, sizes = cameras(np.random.default_rng(5), 6, 90, 70)
    fine = K.copy()
    fine[:, :2] *= 32
    shares = coverage(cube(0.3), K, poses, sizes)
    for k, pose, share, sharp in zip(K, poses, shares, silhouettes(cube(0.3), fine, poses, sizes * 32), strict=True):
        assert max(share[[0, -1]].max(), share[:, [0, -1]].max()) < 1e-6, "the cube lies within the image"
        area = ConvexHull(projected(cube(0.3).vertices(), k, pose)).volume
        assert share.sum(dtype=float) == pytest.approx(area, abs=1e-3)
        counted = sharp.reshape(70, 32, 90, 32).mean((1, 3))
        np.testing.assert_allclose(share, counted, atol=0.03)


def test_coverage_of_a_shape_that_leaves_the_image():
    K, poses, sizes = cameras(np.random.default_rng(6), 4, 90, 70)
    K[:, :2, :2] *= 2
    fine = K.copy()
    fine[:, :2] *= 16
    for share, sharp in zip(
        coverage(cube(), K, poses, sizes), silhouettes(cube(), fine, poses, sizes * 16), strict=True
    ):
        counted = sharp.reshape(70, 16, 90, 16).mean((1, 3))
        assert np.abs(share - counted)[:, 1:].max() < 0.07
        assert np.abs(share - counted).mean() < 5e-4


@pytest.mark.parametrize("axis", [0, 1])
def test_coverage_grows_evenly_when_a_level_edge_moves(axis):
    """A cube seen from the front: its edges run along rows and columns, the hardest case for pixel centres."""
    pose = look_at(np.array([0, -3.0, 0]), np.zeros(3))
    K = np.array([(100.0, 0, 25), (0, 100.0, 25), (0, 0, 1)])[None]
    images = []
    for i in range(11):
        K[0, axis, 2] = 25 + i / 10
        images.append(coverage(cube(), K, pose[None], np.array([(50, 50)]))[0])
    # One edge enters a row (or column) of pixels while the opposite one leaves another: always as much a step.
    steps = np.abs(np.diff(images, axis=0)).sum((1, 2))
    assert steps == pytest.approx(np.full(10, steps.mean()), rel=0.02)


def test_coverage_moves_smoothly(rng):
    """A cube moved by a hundredth of a pixel changes the sum of shares by about that much of its outline's height."""
    K, poses, sizes = cameras(rng, 1, 120, 100)
    nudge = np.eye(4)
    nudge[:3, 3] = np.linalg.inv(poses[0])[:3, 0] * 1e-4
    moved = Shape(tuple(p.moved(nudge) for p in cube().parts))
    before, after = coverage(cube(), K, poses, sizes)[0], coverage(moved, K, poses, sizes)[0]
    assert 0 < np.abs(after - before).sum() < 2
