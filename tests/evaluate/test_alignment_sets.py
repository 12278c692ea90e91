"""The spoilt photo sets of `evaluate alignment`, and how a misplaced result is measured."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from datasets.photosets import read_photoset
from recon.evaluate.alignment import KINDS, all_photos, eight_photos, mixed_formats, tilted
from recon.evaluate.chair import SET_OPTIONS
from recon.evaluate.data.scenes import misaligned
from recon.geometry.align import quarter_turn
from recon.scene import Cameras, Canonical

SHIPPED = Path(__file__).parents[2] / "datasets" / "samples" / "chair"


@pytest.fixture(scope="module")
def truth():
    return read_photoset(SHIPPED)


@pytest.mark.parametrize(("spoil", "count"), [(eight_photos, 8), (all_photos, 28)])
def test_photos_are_chosen(truth, tmp_path, spoil, count):
    spoil(truth, tmp_path)
    names = {p.name for p in tmp_path.iterdir()}
    assert names <= set(truth.names)
    assert len(names) == count


def test_ten_sets_with_options_the_renderer_takes():
    assert sum(len(kind.chairs) for kind in KINDS) >= 10
    for kind in KINDS:
        replace(SET_OPTIONS, **kind.room)  # raises when it cannot be rendered


def test_tilting_turns_pictures_about_their_middle(truth, tmp_path):
    tilted(truth, tmp_path)
    turned = cv2.imread(str(tmp_path / truth.names[0]))
    before = cv2.imread(str(truth.photos[0]))
    assert turned.shape == before.shape
    middle = tuple(slice(s // 2 - 3, s // 2 + 3) for s in before.shape[:2])
    assert np.abs(turned[middle].astype(int) - before[middle]).mean() < 25
    assert np.abs(turned.astype(int) - before).mean() > 5
    assert dict(Image.open(tmp_path / truth.names[0]).getexif()) == dict(Image.open(truth.photos[0]).getexif())


def test_formats_are_mixed(truth, tmp_path):
    mixed_formats(truth, tmp_path)
    upright = [Image.open(p).size[0] < Image.open(p).size[1] for p in sorted(tmp_path.iterdir())]
    assert sum(upright) == 14


def test_a_misplaced_result_is_measured(truth):
    cameras = Cameras(truth.names, truth.K, truth.cam_from_world, truth.sizes)
    exact = misaligned(truth, cameras, Canonical(truth.world_from_canonical))
    assert (exact.up, exact.yaw, exact.size) == pytest.approx((0, 0, 0), abs=1e-4)
    tilt = np.eye(4)
    tilt[:3, :3] = 1.03 * cv2.Rodrigues(np.array([np.radians(2.0), 0, 0]))[0]
    off = misaligned(truth, cameras, Canonical(truth.world_from_canonical @ quarter_turn(1) @ tilt))
    assert (off.up, off.yaw, off.size) == pytest.approx((2, 90, 0.03), abs=0.05)
