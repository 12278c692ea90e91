"""Cameras from COLMAP models and transforms.json: what was written is read back; other images' cameras are refused."""

import json
import shutil
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

from recon.cameras import known_cameras
from recon.cameras.intrinsics import held, parse_focal_mm, parse_intrinsics
from recon.cameras.pair_selection import camera_groups
from recon.command import main
from recon.files import colmap_model, transforms_json
from recon.files import frames as frames_stage
from recon.files.video import VideoOptions
from recon.geometry.floor_from_masks import floor, floor_under
from recon.masks import silhouettes
from recon.outputs import camera_export
from recon.pipelines import photo_source
from recon.scene import Cameras, Frames, InputError, Poses

SHIPPED = Path(__file__).parents[2] / "datasets" / "samples" / "chair"
SIZE = (96, 72)
GLOBAL_FLIP = np.diag([1.0, -1, -1, 1])


def random_poses(rng, count):
    out = np.tile(np.eye(4), (count, 1, 1))
    out[:, :3, :3] = Rotation.random(count, random_state=int(rng.integers(1 << 30))).as_matrix()
    out[:, :3, 3] = rng.normal(size=(count, 3))
    return out


def photograph(path, seed=0, size=SIZE, alpha=False):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 255, (size[1], size[0], 4 if alpha else 3)).astype(np.uint8)
    if alpha:
        image[..., 3] = 0
        image[20:50, 30:60, 3] = 255
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path)


@pytest.fixture
def scene(rng, tmp_path):
    """Five random cameras with photos and points, as recon's own writer leaves them; shared = one set of intrinsics."""
    names = tuple(f"p{i}.png" for i in range(5))
    for i, name in enumerate(names):
        photograph(tmp_path / "src" / name, i)
    K = np.tile(np.eye(3), (5, 1, 1))
    K[:, 0, 0], K[:, 1, 1] = rng.uniform(80, 120, (2, 5))
    K[:, 0, 2], K[:, 1, 2] = rng.uniform(46, 50, 5), rng.uniform(34, 38, 5)
    cameras = Cameras(names, K, random_poses(rng, 5), np.tile(SIZE, (5, 1)))
    points = rng.normal(size=(150, 3))
    poses = Poses(cameras, tuple(tmp_path / "src" / n for n in names), points, np.zeros((150, 5), bool))
    camera_export.write(tmp_path / "set", poses)
    for i in range(5):  # which transforms.json names
        draw_mask(tmp_path / "masks" / f"p{i}.png", i)
    return poses


def draw_mask(path, left):
    """A white box that begins in another column for every photo."""
    mask = np.zeros(SIZE[::-1], np.uint8)
    mask[20:50, 10 + 5 * left : 60] = 255
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), mask)


