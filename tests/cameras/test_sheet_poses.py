"""Cameras by single photos of a sheet: poses, focal length, which matches they allow, and how sheets are linked."""

from dataclasses import replace

import numpy as np
import pytest

from recon.cameras import sheet_poses
from recon.cameras.sfm_attempts import _beats
from recon.cameras.sfm_options import BY_SHEET, LADDER, Attempt, ladder
from recon.cameras.sheet_matches import from_epipolar, fundamental
from recon.cameras.sheet_start import linked
from tests.cameras.test_sheet_place import COUNT, PLACE, K, cams, scene
from tests.made_up_sheets import lying

OTHER = lying(-0.4, 0.4, 80)


def shots(shown, focal=np.nan, noise=0.1):
    frames, _ = scene(shown, noise)
    return replace(frames, focal_px=np.full(COUNT, float(focal)))


def angle(a, b):
    return np.degrees(np.arccos(np.clip((np.trace(a[:3, :3] @ b[:3, :3].T) - 1) / 2, -1, 1)))


def test_a_photo_of_a_sheet_tells_where_its_camera_stands():
    found = sheet_poses.run(shots([(range(COUNT), 0, 0, PLACE)], focal=K[0, 0]))
    assert len(found) >= COUNT - 2, "of the others both ways to see the sheet fit"
    for i in range(COUNT):
        if f"{i}.jpg" in found:
            pose, true = np.reshape(found[f"{i}.jpg"][0], (4, 4)), cams()[i] @ PLACE
            assert angle(pose, true) < 1.0
            assert np.linalg.norm(pose[:3, 3] - true[:3, 3]) < 0.03


@pytest.mark.parametrize("told", [np.nan, 0.97, 1.03])
def test_a_sheet_tells_the_focal_length(told):
    """Without EXIF, and with one that is rounded."""
    found = sheet_poses.focal_lengths(shots([(range(COUNT), 0, 0, PLACE), (range(COUNT), 1, 0, OTHER)], told * K[0, 0]))
    assert found == pytest.approx(np.full(COUNT, K[0, 0]), rel=5e-3)


def test_too_few_photos_leave_the_focal_length_as_it_was():
    found = sheet_poses.focal_lengths(shots([((0, 1), 0, 0, PLACE)], 0.97 * K[0, 0]))
    assert found == pytest.approx(np.full(COUNT, 0.97 * K[0, 0]))
    assert np.isnan(sheet_poses.focal_lengths(shots([((0, 1), 0, 0, PLACE)]))).all()
    assert sheet_poses.run(shots([((0, 1), 0, 0, PLACE)])) == {}


def test_matches_must_lie_on_the_lines_that_sheets_tell():
    found = sheet_poses.run(shots([(range(COUNT), 0, 0, PLACE)], focal=K[0, 0]))
    found = {name: {str(b): m for b, m in boards.items()} for name, boards in found.items()}
    a, b, *_ = sorted(found)
    lens = {name: [K[0, 0], K[0, 2], K[1, 2]] for name in found}
    F = fundamental(found, lens, a, b)
    points = np.random.default_rng(0).uniform((-0.4, -0.4, 0, 1), (0.4, 0.4, 0.9, 1), (40, 4)) * (1, 1, 1, 0) + (
        0,
        0,
        0,
        1,
    )
    seen = []
    for name in (a, b):
        local = points @ cams()[int(name.split(".")[0])][:3].T @ K.T
        seen.append(local[:, :2] / local[:, 2:])
    assert from_epipolar(F, *seen).max() < 8, "half a degree is some pixels"
    assert np.median(from_epipolar(F, seen[0], np.roll(seen[1], 7, axis=0))) > 12
    assert fundamental(found, lens, a, "gone.jpg") is None


def test_photos_of_several_sheets_are_linked_by_one_that_shows_both():
    poses = {}
    for i, boards in enumerate([(0,), (0,), (0, 1), (1,), (2,)]):
        places = {0: PLACE, 1: OTHER, 2: lying(1, 1, 3)}
        poses[str(i)] = {str(b): (cams()[i] @ places[b]).ravel().tolist() for b in boards}
    found = linked(poses)
    assert set(found) == {"0", "1", "2", "3"}, "nothing leads to the third sheet"
    world_from_room = np.linalg.inv(found["0"]) @ cams()[0]
    for name, pose in found.items():
        assert np.linalg.inv(pose) @ cams()[int(name)] == pytest.approx(world_from_room, abs=1e-9)
    assert linked({}) == {}


def test_a_rung_by_sheets_follows_each_with_new_features():
    assert ladder(5, sheets=False) == LADDER
    names = [r.name for r in ladder(5, sheets=True)]
    assert names[1] == BY_SHEET.name
    assert names.count(BY_SHEET.name) == sum(not r.reuse for r in LADDER)
    assert ladder(1, sheets=True) == (LADDER[0], BY_SHEET)


def attempt(photos, seen):
    none = np.zeros(0)
    tracks = np.ones((seen, photos), bool)
    return Attempt(np.arange(photos), none, none, np.zeros((photos, 4, 4)), none, tracks, none, none, none)


def test_an_attempt_by_a_sheet_wins_unless_it_explains_far_less():
    by_sheet, other = attempt(12, 60), attempt(12, 100)
    assert _beats(by_sheet, True, other, False, 11)
    assert not _beats(other, False, by_sheet, True, 11)
    moved = attempt(12, 30)
    assert not _beats(moved, True, other, False, 11)
    assert not _beats(attempt(6, 100), True, other, False, 11)
    assert _beats(attempt(12, 61), True, by_sheet, True, 11)
