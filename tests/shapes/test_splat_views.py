"""A Gaussian splat with cameras: its silhouettes are those of the surface it covers, without floor and floaters."""

import json

import cv2
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from nnproc.rays import look_at_cameras
from recon.command import main
from recon.files.video import VideoOptions
from recon.geometry.raster import iou, silhouettes
from recon.outputs import camera_export
from recon.pipelines import photo_source
from recon.scene import Cameras, InputError
from recon.shapes import splat_rendering, splat_views
from recon.shapes.splat_rendering import Splat

CHAIR = {"width": 0.45, "depth": 0.5, "leg_height": 0.42, "legs": "support", "arms": "none", "back": "hbar"}
COUNT = 60_000


def circle(count=8, size=640):
    """Cameras round the origin from two heights."""
    azimuths = np.arange(count) * 360 / count
    K, poses = look_at_cameras(azimuths.tolist(), [12 + 20 * (i % 2) for i in range(count)], 2.3, 40, size)
    names = tuple(f"images/v{i:02d}.jpg" for i in range(count))
    return Cameras(names, K.numpy(), poses.numpy(), np.tile((size, size), (count, 1)))


def discs(mesh, count, share=0.5):
    """Flat Gaussians that cover a mesh: centres (n, 3), rotations (n, 3, 3), standard deviations (n, 3)."""
    centres, face = trimesh.sample.sample_surface(mesh, count, seed=1)
    normal = mesh.face_normals[face]
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin(1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    sigma = share * np.sqrt(mesh.area / count) * np.array([1, 1, 0.1])
    return centres, np.stack([first, np.cross(normal, first), normal], 2), np.tile(sigma, (count, 1))


def write(path, centres, rotations, sigmas, opacity):
    """A .ply as splat programs write it; quaternions are deliberately not of unit length."""
    x, y, z, w = 1.7 * Rotation.from_matrix(rotations).as_quat().T
    logit = np.log(opacity / (1 - opacity))
    columns = [*centres.T, logit, *np.log(sigmas).T, w, x, y, z]
    names = ["x", "y", "z", "opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(centres)}"]
    head += [*(f"property float {n}" for n in names), "end_header", ""]
    path.write_bytes("\n".join(head).encode() + np.stack(columns, 1).astype("<f4").tobytes())
    return path


def chair_mesh(shape):
    return trimesh.Trimesh(shape.vertices(), shape.triangles(), process=False)


def transforms(path, cameras):
    content = camera_export.transforms(cameras, list(cameras.names), [""] * len(cameras))
    path.write_text(json.dumps(content))
    return path


def test_a_chairs_splat_has_the_chairs_silhouettes(chair, tmp_path):
    shape, cameras = chair.build(CHAIR), circle(6, 320)
    path = write(tmp_path / "s.ply", *discs(chair_mesh(shape), COUNT), np.full(COUNT, 0.9))
    true = silhouettes(shape, cameras.K, cameras.cam_from_world, cameras.sizes)
    for drawn, mask in zip(splat_rendering.silhouettes(splat_rendering.read(path), cameras), true, strict=True):
        assert iou(drawn, mask) >= 0.93


def test_one_round_gaussian_is_a_disc():
    """Opacity o at distance r from the middle is o exp(-r^2 / 2 s^2): the silhouette ends where that is one half."""
    cameras, sigma, opacity = circle(1, 400), 0.1, 0.9
    splat = Splat(np.zeros((1, 3)), sigma * np.eye(3)[None], np.array([opacity]))
    spread = sigma * cameras.K[0, 0, 0] / 2.3
    row, column = np.mgrid[:400, :400] + 0.5
    radius = np.hypot(column - 200, row - 200)
    disc = radius <= spread * np.sqrt(2 * np.log(opacity / 0.5))
    assert iou(splat_rendering.silhouettes(splat, cameras)[0], disc) > 0.99
    value = splat_rendering.opacity(splat, cameras, 0)
    np.testing.assert_allclose(
        value, np.where(radius < 3 * spread, opacity * np.exp(-0.5 * (radius / spread) ** 2), 0), atol=0.02
    )


def test_a_long_gaussian_lies_as_it_is_turned():
    """Twice as long along its own x axis, turned by 30 degrees about the viewing direction."""
    cameras = circle(1, 400)
    turn = cameras.cam_from_world[0, :3, :3].T @ Rotation.from_euler("z", 30, degrees=True).as_matrix()
    splat = Splat(np.zeros((1, 3)), (turn * np.array([0.12, 0.06, 0.01]))[None], np.array([0.95]))
    mask = splat_rendering.silhouettes(splat, cameras)[0]
    points = np.argwhere(mask)[:, ::-1] - 199.5
    values, vectors = np.linalg.eigh(np.cov(points.T))
    assert np.sqrt(values[1] / values[0]) == pytest.approx(2, rel=0.03)
    assert abs(vectors[:, 1] @ (np.cos(np.radians(30)), np.sin(np.radians(30)))) > 0.999


def test_opacities_multiply_what_they_let_through():
    cameras, splat = circle(1, 64), Splat(np.zeros((1, 3)), 0.2 * np.eye(3)[None], np.array([0.4]))
    one = splat_rendering.opacity(splat, cameras, 0)
    three = splat_rendering.opacity(splat.subset(np.zeros(3, int)), cameras, 0)
    np.testing.assert_allclose(three, 1 - (1 - one) ** 3)
    behind = Splat(cameras.centres() * 2, splat.axes, splat.opacity)
    assert not splat_rendering.opacity(behind, cameras, 0).any()


@pytest.fixture
def room(chair, tmp_path, rng):
    """A chair on a floor with a wall behind it and floaters, as a splat file; the chair; cameras as transforms.json."""
    shape, cameras = chair.build(CHAIR), circle()
    mesh = chair_mesh(shape)
    low = shape.vertices()[:, 2].min()
    floor = trimesh.creation.box((6, 6, 0.002))
    floor.apply_translation((0, 0, low - 0.001))
    wall = trimesh.creation.box((6, 0.002, 3))
    wall.apply_translation((0, 2.6, low + 1.5))
    parts = [discs(mesh, COUNT), discs(floor, 6000, 0.8), discs(wall, 3000, 0.8)]
    centres, rotations, sigmas = (np.concatenate(p) for p in zip(*parts, strict=True))
    dust = rng.uniform(-1.5, 1.5, (300, 3))
    centres = np.concatenate([centres, dust])
    rotations = np.concatenate([rotations, np.tile(np.eye(3), (300, 1, 1))])
    sigmas = np.concatenate([sigmas, np.full((300, 3), 0.02)])
    path = write(tmp_path / "room.ply", centres, rotations, sigmas, rng.uniform(0.7, 0.95, len(centres)))
    return path, shape, transforms(tmp_path / "transforms.json", cameras), cameras


def test_a_chair_in_a_room_becomes_rgba_pictures_of_the_chair_alone(room, tmp_path):
    path, shape, file, cameras = room
    found = photo_source.run(path, tmp_path / "work", file, VideoOptions())
    assert found.cameras is not None
    assert len(found.cameras.names) == len(cameras)
    small = cameras.scaled(0.5)
    true = silhouettes(shape, small.K, small.cam_from_world, small.sizes)
    for name, mask in zip(found.cameras.names, true, strict=True):
        picture = cv2.imread(str(found.folder / name), cv2.IMREAD_UNCHANGED)
        assert picture.shape == (320, 320, 4)
        assert iou(picture[..., 3] > 0, mask) >= 0.9, name
    again = photo_source.run(path, tmp_path / "work", file, VideoOptions())
    assert again.key == found.key, "the same files, the same pictures"


def test_cameras_of_another_world_are_refused(room, tmp_path, capsys):
    path, _, file, cameras = room
    away = cameras.cam_from_world.copy()
    away[:, :3, 3] += 400
    transforms(file, Cameras(cameras.names, cameras.K, away, cameras.sizes))
    out = tmp_path / "out"
    assert main([str(path), "--cameras", str(file), "--out", str(out)]) == 2
    message = capsys.readouterr().err
    assert "same world" in message
    assert "room.ply" in message
    assert not out.exists()


def test_cameras_belong_to_photos_and_splats(tmp_path, capsys):
    trimesh.creation.box().export(tmp_path / "box.obj")
    file = transforms(tmp_path / "transforms.json", circle(2))
    assert main([str(tmp_path / "box.obj"), "--cameras", str(file), "--out", str(tmp_path / "out")]) == 2
    assert "--cameras is not for a mesh" in capsys.readouterr().err


def test_what_a_splat_needs_is_named(tmp_path, rng):
    path = write(
        tmp_path / "s.ply", rng.random((9, 3)), np.tile(np.eye(3), (9, 1, 1)), np.ones((9, 3)), np.full(9, 0.5)
    )
    assert splat_views.is_splat(path)
    path.write_bytes(path.read_bytes().replace(b"rot_2", b"odd_2"))
    with pytest.raises(InputError, match=r"s\.ply .* without four rotations"):
        splat_rendering.read(path)


@pytest.mark.slow
def test_a_splat_with_cameras_to_the_end(room, tmp_path):
    path, _, file, _ = room
    out = tmp_path / "out"
    assert main([str(path), "--class", "paper/chair", "--cameras", str(file), "--out", str(out)]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["mean_iou"] > 0.85
    assert {k: report["params"][k] for k in ("legs", "arms", "back")} == {k: CHAIR[k] for k in ("legs", "arms", "back")}
    assert report["registered"]["how"] == "8 views of the splat, cameras given"
