"""Derivatives of covered shares are those of the drawing itself: all classes, borders, cameras inside the object."""

from __future__ import annotations

import numpy as np
import pytest

import procmodels
from procmodels.shape import Part, Shape
from recon.geometry.raster import coverage, coverage_slopes, silhouettes

SIZE = np.tile((64, 48), (4, 1))
BOX = Part(
    "box",
    np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.3, 0.3) for z in (-0.4, 0.4)]),
    ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)),
)


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(4, 4) cam_from_shape, OpenCV axes, Z up."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0, 0, 1)) / np.linalg.norm(np.cross(forward, (0, 0, 1)))
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return matrix


def views(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """K and cam_from_shape of four views: round the object, so near that it leaves the image, or amid its parts."""
    K = np.tile(np.array([(83.0, 0.4, 33), (0, 82.0, 23.5), (0, 0, 1)]), (4, 1, 1))
    if kind == "amid":
        eyes = rng.uniform(-0.4, 0.4, (4, 3))
        K[:, :2, :2] *= 0.4
        return K, np.stack([look_at(e, -e + rng.uniform(-0.1, 0.1, 3)) for e in eyes])
    eyes = rng.normal(size=(4, 3)) + np.array([0, 0, 0.5])
    eyes *= 1.9 / np.linalg.norm(eyes, axis=1, keepdims=True)
    if kind == "border":
        K[:, :2, :2] *= 2.5
    return K, np.stack([look_at(e, rng.uniform(-0.1, 0.1, 3)) for e in eyes])


def displaced(shape: Shape, by: np.ndarray) -> Shape:
    """The shape with its vertices moved by (n, 3)."""
    ends = np.cumsum([len(p.vertices) for p in shape.parts])[:-1]
    parts = zip(shape.parts, np.split(by, ends), strict=True)
    return Shape(tuple(Part(p.name, p.vertices + d, p.faces, p.convex) for p, d in parts))


def shares(shape: Shape, K: np.ndarray, poses: np.ndarray) -> np.ndarray:
    return np.concatenate([image.ravel() for image in coverage(shape, K, poses, SIZE[: len(K)], dtype=np.float64)])


def differences(
    shape: Shape, velocity: np.ndarray, K: np.ndarray, poses: np.ndarray, h: float = 1e-6
) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of all shares along one motion of the vertices, and where they mean something: a pixel that
    two touching parts just fill has one derivative ahead and another behind."""
    here, ahead, behind = (shares(displaced(shape, s * h * velocity), K, poses) for s in (0, 1, -1))
    central = (ahead - behind) / (2 * h)
    return central, np.abs(ahead + behind - 2 * here) / h < 1e-3 * np.abs(central).max()


def exact(shape: Shape, velocities: np.ndarray, K: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """(pixels, k) derivatives of all shares."""
    _, slopes = coverage_slopes(shape, K, poses, SIZE[: len(K)])
    out = np.zeros((int(SIZE[: len(K)].prod(1).sum()), velocities.shape[-1]))
    out[slopes.pixels] = slopes.along(velocities)
    return out


@pytest.mark.parametrize("kind", ["round", "border", "amid"])
@pytest.mark.parametrize("name", ["bed", "chair", "shelf", "sofa", "table"])
def test_slopes_are_those_of_central_differences(name, kind):
    rng = np.random.default_rng([len(name), len(kind)])
    model = procmodels.load(name)
    shape = model.build(model.space.sample(rng))
    K, poses = views(kind, rng)
    vertices = shape.vertices()
    # All vertices together, as parameters move them, and each by itself.
    velocities = np.stack(
        [vertices @ rng.normal(size=(3, 3)) + rng.normal(size=3), rng.normal(size=vertices.shape)], -1
    )
    found = exact(shape, velocities, K, poses)
    for k in range(2):
        expected, smooth = differences(shape, velocities[..., k], K, poses)
        assert np.abs(expected).max() > 1, "something moves"
        assert (~smooth).sum() < 0.01 * (expected != 0).sum()
        assert np.linalg.norm((found[:, k] - expected)[smooth]) < 1e-5 * np.linalg.norm(expected)


def test_views_that_move_by_themselves():
    """Velocities a view apart are those of each view alone."""
    rng = np.random.default_rng(3)
    shape = Shape((BOX,))
    K, poses = views("round", rng)
    velocities = rng.normal(size=(4, 8, 3, 2))
    together = exact(shape, velocities, K, poses).reshape(4, -1, 2)
    for v in range(4):
        np.testing.assert_allclose(together[v], exact(shape, velocities[v], K[v : v + 1], poses[v : v + 1]), atol=1e-9)


def test_level_edges_move_rows():
    """A box seen straight on: raising its top edge by a pixel's worth fills the row above."""
    pose = look_at(np.array([0, -3.0, 0]), np.zeros(3))[None]
    K = np.array([(81.0, 0, 32.3), (0, 81.0, 24.2), (0, 0, 1)])[None]
    top = np.zeros((8, 3, 1))
    top[BOX.vertices[:, 2] > 0, 2] = 1
    found = exact(Shape((BOX,)), top, K, pose)
    # The front side, 2.7 away, is the larger: 30 pixels wide, its edge rises 30 pixels a unit.
    assert found.sum() == pytest.approx(30 * 30, rel=1e-9)
    assert found[:, 0] == pytest.approx(differences(Shape((BOX,)), top[..., 0], K, pose)[0], abs=1e-5)


def test_full_pixels_do_not_change():
    """A small box before a larger one: nothing that it does is seen."""
    small = Part("small", BOX.vertices * 0.3 + (0, -0.6, 0), BOX.faces)
    K, poses = (
        np.array([(81.0, 0, 32), (0, 81.0, 24), (0, 0, 1)])[None],
        look_at(np.array([0, -3.0, 0]), np.zeros(3))[None],
    )
    motion = np.zeros((16, 3, 1))
    motion[8:] = np.random.default_rng(0).normal(size=(8, 3, 1))
    assert not exact(Shape((BOX, small)), motion, K, poses).any()


@pytest.mark.parametrize("name", ["chair", "bed"])
def test_shares_amid_the_parts_are_those_of_many_pixel_centres(name):
    rng = np.random.default_rng(5)
    model = procmodels.load(name)
    shape = model.build(model.space.sample(rng))
    K, poses = views("amid", rng)
    fine = K.copy()
    fine[:, :2] *= 16
    seen = 0.0
    for share, sharp in zip(coverage(shape, K, poses, SIZE), silhouettes(shape, fine, poses, SIZE * 16), strict=True):
        counted = sharp.reshape(48, 16, 64, 16).mean((1, 3))
        assert np.abs(share - counted).mean() < 0.01, "shares are added where outlines cross in a pixel"
        assert np.median(np.abs(share - counted)) < 1e-6
        seen += float(share.mean())
    assert 0.2 < seen < 3.8


def test_a_camera_in_a_part_sees_nothing_else():
    inside = look_at(np.array([0.01, 0.02, 0]), np.array([1.0, 0, 0.1]))[None]
    K = np.array([(50.0, 0, 32), (0, 50.0, 24), (0, 0, 1)])[None]
    assert (coverage(Shape((BOX,)), K, inside, SIZE[:1])[0] == 1).all()
    away = look_at(np.array([0, -3.0, 0]), np.array([0, -9.0, 0]))[None]
    assert not coverage(Shape((BOX,)), K, away, SIZE[:1])[0].any()
    _, slopes = coverage_slopes(Shape((BOX,)), K, away, SIZE[:1])
    assert slopes.along(np.ones((8, 3, 1))).shape == (0, 1)
