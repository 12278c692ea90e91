"""Sheets in made-up photos whose corners are known exactly."""

import cv2
import numpy as np
import pytest

from recon.sheet.detection import find, find_outlined
from recon.sheet.layout import PAPERS, boards
from tests.made_up_sheets import intrinsics, lay, look_at, lying, pixels

WIDTH, HEIGHT = 1000, 750
K = intrinsics(WIDTH, HEIGHT, 889)


def camera(elevation, azimuth=1.0, distance=1.9):
    e, a = np.radians(elevation), azimuth
    return look_at(distance * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]), (0, 0, 0.2), 0.02)


def photo(cam, *sheets, whole=None, grey=120, seed=0):
    """Sheets (number, world_from_sheet) on a floor of one grey, a little out of focus, with noise."""
    picture = np.full((HEIGHT, WIDTH), grey, np.uint8)
    for number, place in sheets:
        picture = lay(picture, K, cam, place, boards()[number], whole=whole)
    noise = np.random.default_rng(seed).normal(0, 2, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.6) + noise, 0, 255).astype(np.uint8)


def off(found, cam, place):
    """px, root mean square and mean distance of the corners from where they are."""
    true = pixels(K, cam, place, found.board, found.board.corners()[found.corner])
    return np.sqrt(((found.pixels - true) ** 2).sum(1).mean()), np.linalg.norm((found.pixels - true).mean(0))


@pytest.mark.parametrize(("elevation", "degrees", "number"), [(30, 20, 0), (45, 130, 3), (60, 275, 6)])
def test_corners_to_a_fraction_of_a_pixel(elevation, degrees, number):
    cam, place = camera(elevation), lying(0.1, -0.1, degrees)
    (found,) = find(photo(cam, (number, place)))
    assert found.board.number == number
    assert len(found.corner) == 20
    spread, bias = off(found, cam, place)
    assert spread < 0.25
    assert bias < 0.06


def test_a_sheet_that_is_half_hidden_gives_the_corners_in_sight():
    cam, place = camera(45), lying(0.1, -0.1, 30)
    picture = photo(cam, (0, place))
    true = pixels(K, cam, place, boards()[0], boards()[0].corners())
    edge = int(true[:, 0].mean())
    picture[:, edge:] = 90  # a board before it
    (found,) = find(picture)
    assert 4 <= len(found.corner) < 20
    assert found.pixels[:, 0].max() < edge + 20, "less than a square's side"
    assert off(found, cam, place)[0] < 0.5


def test_several_sheets_and_two_of_one_number():
    cam = camera(45)
    places = [(0, lying(-0.35, 0.1, 20)), (0, lying(0.3, -0.2, 110)), (1, lying(0.0, 0.4, 300))]
    found = find(photo(cam, *places))
    assert sorted(f.board.number for f in found) == [0, 0, 1]
    for number, place in places:
        assert min(off(f, cam, place)[0] for f in found if f.board.number == number) < 0.3


def test_nothing_is_found_where_there_is_none():
    from skimage import data

    for name in ("astronaut", "page", "brick", "coffee"):
        picture = np.asarray(getattr(data, name)())
        assert not find(picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
    assert not find(np.zeros((8, 8), np.uint8))


def test_a_sheet_too_flat_to_be_read_is_found_by_its_outline():
    cam, place = camera(17, distance=2.1), lying(0.2, -0.2, 40)
    picture = photo(cam, (0, place), whole=PAPERS["A4"])
    assert not find(picture), "otherwise this tests nothing"
    (found,) = find_outlined(picture, 0)
    assert off(found, cam, place)[0] < 0.6
    assert not any(find_outlined(picture, other) for other in (1, 6)), "another sheet is not taken for it"
    assert not find_outlined(photo(cam), 0)
