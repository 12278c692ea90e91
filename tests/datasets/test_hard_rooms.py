"""Photo sets on a part of a circle, with a rug, a wall close behind, or a floor without a pattern."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from datasets import photography, photosets, staging
from datasets.photosets import PhotosetError, PhotosetOptions

BOX = np.asarray(trimesh.creation.box((0.5, 0.6, 0.9)).vertices)


def planned(**change) -> staging.Plan:
    return staging.plan(BOX, np.zeros((0, 3), int), ".ply", PhotosetOptions(**change))


def azimuths(plan: staging.Plan) -> np.ndarray:
    """Degrees from the front, of every camera."""
    cam_from_canonical = plan.cam_from_world @ plan.world_from_canonical
    x, y, _ = np.linalg.inv(cam_from_canonical)[:, :3, 3].T
    return np.degrees(np.arctan2(x, -y))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("arc", [60.0, 120.0, 180.0])
def test_cameras_keep_to_their_arc_about_the_front(arc: float, seed: int) -> None:
    found = azimuths(planned(arc=arc, views=18, seed=seed))
    assert np.abs(found).max() < arc / 2 + 8  # jitter, and cameras that look past the middle
    assert np.ptp(found) > 0.75 * arc
    assert abs(found.mean()) < 0.1 * arc


def test_the_older_options_leave_the_plan_and_its_record_as_they_were(tmp_path: Path) -> None:
    mesh = tmp_path / "m.ply"
    trimesh.creation.box((1, 1, 1)).export(mesh)
    young = {"arc", "floor", "rug", "wall"}
    assert not young & set(photosets._info(mesh, PhotosetOptions())["options"])
    assert photosets._info(mesh, PhotosetOptions(rug=True))["options"]["rug"] is True
    plain, rug = planned(views=4), planned(views=4, rug=True, floor="plain")
    np.testing.assert_array_equal(plain.cam_from_world, rug.cam_from_world)


def test_the_room_holds_what_was_asked_for(tmp_path: Path) -> None:
    options = PhotosetOptions(views=6, width=128, height=96, arc=120.0, wall=0.15, rug=True, floor="plain")
    plan = staging.plan(BOX, np.zeros((0, 3), int), ".ply", options)
    room = photography._room(tmp_path, plan, options)
    assert np.ptp(np.asarray(Image.open(room.floor_image)), axis=(0, 1)).max() == 0
    assert room.rug is not None
    assert room.near_wall is not None
    out = np.array([np.cos(room.near_wall.angle), np.sin(room.near_wall.angle)])
    corners = staging.apply(plan.world_from_canonical, plan.vertices)[:, :2] @ out
    assert room.near_wall.distance - corners.max() == pytest.approx(0.15)
    eyes = np.linalg.inv(plan.cam_from_world)[:, :2, 3]
    assert (eyes @ out < corners.min()).all()
    assert min(room.rug.size) > 1.1 * 0.6 * 0.9  # wider than the object, which is 0.9 m high


@pytest.mark.parametrize("change", [{"arc": 0.0}, {"arc": 400.0}, {"floor": "wet"}, {"wall": -1.0}, {"wall": 0.1}])
def test_senseless_rooms_are_refused(change: dict) -> None:
    with pytest.raises(PhotosetError):
        PhotosetOptions(**change)