def write_binary(folder, poses, model=1, extra=()):
    """A COLMAP model in binary: one camera an image, points each seen by two images."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras, V = poses.cameras, len(poses.cameras)
    with (folder / "cameras.bin").open("wb") as f:
        f.write(struct.pack("<Q", V))
        for i, (K, (w, h)) in enumerate(zip(cameras.K, cameras.sizes, strict=True)):
            params = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *extra]
            f.write(struct.pack(f"<iiQQ{len(params)}d", i + 7, model, w, h, *params))
    with (folder / "images.bin").open("wb") as f:
        f.write(struct.pack("<Q", V))
        for i, name in enumerate(cameras.names):
            x, y, z, w = Rotation.from_matrix(cameras.cam_from_world[i, :3, :3]).as_quat()
            f.write(struct.pack("<I7di", i + 1, w, x, y, z, *cameras.cam_from_world[i, :3, 3], i + 7))
            f.write(name.encode() + b"\0" + struct.pack("<Q", i) + struct.pack("<ddq", 1.0, 2.0, -1) * i)
    with (folder / "points3D.bin").open("wb") as f:
        f.write(struct.pack("<Q", len(poses.points)))
        for n, p in enumerate(poses.points):
            f.write(struct.pack("<Q3d3BdQ", n, *p, 1, 2, 3, 0.5, 2) + struct.pack("<4I", 1, 0, 2 + n % (V - 1), 0))


def gathered(photos, cameras, tmp_path):
    """What the pipeline does with photos and cameras, up to the poses."""
    given = known_cameras.gather(photos, cameras, tmp_path / "work" / "given")
    shots = frames_stage.run(given.folder, tmp_path / "work", frames_stage.FramesOptions(same_difference=-1))
    return known_cameras.place(shots, given, tmp_path / "work")


def same(found, cameras):
    assert found.names == cameras.names
    np.testing.assert_allclose(found.K, cameras.K, atol=1e-9)
    np.testing.assert_allclose(found.cam_from_world, cameras.cam_from_world, atol=1e-9)
    np.testing.assert_array_equal(found.sizes, cameras.sizes)


def test_text_model_and_transforms_are_read_as_written(scene, tmp_path):
    text = tmp_path / "set"
    same(gathered(text, text, tmp_path).cameras, scene.cameras)
    np.testing.assert_array_equal(colmap_model.read(text / "sparse" / "0").points, scene.points)
    other = gathered(text, text / "transforms.json", tmp_path)
    same(other.cameras, scene.cameras)
    np.testing.assert_allclose(other.points, scene.points, rtol=1e-6, err_msg="the file leads to the model's points")


def test_binary_model_with_tracks(scene, tmp_path):
    write_binary(tmp_path / "model" / "sparse" / "0", scene)
    assert known_cameras.find(tmp_path / "model") == tmp_path / "model" / "sparse" / "0"
    poses = gathered(tmp_path / "src", tmp_path / "model", tmp_path)
    same(poses.cameras, scene.cameras)
    np.testing.assert_array_equal(poses.points, scene.points)
    assert (poses.tracks.sum(1) == 2).all()
    assert poses.tracks[:, 0].all()


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_model_that_is_cut_off(scene, tmp_path, name):
    write_binary(tmp_path / "model", scene)
    file = tmp_path / "model" / name
    whole = file.read_bytes()
    for length in (0, 5, 9, 60, len(whole) - 3):
        file.write_bytes(whole[:length])
        with pytest.raises(InputError, match="damaged"):
            colmap_model.read(tmp_path / "model")


def test_photos_are_undistorted_by_the_lens_of_the_file(scene, tmp_path):
    write_binary(tmp_path / "model", scene, model=4, extra=[-0.1, 0, 0, 0])
    poses = gathered(tmp_path / "src", tmp_path / "model", tmp_path)
    same(poses.cameras, scene.cameras)
    assert [lens.model for lens in poses.lenses] == ["OPENCV"] * 5
    assert all(p.parent.name == "undistorted" for p in poses.paths)


def test_photos_of_another_size_and_orientation(scene, tmp_path):
    """Cameras of half the size; photos that lie on their side with an EXIF note to turn them."""
    for i, name in enumerate(scene.cameras.names):
        stored = Image.open(tmp_path / "src" / name).resize((SIZE[0] * 2, SIZE[1] * 2))
        exif = Image.Exif()
        exif[0x0112] = (1, 6, 3, 8, 1)[i]
        stored.convert("RGB").save(tmp_path / "set" / "images" / f"p{i}.jpg", exif=exif)
        (tmp_path / "set" / "images" / name).unlink()
    poses = gathered(tmp_path / "set", tmp_path / "set", tmp_path)
    point = np.array([0.1, -0.2, 3.0])
    for i in range(5):
        world = np.linalg.inv(scene.cameras.cam_from_world[i]) @ [*point, 1]
        u, v = (scene.cameras.K[i] @ point)[:2] / point[2] * 2
        turned = [(u, v), (144 - v, u), (192 - u, 144 - v), (v, 192 - u), (u, v)][i]
        local = (poses.cameras.cam_from_world[i] @ world)[:3]
        seen = poses.cameras.K[i] @ local
        np.testing.assert_allclose(seen[:2] / seen[2], turned, atol=1e-6)


def nerf(folder, count=4, **values):
    """NeRF's own layout: camera_angle_x only, file paths without ending, RGBA."""
    poses = random_poses(np.random.default_rng(1), count)
    frames = []
    for i in range(count):
        photograph(folder / "train" / f"r_{i}.png", i, alpha=True)
        frames.append(
            {"file_path": f"./train/r_{i}", "transform_matrix": (np.linalg.inv(poses[i]) @ GLOBAL_FLIP).tolist()}
        )
    (folder / "transforms_train.json").write_text(json.dumps({**values, "frames": frames}))
    return poses


