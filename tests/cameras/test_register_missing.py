"""Photos that a camera file leaves out follow the similarity between its frame and that of structure from motion."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from nnproc.rays import look_at_cameras
from recon.cameras import register_missing
from recon.evaluate.data.scenes import misaligned
from recon.scene import Cameras, Canonical, Poses

SHIPPED = Path(__file__).parents[2] / "datasets" / "samples" / "chair"


def poses_of(names, world=np.eye(4)) -> Poses:
    """Cameras on a circle, named by their number, seen from another world frame."""
    K, place = (t.numpy() for t in look_at_cameras([30.0 * int(n) for n in names], [20.0] * len(names), 2.5, 40, 400))
    scale = np.cbrt(np.linalg.det(world[:3, :3]))
    moved = place @ np.linalg.inv(world)
    moved[:, :3] = scale * moved[:, :3]
    cameras = Cameras(tuple(names), K, moved, np.tile([400, 400], (len(names), 1)))
    points = np.zeros((2, 3))
    return Poses(cameras, tuple(map(Path, names)), points, np.ones((2, len(names)), bool))


@pytest.fixture
def elsewhere():
    out = np.eye(4)
    out[:3, :3] = 3.7 * cv2.Rodrigues(np.array([0.4, -1.1, 0.3]))[0]
    out[:3, 3] = (5, -2, 1)
    return out


def test_added_cameras_lie_where_they_should(elsewhere):
    given = replace(poses_of("01256"), unregistered=("3", "4", "x"))
    full = register_missing.merged(given, poses_of("0123456", elsewhere))
    assert full.cameras.names == tuple("0125634")
    truth = poses_of("0125634").cameras
    assert np.allclose(full.cameras.cam_from_world, truth.cam_from_world, atol=1e-9)
    assert np.array_equal(full.cameras.cam_from_world[:5], given.cameras.cam_from_world)
    assert full.unregistered == ("x",)
    assert full.tracks.shape == (2, 7)
    assert not full.tracks[:, 5:].any()
    assert len(full.paths) == len(full.lenses) == 7


def test_frames_that_disagree_are_not_mixed(elsewhere):
    given, found = replace(poses_of("01256"), unregistered=("3",)), poses_of("0123456", elsewhere)
    wrong = found.cameras.cam_from_world.copy()
    wrong[:4] = wrong[3::-1]
    with pytest.raises(ValueError, match="do not agree"):
        register_missing.merged(given, replace(found, cameras=replace(found.cameras, cam_from_world=wrong)))
    with pytest.raises(ValueError, match="3 of the photos"):
        register_missing.merged(poses_of("012"), poses_of("0123"))


@pytest.mark.slow
def test_shipped_photos_without_cameras_are_placed(tmp_path):
    """Five of the 28 photos are not in the camera file; they come back within a degree and 2 % of their distance."""
    from datasets.photosets import read_photoset
    from recon.files import frames

    truth = read_photoset(SHIPPED)
    shots = frames.run(SHIPPED / "photos", tmp_path / "work")
    known = [i for i in range(len(truth.names)) if i % 6 != 1]
    cameras = Cameras(truth.names, truth.K, truth.cam_from_world, truth.sizes)
    names = tuple(truth.names[i] for i in range(len(truth.names)) if i not in known)
    paths = tuple(shots.paths[i] for i in known)
    none = np.zeros((0, 3)), np.zeros((0, len(known)), bool)
    given = Poses(cameras.subset(np.array(known)), paths, *none, names)
    full = register_missing.run(shots, given, tmp_path / "work")
    assert set(full.cameras.names) == set(truth.names)
    assert full.warnings == given.warnings
    off = misaligned(truth, full.cameras, Canonical(truth.world_from_canonical))
    assert (off.up, off.yaw, off.size) == pytest.approx((0, 0, 0), abs=0.2)
    order = [truth.names.index(n) for n in full.cameras.names]
    centres = cameras.centres()[order]
    distance = np.linalg.norm(centres - truth.world_from_canonical[:3, 3], axis=1)
    assert (np.linalg.norm(full.cameras.centres() - centres, axis=1) < 0.02 * distance).all()
