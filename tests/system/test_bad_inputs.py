"""Bad input through the command: an exit code, one line that names the file and what to do, nothing half-written."""

import json
import struct
import zipfile

import cv2
import numpy as np
import pytest
import trimesh

from recon.command import main
from recon.fitting import shape_fit
from recon.scene import ReconError
from tests.files.test_recognise import TETRAHEDRON, obj, off, ply, stl
from tests.files.test_video import clip

CHAIR = {"width": 0.45, "depth": 0.5, "leg_height": 0.42, "legs": "support", "arms": "none", "back": "hbar"}
NO_FACES = np.zeros((0, 3), int)


def refused(capsys, folder, path, *options, code=2):
    """The last line on stderr, after all that holds for every refusal was checked."""
    out = folder / "out"
    assert main([str(path), "--out", str(out), *map(str, options)]) == code
    message = capsys.readouterr().err
    assert "Traceback" not in message
    lines = message.strip().splitlines()
    assert [line for line in lines if line.startswith("error: ")] == lines[-1:], "one line, the last"
    assert not out.exists(), "nothing half-written"
    return lines[-1]


def target_of(monkeypatch, folder, path, *options):
    """What would be fitted to, with the search itself left out; and the words on the way."""
    seen = []

    def enough(model, target, options):
        seen.append(target)
        raise ReconError("enough")

    monkeypatch.setattr(shape_fit, "run", enough)
    assert main([str(path), "--out", str(folder / "out"), *options]) == 1
    return seen[0]


@pytest.fixture
def surface(chair):
    """(n, 3) vertices and (m, 3) triangles of a chair."""
    shape = chair.build(CHAIR)
    return shape.vertices(), shape.triangles()


@pytest.mark.parametrize("write", [off, stl])
def test_a_mesh_without_faces(tmp_path, capsys, write):
    path = write(tmp_path / "bare.mesh", TETRAHEDRON, NO_FACES)
    assert "bare.mesh is a mesh without faces; export its triangles" in refused(capsys, tmp_path, path)


def test_points_that_are_forced_to_be_a_mesh(tmp_path, capsys, rng):
    path = obj(tmp_path / "points.obj", rng.random((40, 3)), NO_FACES)
    assert "points.obj is a mesh without faces" in refused(capsys, tmp_path, path, "--input", "mesh")


@pytest.mark.parametrize("write", [obj, stl, ply])
def test_a_mesh_whose_corners_are_no_numbers(tmp_path, capsys, surface, write):
    path = write(tmp_path / "a.mesh", np.full_like(surface[0], np.nan), surface[1])
    assert "a.mesh: all 240 faces have corners that are not numbers; export" in refused(capsys, tmp_path, path)


def test_some_corners_that_are_no_numbers_are_left_out(tmp_path, monkeypatch, surface):
    vertices, triangles = surface
    some = vertices.copy()
    some[::40] = np.nan
    target = target_of(monkeypatch, tmp_path, obj(tmp_path / "a.obj", some, triangles))
    assert 200 < len(target.triangles) < len(triangles)
    assert np.isfinite(target.points).all()


def test_inverted_faces_are_the_same_input(tmp_path, monkeypatch, surface):
    vertices, triangles = surface
    outward = target_of(monkeypatch, tmp_path, obj(tmp_path / "a.obj", vertices, triangles))
    inward = target_of(monkeypatch, tmp_path, obj(tmp_path / "b.obj", vertices, triangles[:, ::-1]))
    key = lambda t: sorted(map(tuple, np.sort(t.triangles.reshape(-1, 9).round(9), 1)))  # noqa: E731
    assert key(outward) == key(inward)
    np.testing.assert_allclose(outward.points.min(0), inward.points.min(0), atol=2e-3)


@pytest.mark.slow
def test_a_million_faces_are_read_in_seconds(tmp_path, monkeypatch):
    """As many points are fitted to as of a small mesh."""
    side = 708
    grid = np.stack(np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 2, side), indexing="ij"), 2).reshape(-1, 2)
    vertices = np.column_stack([grid, 0.3 * np.sin(3 * grid[:, 0])])
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    triangles = np.concatenate([np.stack([a, a + side, a + 1], 1), np.stack([a + 1, a + side, a + side + 1], 1)])
    assert len(triangles) > 990_000
    path = tmp_path / "m.ply"
    trimesh.Trimesh(vertices, triangles, process=False).export(path)
    target = target_of(monkeypatch, tmp_path, path)
    assert 10_000 < len(target.points) <= 20_000


def test_two_chairs_in_one_file_are_said(tmp_path, monkeypatch, surface):
    vertices, triangles = surface
    both = (
        np.concatenate([vertices, vertices + np.array([1.3, 0, 0])]),
        np.concatenate([triangles, triangles + len(vertices)]),
    )
    target = target_of(monkeypatch, tmp_path, obj(tmp_path / "pair.obj", *both))
    assert "2 separate objects" in target.warnings[0]
    np.testing.assert_allclose(np.ptp(target.points, axis=0), np.ptp(vertices, axis=0), atol=0.01)


def test_three_points(tmp_path, capsys):
    assert "three.ply has 3 usable points" in refused(capsys, tmp_path, ply(tmp_path / "three.ply", TETRAHEDRON[:3]))


