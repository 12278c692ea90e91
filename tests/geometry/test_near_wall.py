"""The walls that are found from points: far ones, one close behind the object, and never the object's own back."""

from __future__ import annotations

import numpy as np
import pytest

from datasets.camera_rings import look_at
from recon.geometry.room_planes import find_room
from recon.scene import Cameras

BACK = 0.25  # metres behind the middle: the object's back


def front_cameras(arc: float = 120.0, views: int = 12) -> Cameras:
    """On a part of a circle about -Y, 1.8 m away, looking at a point 0.4 m over the floor."""
    angles = np.radians(np.linspace(-90 - arc / 2, -90 + arc / 2, views))
    eyes = np.c_[1.8 * np.cos(angles), 1.8 * np.sin(angles), np.where(np.arange(views) % 2, 0.7, 1.4)]
    poses = np.array([look_at(eye, np.array([0, 0, 0.4])) for eye in eyes])
    K = np.array([[570.0, 0, 320], [0, 570, 240], [0, 0, 1]])
    return Cameras(tuple(map(str, range(views))), np.tile(K, (views, 1, 1)), poses, np.tile([640, 480], (views, 1)))


def points(wall: float, width: float, rng: np.random.Generator) -> np.ndarray:
    """A floor, and upright points `wall` metres behind the middle, so wide in all; with a millimetre of noise."""
    floor = np.c_[rng.uniform(-1.5, 1.5, (600, 1)), rng.uniform(-1.5, min(wall, 1.5), (600, 1)), np.zeros(600)]
    upright = np.c_[rng.uniform(-width / 2, width / 2, 300), np.full(300, wall), rng.uniform(0.2, 1.5, 300)]
    return np.vstack([floor, upright]) + rng.normal(0, 0.001, (900, 3))


@pytest.mark.parametrize(
    ("wall", "width", "found"),
    [(2.0, 4.0, 1), (0.4, 4.0, 1), (0.4, 3.0, 1), (BACK, 0.6, 0), (BACK, 1.2, 0)],
)
def test_a_wall_close_behind_is_told_from_the_objects_back_by_its_width(wall: float, width: float, found: int) -> None:
    rng = np.random.default_rng(0)
    room = find_room(points(wall, width, rng), front_cameras(), rng)
    assert len(room.walls) == found
    for plane in room.walls:
        np.testing.assert_allclose(plane, [0, -1, 0, wall], atol=0.01)