def test_camera_angle_and_alpha(tmp_path):
    true = nerf(tmp_path / "nerf", camera_angle_x=0.7)
    poses = gathered(tmp_path / "nerf", tmp_path / "nerf", tmp_path)
    np.testing.assert_allclose(poses.cameras.cam_from_world, true, atol=1e-9)
    focal = 0.5 * SIZE[0] / np.tan(0.35)
    np.testing.assert_allclose(poses.cameras.K, np.tile([[focal, 0, 48], [0, focal, 36], [0, 0, 1]], (4, 1, 1)))
    assert len(poses.points) == 0, "alpha channels need no room"
    shots = frames_stage.run(tmp_path / "work" / "given", tmp_path / "w2")
    assert all(a is not None for a in shots.alpha)
    assert poses.lenses == (None,) * 4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("frames"), "frames"),
        (lambda c: c.pop("camera_angle_x"), "focal length is unknown"),
        (lambda c: c.update(camera_angle_x="wide"), "not a transforms.json"),
        (lambda c: c.update(fl_x=float("nan")), "no numbers"),
        (lambda c: c.update(fl_x=1e-300), "no lens has"),
        (lambda c: c.update(camera_angle_x=0), "between 0 and pi"),
        (lambda c: c.update(camera_angle_x=50), "between 0 and pi"),
        (lambda c: c.update(w=float("inf"), h=72), "no picture's"),
        (lambda c: c.update(w=1e30, h=72), "no picture's"),
        (lambda c: c.update(cx=1e9), "far outside"),
        (lambda c: c["frames"][1].update(transform_matrix=np.zeros((4, 4)).tolist()), "not a rotation"),
        (lambda c: c["frames"][1].update(transform_matrix=[[1, 2]]), "not"),
        (lambda c: c.update(camera_model="EQUIRECTANGULAR"), "panorama"),
        (lambda c: c.update(w=0, h=0), "size is 0 x 0"),
    ],
)
def test_broken_transforms(tmp_path, change, message):
    nerf(tmp_path, camera_angle_x=0.7)
    file = tmp_path / "transforms_train.json"
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        transforms_json.read(file, lambda name: SIZE)


def test_missing_images(scene, tmp_path):
    images = tmp_path / "set" / "images"
    (images / "p1.png").unlink()
    shutil.rmtree(tmp_path / "src")
    given = known_cameras.gather(tmp_path / "set", tmp_path / "set", tmp_path / "g")
    assert given.names == ("p0.png", "p2.png", "p3.png", "p4.png")
    assert "1 of 5" in given.warnings[0]
    assert "p1.png" in given.warnings[0]
    for i in (0, 2, 3):
        (images / f"p{i}.png").unlink()
    with pytest.raises(InputError, match=r"4 of 5 images .* missing \(p0.png, p1.png, p2.png, \.\.\.\)"):
        known_cameras.gather(tmp_path / "set", tmp_path / "set", tmp_path / "g2")
    assert not (tmp_path / "g2").exists(), "nothing half-written"


def test_photos_that_the_file_does_not_have_are_named(scene, tmp_path):
    photograph(tmp_path / "src" / "extra.png", 9)
    given = known_cameras.gather(tmp_path / "src", tmp_path / "set", tmp_path / "g")
    assert len(given.names) == 5
    assert given.others == ("extra.png",)
    assert (tmp_path / "g" / "extra.png").exists()
    for i in range(6):
        photograph(tmp_path / "src" / f"depth{i}.png", 9)
    given = known_cameras.gather(tmp_path / "src", tmp_path / "set", tmp_path / "g")
    assert given.others == ()
    assert "7 photos are left out" in given.warnings[0]
    assert "--input photos" in given.warnings[0]


def test_masks_that_the_file_names(scene, tmp_path):
    """Relative to the file, as the user's own masks; the COLMAP model beside it names none."""
    file = tmp_path / "set" / "transforms.json"
    found = photo_source.run(tmp_path / "set", tmp_path / "work", file, VideoOptions())
    assert found.cameras.masked
    shots = frames_stage.run(found.folder, tmp_path / "work", frames_stage.FramesOptions(same_difference=-1))
    poses = known_cameras.place(shots, found.cameras, tmp_path / "work")
    masks = silhouettes.run(shots, poses, found.cameras.masks, tmp_path / "work")
    assert set(masks.source) == {"user"}
    for i, mask in enumerate(masks.masks):
        assert np.flatnonzero(mask.any(0))[0] == 10 + 5 * i
    draw_mask(tmp_path / "masks" / "p2.png", 7)
    assert photo_source.run(tmp_path / "set", tmp_path / "work", file, VideoOptions()).key != found.key
    assert known_cameras.gather(tmp_path / "set", tmp_path / "set", tmp_path / "g").masks is None


