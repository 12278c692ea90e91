"""Where sheets lie, from corners in photos whose cameras are known exactly."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from recon.cameras import sheet_place
from recon.cameras.sheet_matches import marks
from recon.geometry.lenses import bent, unbent
from recon.scene import Cameras, Frames, Lens, Poses, Sightings
from recon.sheet.layout import boards
from tests.made_up_sheets import intrinsics, look_at, lying, pixels

SIZE = (1000, 750)
K = intrinsics(*SIZE, 889)
COUNT = 12
SCALE = 2.7  # world units a metre


def world():
    """A similarity that is nothing special, from metres with z up: world_from_room."""
    out = np.eye(4)
    out[:3, :3] = SCALE * Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()
    out[:3, 3] = (3, -8, 5)
    return out


def cams():
    """(COUNT, 4, 4) cam_from_room, at two heights all round."""
    out = []
    for i in range(COUNT):
        e, a = np.radians(15 if i % 2 else 40), 2 * np.pi * i / COUNT
        out.append(
            look_at(2.1 * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]), (0, 0, 0.4), 0.02)
        )
    return np.array(out)


def scene(shown, noise=0.2, lens=None):
    """Frames and poses. `shown`: rows of (views, number, copy, room_from_sheet)."""
    rng, rows, seen = np.random.default_rng(1), [], []
    for views, number, copy, place in shown:
        board = boards()[number]
        for view in views:
            true = pixels(K, cams()[view], place, board, board.corners())
            if lens is not None:
                rays = np.column_stack([(true - K[:2, 2]) / K[0, 0], np.ones(len(true))])
                true = bent(lens, rays)
            seen.append(true + rng.normal(0, noise, true.shape))
            rows += [(view, number, copy, c) for c in range(len(true))]
    table = np.array(rows, int).reshape(-1, 4)
    names = tuple(f"{i}.jpg" for i in range(COUNT))
    sizes = np.tile(SIZE, (COUNT, 1))
    found = Sightings(*table.T, np.concatenate(seen))
    paths = tuple(Path(n) for n in names)
    frames = Frames(names, paths, sizes, np.full(COUNT, np.nan), np.ones(COUNT), (None,) * COUNT, sheets=found)
    poses = cams() @ np.linalg.inv(world())
    poses[:, :3] *= SCALE
    cameras = Cameras(names, np.tile(K, (COUNT, 1, 1)), poses, sizes)
    lenses = () if lens is None else (lens,) * COUNT
    return frames, Poses(cameras, paths, np.zeros((0, 3)), np.zeros((0, COUNT), bool), lenses=lenses)


def check(sheet, place, scale=2e-3, degrees=0.15, metres=3e-3):
    """The sheet is where it lies, as large as it is."""
    true = world() @ place
    assert sheet.metres_per_unit * np.cbrt(np.linalg.det(true[:3, :3])) == pytest.approx(1, rel=scale)
    normal = true[:3, 2] / np.linalg.norm(true[:3, 2])
    assert np.degrees(np.arccos(np.clip(sheet.plane[:3] @ normal, -1, 1))) < degrees
    assert abs(sheet.plane[:3] @ true[:3, 3] + sheet.plane[3]) / SCALE < metres
    assert np.linalg.norm(sheet.world_from_sheet[:3, 3] - true[:3, 3]) / SCALE < metres


PLACE = lying(0.5, -0.3, 35)


def test_scale_and_plane_are_recovered():
    placed = sheet_place.run(*scene([(range(COUNT), 0, 0, PLACE)]))
    (sheet,) = placed.sheets
    check(sheet, PLACE)
    assert len(sheet.names) == COUNT
    assert sheet.error < 0.6
    assert not placed.warnings


def test_two_photos_are_enough_and_one_is_not():
    (sheet,) = sheet_place.run(*scene([((0, 2), 0, 0, PLACE)], noise=0.05)).sheets
    check(sheet, PLACE, scale=0.01, degrees=1.5, metres=0.02)
    placed = sheet_place.run(*scene([((4,), 0, 0, PLACE)]))
    assert not placed.sheets
    assert "one photo only (4.jpg)" in placed.warnings[0]


def test_a_print_of_97_per_cent_tells_what_it_measures():
    (sheet,) = sheet_place.run(*scene([(range(COUNT), 0, 0, lying(0.5, -0.3, 35, size=0.97))])).sheets
    assert sheet.metres_per_unit * SCALE == pytest.approx(1 / 0.97, rel=2e-3)


def test_two_copies_of_one_sheet_lie_about():
    """Both are seen in every photo, in no order: one of them is found, as it lies."""
    other = lying(-0.4, 0.5, 200)
    shown = [(range(0, COUNT, 2), 0, 0, PLACE), (range(0, COUNT, 2), 0, 1, other)]
    shown += [(range(1, COUNT, 2), 0, 1, PLACE), (range(1, COUNT, 2), 0, 0, other)]
    frames, poses = scene(shown)
    (sheet,) = sheet_place.run(frames, poses).sheets
    near = min((PLACE, other), key=lambda p: np.linalg.norm((world() @ p)[:3, 3] - sheet.world_from_sheet[:3, 3]))
    check(sheet, near)
    assert marks(frames) == {}, "nobody knows which corner is which"


def test_a_sheet_that_was_moved_lies_where_most_photos_have_it():
    (sheet,) = sheet_place.run(*scene([(range(8), 0, 0, PLACE), (range(8, COUNT), 0, 0, lying(-0.5, 0.2, 90))])).sheets
    check(sheet, PLACE)
    assert set(sheet.names) == {f"{i}.jpg" for i in range(8)}


def test_several_sheets_and_photos_without_a_camera():
    frames, poses = scene([(range(COUNT), 0, 0, PLACE), (range(3, 9), 6, 0, lying(-0.4, 0.4, 80))])
    keep = list(range(2, COUNT))
    some = replace(
        poses, cameras=poses.cameras.subset(keep), paths=poses.paths[2:], tracks=np.zeros((0, len(keep)), bool)
    )
    first, second = sheet_place.run(frames, some).sheets
    check(first, PLACE)
    check(second, lying(-0.4, 0.4, 80))
    assert len(first.names) == len(keep)
    assert first.name != second.name


@pytest.mark.parametrize("turns", [0, 1])
def test_lenses_are_taken_out(turns):
    size = SIZE if turns == 0 else SIZE[::-1]
    lens = Lens("SIMPLE_RADIAL", np.array([889.0, size[0] / 2, size[1] / 2, -0.12]), np.array(size), turns)
    rays = np.column_stack([np.random.default_rng(0).uniform(-0.4, 0.4, (50, 2)), np.ones(50)])
    assert unbent(lens, bent(lens, rays)) == pytest.approx(rays, abs=1e-6)
    (sheet,) = sheet_place.run(*scene([(range(COUNT), 0, 0, PLACE)], lens=lens)).sheets
    check(sheet, PLACE)


def test_marks_name_corners_by_what_they_are():
    frames, _ = scene([((0, 1), 0, 0, PLACE), ((1,), 2, 0, lying())])
    found = marks(frames)
    assert [m[0] for m in found["0.jpg"]] == list(range(20))
    assert [m[0] for m in found["1.jpg"]] == [*range(20), *range(40, 60)]
