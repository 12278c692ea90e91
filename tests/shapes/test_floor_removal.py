"""A floor at any tilt goes, and what stands beside the object; objects without a floor stay whole."""

import cv2
import numpy as np
import pytest
import trimesh

from procmodels import load, names
from recon.geometry.triangles import Triangles
from recon.shapes import shape_target
from recon.shapes.floor_removal import without_floor
from recon.shapes.outlier_removal import CleaningOptions
from recon.shapes.shape_target import hypotheses

SHARE = CleaningOptions().floor_share
CHAIR, FLOOR, BOX = range(3)


def turned(degrees, axis=(1, 0.4, 0)):
    axis = np.array(axis) / np.linalg.norm(axis)
    return cv2.Rodrigues(np.radians(degrees) * axis)[0]


def scan(rng, clutter=True, from_side=True):
    """Points (n, 3) that a scanner in front of a chair sees, z up, and whose they are."""
    model = load("procmodels/classes/chair.py")
    params = {p.name: p.usual_value() for p in model.space.parameters} | {"arms": "posts"}
    shape = model.build(model.space.held(params))
    chair = shape.to_trimesh()
    ground = float(chair.bounds[0, 2])
    floor = trimesh.creation.box((3, 2.6, 0.01))
    floor.apply_translation((0.2, 0.3, ground - 0.005))
    box = trimesh.creation.box((0.35, 0.3, 0.4))
    box.apply_translation((1.0, 0.4, ground + 0.2))
    some = [(chair, CHAIR), (floor, FLOOR), *([(box, BOX)] if clutter else [])]
    points, owner = [], []
    for mesh, who in some:
        found = trimesh.sample.sample_surface(mesh, int(9000 * max(0.25, mesh.area / chair.area) ** 0.5), seed=1)[0]
        points.append(found)
        owner.append(np.full(len(found), who))
    points, owner = np.concatenate(points), np.concatenate(owner)
    if from_side:
        surface = Triangles(np.concatenate([m.triangles for m, _ in some]))
        import open3d as o3d

        eye = np.array([0.8, -2.5, 1.2])
        way = points - eye
        rays = np.concatenate([np.tile(eye, (len(way), 1)), way], 1).astype(np.float32)
        seen = surface.scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy() > 0.995
        points, owner = points[seen], owner[seen]
    return points + rng.normal(0, 0.002, points.shape), owner, ground


@pytest.mark.parametrize("from_side", [False, True])
@pytest.mark.parametrize("degrees", [0.0, 7.0, 25.0, 40.0])
def test_a_floor_that_leans_is_found_and_the_chair_stands_upright(rng, degrees, from_side):
    points, owner, ground = scan(rng, from_side=from_side)
    tilt = turned(degrees)
    found = without_floor(points @ tilt.T, ("z", "y"), SHARE, 0)
    assert found is not None
    off = found.level_from_input @ tilt
    assert np.degrees(np.arccos(off[2, 2])) < 1.0
    assert found.up == "z"
    known = {tuple(p): who for p, who in zip((points @ tilt.T).tolist(), owner, strict=True)}
    kept = np.array([known[tuple(p)] for p in found.points.tolist()])
    over = (owner == CHAIR) & (points[:, 2] > ground + 0.05)
    assert (kept == CHAIR).mean() > 0.98
    assert (kept == CHAIR).sum() > 0.97 * over.sum()
    assert ("leans" in found.said[0]) == (degrees > 0)
    assert "beside" in found.said[1]


@pytest.mark.parametrize("count", [600, 1500])
def test_a_floor_of_few_points_is_found(rng, count):
    points, owner, ground = scan(rng, clutter=False)
    some = rng.permutation(len(points))[:count]
    tilt = turned(20)
    found = without_floor(points[some] @ tilt.T, ("z",), SHARE, 0)
    assert found is not None
    assert np.degrees(np.arccos((found.level_from_input @ tilt)[2, 2])) < 2.0
    over = (owner[some] == CHAIR) & (points[some, 2] > ground + 0.05)
    assert 0.95 * over.sum() < len(found.points) < 1.1 * (owner[some] == CHAIR).sum()


@pytest.mark.parametrize("name", [n for n in names() if n != "sofa"])
def test_objects_without_a_floor_are_left_alone(name, rng):
    model = load(name)
    for _ in range(6):
        surface = Triangles.of(model.build(model.space.sample(rng)))
        points = surface.at(surface.places(4000))[0] @ turned(rng.uniform(0, 30), rng.normal(size=3)).T
        assert without_floor(points, ("z", "y"), SHARE, 0) is None


def test_a_chair_on_its_floor_is_the_target_upright(tmp_path, rng):
    points, _, _ = scan(rng)
    file = tmp_path / "scan.ply"
    trimesh.PointCloud(points @ turned(15).T * 700 + 40).export(file)
    target = shape_target.run(file, "cloud", "a point cloud")
    assert any("leans by 15 degrees" in w for w in target.warnings)
    assert target.ups == ("z",)
    ways = hypotheses(target)
    size = np.ptp(ways[0].points, axis=0)
    assert size[2] == pytest.approx(1, abs=0.02)
    assert size[:2].max() < 0.85
    for way in ways:  # what leads back to the file leads to the same points
        back = way.points @ way.input_from_canonical[:3, :3].T + way.input_from_canonical[:3, 3]
        np.testing.assert_allclose(back, target.points, atol=1e-6 * np.ptp(target.points))


def test_a_table_upside_down_is_no_object_on_a_floor(rng):
    """Its legs stand on its top: a floor lies at the lower end, unless an axis that points up says otherwise."""
    top = rng.uniform((-1, -1, 0.97), (1, 1, 1), (3000, 3))
    legs = np.concatenate(
        [rng.uniform((x, y, 0), (x + 0.1, y + 0.1, 1), (300, 3)) for x in (-0.5, 0.4) for y in (-0.5, 0.4)]
    )
    table = np.concatenate([top, legs])
    assert without_floor(table, ("z", "y"), SHARE, 0) is None
    assert without_floor(table * (1, 1, -1), ("z", "y"), SHARE, 0) is not None