def test_a_mask_that_is_missing_is_named(scene, tmp_path, capsys):
    (tmp_path / "masks" / "p3.png").unlink()
    file, out = tmp_path / "set" / "transforms.json", tmp_path / "out"
    assert main([str(tmp_path / "set"), "--cameras", str(file), "--out", str(out)]) == 2
    message = capsys.readouterr().err.splitlines()[-1]
    assert "frame images/p3.png" in message
    assert "masks/p3.png is missing" in message
    assert not out.exists(), "nothing half-written"


def test_a_model_of_other_images(scene, tmp_path):
    for i in range(4):
        photograph(tmp_path / "mine" / f"IMG_{i}.png", i)
    model = tmp_path / "elsewhere"
    write_binary(model, scene)
    with pytest.raises(InputError, match=r"COLMAP model of other images .*5 of 5") as caught:
        known_cameras.gather(tmp_path / "mine", model, tmp_path / "g")
    assert caught.value.exit_code == 2
    for i in range(5):  # the same names, but another shape
        photograph(tmp_path / "mine" / f"p{i}.png", i, (72, 96))
    with pytest.raises(InputError, match="another shape"):
        known_cameras.gather(tmp_path / "mine", model, tmp_path / "g")


def test_cameras_that_are_not_there(tmp_path, capsys):
    photograph(tmp_path / "mine" / "a.png")
    for cameras, message in ((tmp_path / "no", "does not exist"), (tmp_path / "mine", "holds no cameras")):
        assert main([str(tmp_path / "mine"), "--cameras", str(cameras), "--out", str(tmp_path / "o")]) == 2
        assert message in capsys.readouterr().err


def test_intrinsics_for_the_working_copies():
    names = ("a.jpg", "b.jpg")
    sizes, original = np.array([[1000, 750], [750, 1000]]), np.array([[4000, 3000], [3000, 4000]])
    shots = Frames(names, tuple(map(Path, names)), sizes, np.full(2, np.nan), np.ones(2), (None, None), (), original)
    rows = held(shots, parse_intrinsics("3200,3200,2010,1490"), None)
    np.testing.assert_allclose(rows, [[800, 800, 502.5, 372.5], [800, 800, 372.5, 502.5]])
    groups = camera_groups(shots, rows)
    assert [g["model"] for g in groups] == ["SIMPLE_RADIAL"] * 2
    assert groups[0]["params"] == [800, 502.5, 372.5, 0]
    np.testing.assert_allclose(held(shots, None, parse_focal_mm("28"))[:, 0], 28 / 36 * 1000)
    np.testing.assert_allclose(held(shots, None, parse_focal_mm("4,5"))[:, 1], 800)
    assert camera_groups(shots, held(shots, parse_intrinsics("3200,3300,2000,1500"), None))[0]["model"] == "PINHOLE"
    with pytest.raises(InputError, match="principal point"):
        held(shots, (800, 800, 500, 375), None)
    for bad in ("", "1,2,3", "a,b,c,d", "1,2,3,-4", "1,2,nan,4"):
        with pytest.raises(InputError, match="--intrinsics wants"):
            parse_intrinsics(bad)
    for bad in ("", "0", "x", "1,2,3", "4000"):
        with pytest.raises(InputError, match="--focal-mm"):
            parse_focal_mm(bad)


def true_transforms(folder, masks=False):
    """The shipped photos with their true cameras as a transforms.json in `folder`."""
    views = json.loads((SHIPPED / "truth" / "cameras.json").read_text())["views"]
    cameras = Cameras(
        tuple(v["name"] for v in views),
        np.array([v["K"] for v in views]),
        np.array([v["cam_from_world"] for v in views]),
        np.array([[v["width"], v["height"]] for v in views]),
    )
    files = [str(SHIPPED / "photos" / n) for n in cameras.names]
    if masks:
        files = [str(folder / f"{Path(n).stem}.png") for n in cameras.names]
        for n, file in zip(cameras.names, files, strict=True):
            mask = cv2.imread(str(SHIPPED / "truth" / "masks" / f"{Path(n).stem}.png"), cv2.IMREAD_GRAYSCALE)
            cv2.imwrite(file, np.dstack([cv2.imread(str(SHIPPED / "photos" / n)), mask]))
    content = camera_export.transforms(cameras, files, [""] * len(files))
    (folder / "transforms.json").write_text(json.dumps(content))
    return cameras