def test_a_splat_without_opacity(tmp_path, capsys, rng):
    points = rng.random((60, 3))
    path = ply(tmp_path / "s.ply", points, (), [("scale_0", points[:, 0]), ("rot_0", points[:, 1])])
    assert "s.ply is a Gaussian splat without opacity" in refused(capsys, tmp_path, path)


def nerf(folder):
    """A transforms.json without its images."""
    frames = [{"file_path": f"images/{i}.png", "transform_matrix": np.eye(4).tolist()} for i in range(4)]
    folder.mkdir()
    (folder / "transforms.json").write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}))
    return folder


def test_cameras_whose_images_are_missing(tmp_path, capsys):
    folder = nerf(tmp_path / "set")
    for path in (folder, folder / "transforms.json"):
        message = refused(capsys, tmp_path, path)
        assert "4 of 4 images named in" in message
        assert "images/0.png" in message
        assert "give the folder that holds its images, with --cameras" in message


def test_a_splat_with_cameras_of_unknown_size(tmp_path, capsys, rng):
    folder = nerf(tmp_path / "set")
    names = ["opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
    path = ply(tmp_path / "s.ply", rng.random((60, 3)), (), [(n, np.ones(60)) for n in names])
    message = refused(capsys, tmp_path, path, "--cameras", folder)
    assert "transforms.json: the size of 0 of 4 cameras is known" in message
    assert "give w and h" in message


def test_a_colmap_model_of_other_images(tmp_path, capsys, rng):
    photos, model = tmp_path / "photos", tmp_path / "model"
    photos.mkdir()
    model.mkdir()
    for i in range(4):
        cv2.imwrite(str(photos / f"p{i}.png"), rng.integers(0, 255, (80, 90, 3)).astype(np.uint8))
    (model / "cameras.txt").write_text("1 PINHOLE 90 80 100 100 45 40\n")
    (model / "images.txt").write_text("".join(f"{i + 1} 1 0 0 0 0 0 {i} 1 other{i}.jpg\n\n" for i in range(4)))
    message = refused(capsys, tmp_path, photos, "--cameras", model)
    assert "is a COLMAP model of other images" in message
    assert "other0.jpg" in message


def test_a_video_cut_short_and_text_called_video(tmp_path, capsys):
    data = clip(tmp_path / "whole.mp4", 20).read_bytes()
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(data[: len(data) // 2])
    assert "cut.mp4 cannot be decoded: it is cut off" in refused(capsys, tmp_path, cut)
    text = tmp_path / "text.mp4"
    text.write_text("hello " * 50)
    assert "text.mp4 is nothing that can be read here" in refused(capsys, tmp_path, text)
    assert "text.mp4 is no video" in refused(capsys, tmp_path, text, "--input", "video")


def test_a_video_whose_pictures_are_wiped_out(tmp_path, capsys):
    """Its container is whole, but there is no key frame to begin with."""
    data, at = bytearray(clip(tmp_path / "whole.avi", 10).read_bytes()), 0
    while (at := data.find(b"00dc", at) + 4) > 3 and at < data.index(b"idx1"):
        (size,) = struct.unpack_from("<I", data, at)
        data[at + 4 : at + 4 + size] = bytes(size)
    path = tmp_path / "keyless.avi"
    path.write_bytes(data)
    message = refused(capsys, tmp_path, path)
    assert "keyless.avi can be decoded: it is cut off, or has no key frame; export it anew" in message


def test_names_that_are_not_what_they_contain(tmp_path, capsys, monkeypatch, rng, surface):
    picture = rng.integers(0, 255, (80, 80, 3)).astype(np.uint8)
    for name, ending in (("png.ply", ".png"), ("jpeg.obj", ".jpg")):
        (tmp_path / name).write_bytes(cv2.imencode(ending, picture)[1].tobytes())
        message = refused(capsys, tmp_path, tmp_path / name)
        assert f"nothing says where the object is in {name}: give --mask FILE" in message
    with zipfile.ZipFile(tmp_path / "zip.obj", "w") as archive:
        archive.writestr("chair.obj", "v 0 0 0")
    assert "zip.obj is a zip file without numpy arrays; unpack it" in refused(capsys, tmp_path, tmp_path / "zip.obj")
    target = target_of(monkeypatch, tmp_path, obj(tmp_path / "obj.glb", *surface))
    assert len(target.triangles) == len(surface[1])


def test_axes_with_a_minus_need_no_equals_sign(tmp_path, monkeypatch, surface):
    path = obj(tmp_path / "a.obj", *surface)
    target = target_of(monkeypatch, tmp_path, path, "--up", "z", "--front", "-y")
    assert (target.ups, target.fronts) == (("z",), ("-y",))


def test_two_objects_in_the_box(tmp_path, rng):
    """The larger is taken, and that is said."""
    from recon.masks import single_mask

    image = np.full((240, 320, 3), 230, np.uint8) + rng.integers(0, 9, (240, 320, 3)).astype(np.uint8)
    image[100:160, 60:120] = image[110:160, 190:240] = (30, 30, 160)
    cv2.imwrite(str(tmp_path / "two.png"), image)
    masked = single_mask.run(tmp_path / "two.png", tmp_path / "work", None, (40, 80, 220, 100))
    assert "two.png shows 2 large separate parts: the largest is taken" in masked.warnings[0]
    columns = np.flatnonzero(masked.mask.any(0))
    assert columns[0] >= 55
    assert columns[-1] <= 125
