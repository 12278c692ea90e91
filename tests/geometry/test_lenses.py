"""Every camera model of COLMAP: read by name and number, taken out of photos; what has no focal length is refused."""

import cv2  # noqa: F401  before pycolmap, which breaks their PNG writing otherwise
import numpy as np
import PIL.Image  # noqa: F401
import pycolmap
import pytest

from recon.files import colmap_model
from recon.geometry.lenses import bent, lens, models
from recon.geometry.undistort import undistorted
from recon.scene import InputError, Lens

SIZE = (320, 240)
EXTRA = {  # by name of the parameter, so large that a pixel at the edge moves by several
    **{"k": -0.2, "k1": -0.2, "k2": 0.01, "k3": 0.003, "k4": 0.001, "k5": 0.001, "k6": 0.001, "k0": 0.02},
    **{"p0": 1e-3, "p1": 1e-3, "p2": 1e-3, "s0": 1e-3, "s1": 1e-3, "s2": 1e-3, "s3": 1e-3, "sx1": 1e-3, "sy1": 1e-3},
    **{"omega": 0.8, "alpha": 0.5, "beta": 1.1},
}
BENDING = [n for n, _ in models().values() if n not in ("SIMPLE_PINHOLE", "PINHOLE", "EQUIRECTANGULAR")]


def camera_of(model):
    camera = pycolmap.Camera.create_from_model_name(1, model, 260.0, *SIZE)
    names = [n.strip() for n in camera.params_info.split(",")]
    camera.params = [EXTRA.get(n, v) for n, v in zip(names, camera.params, strict=True)]
    return camera


def pattern(x, y):
    """A smooth picture of directions (x / z, y / z)."""
    return 128 + 60 * np.sin(14 * x) + 60 * np.cos(11 * y)


@pytest.mark.parametrize("model", BENDING)
def test_a_picture_through_the_lens_becomes_a_pinholes(model):
    camera = camera_of(model)
    K, bends = lens(model, np.array(camera.params), SIZE)
    u, v = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    rays = np.asarray(camera.cam_ray_from_img(np.column_stack([u.ravel(), v.ravel()])), float)
    taken = pattern(rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]).reshape(SIZE[::-1]).astype(np.uint8)
    ideal = pattern((u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1])
    inner = (slice(40, -40), slice(50, -50))
    found = undistorted(taken, K, bends)
    assert np.abs(found[inner] - ideal[inner]).mean() < 1.0
    assert np.abs(taken[inner] - ideal[inner]).mean() > 1.5, "the lens does something"


def test_turned_photos_have_turned_lenses():
    """A quarter turn of the picture and of its camera: the same pixels, turned."""
    _, bends = lens("OPENCV", np.array([260.0, 250, 150, 130, -0.1, 0.02, 0.004, -0.003]), SIZE)
    rays = np.random.default_rng(0).normal(size=(20, 3)) * (0.2, 0.2, 0) + (0, 0, 1)
    lying = bent(bends, rays)
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    for turns in (1, 2, 3):
        rays, lying = (
            rays @ quarter.T,
            np.column_stack([(SIZE[1], SIZE[0])[(turns - 1) % 2] - lying[:, 1], lying[:, 0]]),
        )
        turned = Lens(bends.model, bends.params, bends.size, turns)
        np.testing.assert_allclose(bent(turned, rays), lying, atol=1e-9)


@pytest.mark.parametrize(("number", "model"), [(n, m) for n, (m, _) in models().items() if m != "EQUIRECTANGULAR"])
def test_models_of_colmaps_own_writer_by_number_and_name(tmp_path, number, model):
    """Two cameras on a rig: what pycolmap writes, with rigs and frames, is read back as it was."""
    camera, poses = camera_of(model), []
    written = pycolmap.Reconstruction()
    written.add_camera_with_trivial_rig(camera)
    rng = np.random.default_rng(number)
    for i in range(3):
        rotation = pycolmap.Rotation3d(rng.normal(size=4))
        rotation.normalize()
        poses.append(pycolmap.Rigid3d(rotation, rng.normal(size=3)))
        image = pycolmap.Image(name=f"p{i}.jpg", camera_id=1, image_id=i + 1)
        written.add_image_with_trivial_frame(image, poses[-1])
    for kind in ("binary", "text"):
        folder = tmp_path / kind
        folder.mkdir()
        getattr(written, f"write_{kind}")(folder)
        assert any(folder.glob("rigs.*"))
        found = colmap_model.read(folder)
        assert found.names == ("p0.jpg", "p1.jpg", "p2.jpg")
        np.testing.assert_allclose(found.cam_from_world[:, :3], [p.matrix() for p in poses], atol=1e-12)
        np.testing.assert_allclose(found.K[0], camera.calibration_matrix())
        for one in found.lenses:
            assert (one is None) == (model not in BENDING)
            assert one is None or (one.model == model and np.allclose(one.params, camera.params))


@pytest.mark.parametrize(
    ("model", "params", "message"),
    [
        ("EQUIRECTANGULAR", [320, 240], "panorama"),
        ("ORTHOPHOTO", [1, 2, 3], "map"),
        ("WIDE_ANGLE", [1, 2, 3], "is not known; known: .*DIVISION"),
        ("PINHOLE", [1, 2, 3], "has 4 parameters"),
        ("PINHOLE", [1e-300, 1e-300, 160, 120], "no lens has"),
        ("PINHOLE", [300, np.inf, 160, 120], "no numbers"),
        ("PINHOLE", [300, 300, 16000, 120], "far outside"),
    ],
)
def test_what_is_no_camera_is_said(model, params, message):
    with pytest.raises(InputError, match=message) as caught:
        lens(model, np.array(params, float), SIZE)
    assert "\n" not in str(caught.value)
