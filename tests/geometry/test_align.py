"""Up, place, size and yaw from silhouettes alone; the windows that later stages compare with."""

import numpy as np
import pytest

from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.geometry import align
from recon.geometry.object_windows import object_crops
from recon.geometry.raster import silhouettes as rasterised
from recon.scene import Canonical, ReconstructionError, Silhouettes, cam_from_canonical

CHAIR = {"width": 0.45, "depth": 0.55, "leg_height": 0.45, "legs": "support", "arms": "basic", "back": "hbar"}


@pytest.fixture(scope="module")
def scene(chair):
    cameras, truth = orbit(20, seed=3)
    return drawn_scene(chair.build(CHAIR), cameras, truth)


def test_the_box_is_found_up_to_the_front(scene):
    poses, masks, truth = scene.poses, scene.silhouettes, scene.canonical
    found = align.run(poses, masks)
    turn = np.linalg.inv(found.world_from_canonical) @ truth.world_from_canonical
    scale = np.linalg.norm(turn[:3, 0])
    assert scale == pytest.approx(1, abs=0.04)
    assert np.abs(turn[:3, 3]).max() < 0.03
    assert turn[2, 2] / scale == pytest.approx(1, abs=1e-3), "up is up"
    yaw = np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))
    assert abs((yaw + 45) % 90 - 45) < 3


def test_one_of_four_fronts_is_the_true_one(scene):
    poses, masks, truth = scene.poses, scene.silhouettes, scene.canonical
    errors = []
    for h in align.front_hypotheses(align.run(poses, masks)):
        turn = np.linalg.inv(h.world_from_canonical) @ truth.world_from_canonical
        errors.append(abs(np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))))
    assert sorted(e < 3 for e in errors) == [False, False, False, True]


def test_quarter_turns_compose():
    assert align.quarter_turn(1) @ [1, 0, 0, 1] == pytest.approx([0, 1, 0, 1])
    assert align.quarter_turn(3) @ align.quarter_turn(1) == pytest.approx(np.eye(4))


def test_the_floor_frame_stands_on_the_floor(rng):
    for _ in range(10):
        normal = rng.normal(size=3)
        floor = np.array([*(normal / np.linalg.norm(normal)), rng.normal()])
        above = rng.normal(size=3)
        frame = align.floor_frame(floor, above)
        assert frame[:3, :3].T @ frame[:3, :3] == pytest.approx(np.eye(3))
        assert np.linalg.det(frame[:3, :3]) == pytest.approx(1)
        assert floor[:3] @ frame[:3, 3] + floor[3] == pytest.approx(0)
        local = np.linalg.inv(frame) @ [*above, 1]
        assert local[:2] == pytest.approx(0, abs=1e-9)


def test_what_cannot_be_aligned_is_said(scene):
    poses, masks = scene.poses, scene.silhouettes
    n = len(masks.names)
    without = Silhouettes(masks.names, masks.masks, masks.source, masks.used)
    with pytest.raises(ReconstructionError, match="floor"):
        align.run(poses, without)
    # Every mask in another corner: the rays never meet in one place.
    corners = []
    for i, m in enumerate(masks.masks):
        corner = np.zeros_like(m)
        corner[-20:, slice(0, 20) if i % 2 else slice(-20, None)] = True
        corners.append(corner)
    apart = Silhouettes(masks.names, tuple(corners), masks.source, np.ones(n, bool), masks.floor)
    with pytest.raises(ReconstructionError, match="no common inside"):
        align.run(poses, apart)


def test_windows_show_what_the_photos_show(scene, chair):
    """A shape drawn in a window's camera is the shape drawn in the photo, cut and resized."""
    crops = object_crops(scene, 96)
    assert crops.masks.shape == crops.valid.shape == (20, 96, 96)
    drawn = rasterised(
        chair.build(CHAIR), crops.cameras.K, cam_from_canonical(crops.cameras, scene.canonical), crops.cameras.sizes
    )
    hard = crops.masks >= 0.5
    assert np.mean(np.stack(drawn) != hard) < 0.003
    assert len(object_crops(scene, 32, max_views=7).cameras) == 7


def test_windows_beyond_the_photo_are_marked(scene):
    moved = Canonical(scene.canonical.world_from_canonical.copy())
    moved.world_from_canonical[:3, :3] *= 3
    crops = object_crops(scene.standing(moved), 48)
    assert not crops.valid.all()
    assert crops.masks[~crops.valid].max() < 1
