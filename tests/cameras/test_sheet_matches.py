"""A sheet on a floor of one grey, and nothing else: its corners tie all photos together."""

import cv2
import numpy as np
import pytest

from recon.cameras import poses, sheet_place
from recon.cameras.sfm_options import PosesOptions
from recon.files import frames as frames_stage
from recon.files import sheet_search
from recon.sheet.layout import PAPERS
from tests.cameras.test_poses import errors
from tests.made_up_sheets import intrinsics, lay, look_at, lying

SIZE = (800, 600)
FOCAL = 711.0
COUNT = 9
PLACES = (lying(0.45, -0.1, 35), lying(-0.4, 0.25, 160))


def cameras():
    out = []
    for i in range(COUNT):
        e, a = np.radians(24 if i % 2 else 42), 2 * np.pi * i / COUNT
        eye = 2.0 * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        out.append(look_at(eye, (0, 0, 0.25), 0.02))
    return np.array(out)


@pytest.mark.slow
def test_photos_of_a_plain_floor_are_placed(tmp_path):
    (tmp_path / "photos").mkdir()
    rng = np.random.default_rng(0)
    for i, cam in enumerate(cameras()):
        picture = np.full((SIZE[1], SIZE[0]), 125, np.uint8)
        for number, place in enumerate(PLACES):
            paper = PAPERS["A3"]
            picture = lay(picture, intrinsics(*SIZE, FOCAL), cam, place, paper.board(number + 1), whole=paper)
        noisy = cv2.GaussianBlur(picture, (0, 0), 0.6) + rng.normal(0, 2, picture.shape)
        cv2.imwrite(str(tmp_path / "photos" / f"p{i}.png"), np.clip(noisy, 0, 255).astype(np.uint8))
    shots = frames_stage.run(tmp_path / "photos", tmp_path / "work")
    shots = sheet_search.run(shots, tmp_path / "photos")
    assert len(np.unique(shots.sheets.view)) == COUNT, "every photo shows one"
    focal = 36 * FOCAL / SIZE[0]
    placed = sheet_place.run(shots, poses.run(shots, tmp_path / "work", PosesOptions(focal_mm=(focal, 36.0))))
    assert placed.cameras.names == shots.names
    turned, moved = errors(placed.cameras.cam_from_world, cameras())
    assert turned < 0.5
    assert moved < 0.01
    assert len(placed.sheets) == 2
    first, second = (s.metres_per_unit for s in placed.sheets)
    assert first == pytest.approx(second, rel=5e-3)
    between = np.subtract(*(s.world_from_sheet[:3, 3] for s in placed.sheets))
    true = np.linalg.norm(PLACES[0][:3, 3] - PLACES[1][:3, 3])
    assert np.linalg.norm(between) * first == pytest.approx(true, rel=5e-3)
