"""Cameras in the wrong convention are recognised by the masks, by their own points, or by what matches in photos."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.cameras import camera_check, known_cameras
from recon.files import frames as frames_stage
from recon.outputs.camera_export import transforms
from recon.scene import Cameras, InputError

SHIPPED = Path(__file__).parents[2] / "datasets" / "samples" / "chair"
NAMED = list(camera_check.conventions("OpenGL"))


@pytest.fixture(scope="module")
def shipped():
    """Every fourth of the shipped photos: its true cameras, at a quarter of their size, and masks."""
    views = json.loads((SHIPPED / "truth" / "cameras.json").read_text())["views"][::4]
    cameras = Cameras(
        tuple(v["name"] for v in views),
        np.array([v["K"] for v in views]),
        np.array([v["cam_from_world"] for v in views]),
        np.array([[v["width"], v["height"]] for v in views]),
    )
    cameras = cameras.scaled(0.25)
    files = [SHIPPED / "truth" / "masks" / f"{Path(n).stem}.png" for n in cameras.names]
    masks = [cv2.resize(cv2.imread(str(f), cv2.IMREAD_GRAYSCALE), (200, 150)) > 127 for f in files]
    return cameras, dict(enumerate(masks))


def seen(cameras, rng, count=80):
    """Points on the chair, and which camera sees which."""
    points = rng.uniform((-0.3, -0.3, 0), (0.3, 0.3, 0.9), (count, 3))
    return points, rng.random((count, len(cameras))) < 0.5


def wrong(cameras, name):
    """The cameras as somebody writes them down who takes this convention for the right one."""
    undo = {0: lambda m: camera_check._FLIP @ m, 1: np.linalg.inv, 2: lambda m: np.linalg.inv(camera_check._FLIP @ m)}
    return replace(cameras, cam_from_world=undo[NAMED.index(name)](cameras.cam_from_world))


@pytest.mark.parametrize("by", ["masks", "points"])
def test_right_cameras_are_left_alone(shipped, rng, by):
    cameras, masks = shipped
    points, tracks = seen(cameras, rng)
    found, said = camera_check.fitting(cameras, masks if by == "masks" else {}, points, tracks, Path("x"))
    assert found is cameras
    assert not said


@pytest.mark.parametrize("by", ["masks", "inverted masks", "points"])
@pytest.mark.parametrize("name", NAMED)
def test_the_convention_that_fits_is_taken_and_named(shipped, rng, name, by):
    cameras, masks = shipped
    points, tracks = seen(cameras, rng)
    given = {"masks": masks, "inverted masks": {v: ~m for v, m in masks.items()}, "points": {}}[by]
    found, (said,) = camera_check.fitting(
        wrong(cameras, name), given, points, tracks, Path("set/transforms.json"), "OpenGL"
    )
    np.testing.assert_allclose(found.cam_from_world, cameras.cam_from_world, atol=1e-9)
    assert name in said
    assert "set/transforms.json" in said


@pytest.mark.parametrize("by", ["masks", "points"])
def test_cameras_of_something_else_are_refused(shipped, rng, by):
    cameras, masks = shipped
    points, tracks = seen(cameras, rng)
    shuffled = replace(cameras, cam_from_world=np.linalg.qr(rng.normal(size=(len(cameras), 4, 4)))[0])
    shuffled.cam_from_world[:, 3] = [0, 0, 0, 1]
    shuffled.cam_from_world[:, :3, 3] = rng.normal(size=(len(cameras), 3)) * 9
    with pytest.raises(InputError, match=r"model do not fit .*inverse poses or other axes") as caught:
        camera_check.fitting(shuffled, masks if by == "masks" else {}, points, tracks, Path("model"))
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("flipped", [False, True])
def test_photos_alone_tell_the_axes(tmp_path, flipped):
    """A transforms.json with OpenCV's axes, without points and masks: what matches in the photos decides."""
    views = json.loads((SHIPPED / "truth" / "cameras.json").read_text())["views"][:10]
    cameras = Cameras(
        tuple(v["name"] for v in views),
        np.array([v["K"] for v in views]),
        np.array([v["cam_from_world"] for v in views]),
        np.array([[v["width"], v["height"]] for v in views]),
    )
    content = transforms(cameras, list(cameras.names), [""] * 10)
    for frame in content["frames"]:
        axes = np.diag([1, -1, -1, 1] if flipped else [1] * 4)
        frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ axes).tolist()
    file = tmp_path / "transforms.json"
    file.write_text(json.dumps(content))
    given = known_cameras.gather(SHIPPED / "photos", file, tmp_path / "given")
    shots = frames_stage.run(given.folder, tmp_path, frames_stage.FramesOptions(same_difference=-1))
    given = replace(given, others=())
    poses = known_cameras.run(shots, given, tmp_path)
    np.testing.assert_allclose(poses.cameras.cam_from_world, cameras.cam_from_world, atol=1e-9)
    assert len(poses.points) > 300
    assert any("only with OpenCV's axes" in w for w in poses.warnings) == flipped
