"""Views that contradict the others are named, whoever is wrong, mask or camera; a good view from anywhere is not."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from nnproc.rays import look_at_cameras
from procmodels.classes import chair
from procmodels.shape import normalised
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.masks.silhouettes import SilhouetteOptions, judge
from recon.scene import Cameras, Canonical

OPTIONS = SilhouetteOptions(judge_cells=64)
VIEWS = 12


def armchair():
    params = {p.name: p.usual_value() for p in chair.SPACE.parameters} | {"back_rake": 20.0, "arms": "posts"}
    return normalised(chair.build(chair.SPACE.held(params)))


@pytest.fixture(scope="module")
def scene():
    """Cameras, masks and where the chair stands."""
    cameras, place = orbit(VIEWS, seed=2)
    masks = drawn_scene(armchair(), cameras, place).silhouettes
    return cameras, list(masks.masks), place


def turned(cameras: Cameras, place: Canonical, views, degrees) -> Cameras:
    """Some cameras carried round the object."""
    turn = np.eye(4)
    turn[:3, :3] = cv2.Rodrigues(np.array([0, 0, np.radians(degrees)]))[0]
    poses = cameras.cam_from_world.copy()
    world = place.world_from_canonical
    poses[views] = poses[views] @ world @ turn @ np.linalg.inv(world)
    return replace(cameras, cam_from_world=poses)


def judged(cameras, masks, **more):
    found = judge(cameras, masks, np.ones(len(masks), bool), None, OPTIONS, **more)
    return set(np.flatnonzero(~found.used)), dict(found.reasons)


def test_right_views_are_all_used(scene):
    cameras, masks, _ = scene
    assert judged(cameras, masks) == (set(), {})


@pytest.mark.parametrize("degrees", [180, 90, 40])
def test_cameras_on_the_wrong_side_are_refused_by_name(scene, degrees):
    cameras, masks, place = scene
    wrong, reasons = judged(turned(cameras, place, [3, 8], degrees), masks)
    assert wrong == {3, 8}
    assert set(reasons) == {"view_03.jpg", "view_08.jpg"}
    assert all("camera" in reason and "contradicts" in reason for reason in reasons.values())
    assert all("\n" not in reason for reason in reasons.values())


def test_where_a_camera_would_fit_is_told(scene):
    cameras, masks, place = scene
    found = judge(turned(cameras, place, [4], 60), masks, np.ones(len(masks), bool), None, OPTIONS)
    assert "about 60 degrees further round" in dict(found.reasons)["view_04.jpg"]
    assert found.misplaced == ("view_04.jpg",)


def test_a_good_view_from_a_side_that_no_other_has_is_kept(scene):
    """All others look from 20 degrees above the horizon: their hull is far thicker than what is seen from above."""
    cameras, _, place = scene
    azimuth, elevation = [*np.arange(0, 360, 40.0), 10.0], [*[20.0] * 9, 85.0]
    K, poses = (t.numpy() for t in look_at_cameras(azimuth, elevation, 2.2, 40, 600))
    world = np.linalg.inv(place.world_from_canonical)
    poses = poses @ world
    poses[:, :3] /= np.linalg.norm(world[:3, 0])
    cameras = Cameras(tuple(f"{i}.jpg" for i in range(10)), K, poses, np.full((10, 2), 600))
    masks = drawn_scene(armchair(), cameras, place).silhouettes
    assert judged(cameras, list(masks.masks)) == (set(), {})


def test_masks_of_something_else_or_without_a_part_are_refused(scene):
    cameras, masks, _ = scene
    some = list(masks)
    some[2] = np.roll(masks[2], 60, axis=1)
    some[7] = masks[7].copy()
    some[7][: int(np.nonzero(masks[7])[0].mean())] = False  # the upper half
    wrong, reasons = judged(cameras, some)
    assert wrong == {2, 7}
    assert "lacks" in reasons["view_07.jpg"]


def test_what_is_hidden_is_no_contradiction(scene):
    cameras, masks, _ = scene
    some, hidden = list(masks), np.zeros(masks[5].shape, bool)
    hidden[: int(np.nonzero(masks[5])[0].mean())] = True
    some[5] = masks[5] & ~hidden
    assert judged(cameras, some)[0] == {5}
    assert judged(cameras, some, hidden={5: hidden}) == (set(), {})


def test_automatic_masks_may_be_a_little_wrong(scene):
    cameras, masks, _ = scene
    some = list(masks)
    rows, columns = np.nonzero(masks[6])
    foot = rows.max()
    some[6] = masks[6].copy()
    some[6][foot - 14 : foot + 8, columns.min() : columns.max()] = True  # a shadow on the floor
    assert judged(cameras, some)[0] == {6}
    assert judged(cameras, some, found=set(range(VIEWS)))[0] == set()


def test_few_views_accuse_nobody(scene):
    cameras, masks, place = scene
    few = turned(cameras, place, [0], 90).subset([0, 4, 8])
    assert judged(few, [masks[v] for v in (0, 4, 8)]) == (set(), {})
