"""Product photos: the object comes off a plain backdrop without its shadow; other backgrounds are not guessed at."""

import cv2
import numpy as np
import pytest

from nnproc.rays import look_at_cameras
from procmodels.shape import Shape
from recon.geometry.raster import iou, silhouettes
from recon.masks import plain_backdrop

SIZE = 480
BACKDROPS = [(250, 250, 250), (226, 232, 240), (238, 228, 210)]
COLOURS = [(60, 110, 170), (30, 30, 45), (120, 60, 40)]  # BGR


def photo(chair, number):
    """A drawn product photo and its true mask: parts of different shade, a soft shadow, uneven light, noise."""
    rng = np.random.default_rng([5, number])
    shape = chair.build(chair.space.sample(rng))
    K, pose = (t[0].numpy() for t in look_at_cameras([40.0 + 70 * number], [18.0], 2.4, 40, SIZE))
    size = np.array([(SIZE, SIZE)])
    drawn = [silhouettes(Shape((part,)), K[None], pose[None], size)[0] for part in shape.parts]
    mask = np.logical_or.reduce(drawn)
    y, x = np.indices((SIZE, SIZE)) / SIZE - 0.5
    image = np.array(BACKDROPS[number % 3], float) * (1 - 0.1 * (x * x + y * y) - 0.04 * x)[..., None]
    low = np.flatnonzero(mask.any(1))[-1]
    shadow = np.zeros((SIZE, SIZE), np.float32)
    cv2.ellipse(shadow, (SIZE // 2 + 30, int(low) - 30), (130, 38), 0, 0, 360, 1, -1)
    image *= 1 - 0.45 * cv2.GaussianBlur(shadow, (0, 0), 14)[..., None]
    for part in drawn:
        image[part] = np.array(COLOURS[number % 3]) * rng.uniform(0.8, 1.2)
    image = cv2.GaussianBlur(image, (0, 0), 0.6) + rng.normal(0, 1.2, image.shape)
    data = cv2.imencode(".jpg", np.clip(image, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 92])[1]
    return cv2.imdecode(data, cv2.IMREAD_COLOR), mask


@pytest.mark.parametrize("number", range(6))
def test_the_object_without_its_shadow(chair, number):
    image, truth = photo(chair, number)
    found = plain_backdrop.find(image)
    assert found is not None
    assert iou(found, truth) >= 0.95


def test_a_backdrop_that_is_not_plain_is_left_alone(chair, rng):
    image, truth = photo(chair, 0)
    room = cv2.resize(rng.integers(0, 255, (24, 24, 3)).astype(np.uint8), (SIZE, SIZE))
    assert plain_backdrop.find(np.where(truth[..., None], image, room)) is None
    assert plain_backdrop.find(np.full((SIZE, SIZE, 3), 240, np.uint8)) is None