def test_the_floor_under_rgba_photos(tmp_path):
    """No points, no room: the floor (z = 0) comes from the alpha channels."""
    views = json.loads((SHIPPED / "truth" / "cameras.json").read_text())["views"][::3]
    cameras = Cameras(
        tuple(v["name"] for v in views),
        np.array([v["K"] for v in views]),
        np.array([v["cam_from_world"] for v in views]),
        np.array([[v["width"], v["height"]] for v in views]),
    )
    files = [SHIPPED / "truth" / "masks" / f"{Path(v['name']).stem}.png" for v in views]
    plane, height = floor_under(cameras, [cv2.imread(str(f), cv2.IMREAD_GRAYSCALE) > 127 for f in files])
    assert plane[2] > np.cos(np.radians(1))
    assert abs(plane[3]) < 0.02, "metres"
    assert abs(height - 0.948) < 0.04
    wrong = np.array([0, 0, 1, -0.45])  # the seat, found by points on the object
    masks = [cv2.imread(str(f), cv2.IMREAD_GRAYSCALE) > 127 for f in files]
    np.testing.assert_allclose(floor(wrong, cameras, masks, True), plane)
    np.testing.assert_array_equal(floor(wrong, cameras, masks, False), wrong)
    near = np.array([0, 0, 1, 0.005])
    np.testing.assert_array_equal(floor(near, cameras, masks, True), near)


def test_the_floor_under_masks_whose_cameras_are_a_little_off(tmp_path):
    """As structure from motion gives them when it sees nothing but a plain object: no cell is in 85 % of the masks."""
    views = json.loads((SHIPPED / "truth" / "cameras.json").read_text())["views"][::3]
    poses = np.array([v["cam_from_world"] for v in views])
    turns = Rotation.from_rotvec(np.random.default_rng(0).normal(size=(len(poses), 3)) * 0.05).as_matrix()
    poses[:, :3] = turns @ poses[:, :3]
    cameras = Cameras(
        tuple(v["name"] for v in views),
        np.array([v["K"] for v in views]),
        poses,
        np.array([[v["width"], v["height"]] for v in views]),
    )
    files = [SHIPPED / "truth" / "masks" / f"{Path(v['name']).stem}.png" for v in views]
    masks = [cv2.imread(str(f), cv2.IMREAD_GRAYSCALE) > 127 for f in files]
    posts = [m & (np.arange(800) % 40 < 12) for m in masks]  # thin parts alone: nothing is left of them at 85 %
    plane, _ = floor_under(cameras, posts)
    assert plane[2] > np.cos(np.radians(8))


@pytest.mark.slow
@pytest.mark.parametrize("masks", [False, True], ids=["photos", "rgba"])
def test_true_cameras_to_the_end(tmp_path, masks):
    """The shipped photos with their true cameras: no structure from motion, the right front, a close shape."""
    from datasets.photosets import read_photoset
    from procmodels import load
    from recon.evaluate import chair
    from recon.evaluate.data.scenes import misaligned
    from recon.evaluate.metrics import chamfer

    folder = tmp_path / "scene"
    folder.mkdir()
    true_transforms(folder, masks)
    assert main([str(folder), "--out", str(tmp_path / "out"), "--height", "0.948", "--allow-outside"]) == 0
    truth, model = read_photoset(SHIPPED), load("chair")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["registered"]["n"] == 28
    assert not (tmp_path / "out" / ".recon" / "poses").exists(), "cameras were given"
    shape, cameras, canonical = chair.read_result(model, tmp_path / "out")
    names = tuple(n.rsplit(".", 1)[0] + ".jpg" for n in cameras.names)
    cameras = Cameras(names, cameras.K, cameras.cam_from_world, cameras.sizes)
    assert abs(misaligned(truth, cameras, canonical).yaw) < 45
    assert chamfer(shape.to_trimesh(), trimesh.load_mesh(truth.mesh)) <= 0.0035
