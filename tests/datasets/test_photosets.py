"""Photo sets: cameras, masks, mesh and photos must tell the same story."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image

from datasets import camera_rings, floor_textures, ground_truth, photosets, staging
from datasets.photosets import Photoset, PhotosetError, PhotosetOptions, read_photoset, render_photoset
from procmodels.studio import render

SAMPLE = Path(__file__).parents[2] / "datasets" / "samples" / "chair"
SMALL = PhotosetOptions(views=2, width=128, height=96, samples=4, object_height=0.8)


def write_green_l(path: Path) -> Path:
    """A green L-shaped seat (no mirror symmetry), Y-up, back towards -z, as an OBJ with its MTL."""
    seat = trimesh.creation.box((0.5, 0.3, 0.5))
    back = trimesh.creation.box((0.2, 0.8, 0.1))
    back.apply_translation((-0.15, 0.25, -0.2))
    mesh = trimesh.util.concatenate([seat, back])
    lines = ["mtllib l.mtl", "usemtl green"]
    lines += ["v {:.6f} {:.6f} {:.6f}".format(*v) for v in mesh.vertices]
    lines += ["f {} {} {}".format(*(f + 1)) for f in mesh.faces]
    path.with_name("l.mtl").write_text("newmtl green\nKd 0 0.8 0\nKs 0 0 0\n")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def green(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Photoset]:
    folder = tmp_path_factory.mktemp("green")
    mesh = write_green_l(folder / "l.obj")
    return mesh, render_photoset(mesh, folder / "set", SMALL)


def filled_triangles(photoset: Photoset, i: int, detail: int = 8) -> np.ndarray:
    """(H, W) bool silhouette of the true mesh by projecting and filling its triangles: no rays involved."""
    mesh = trimesh.load_mesh(photoset.mesh, process=False)
    cam_from_canonical = photoset.cam_from_world[i] @ photoset.world_from_canonical
    pixels, depth = camera_rings.project(np.asarray(mesh.vertices), photoset.K[i], cam_from_canonical)
    assert (depth > 0).all()
    width, height = photoset.sizes[i]
    canvas = np.zeros((height * detail, width * detail), np.uint8)
    # OpenCV's whole numbers are pixel middles: half a pixel less than ours. Four bits of fraction.
    corners = np.rint((pixels * detail - 0.5) * 16).astype(np.int32)
    for face in mesh.faces:
        cv2.fillConvexPoly(canvas, corners[face], 255, cv2.LINE_8, 4)
    return cv2.resize(canvas, (int(width), int(height)), interpolation=cv2.INTER_AREA) >= 128


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def load_mask(path: Path) -> np.ndarray:
    return np.array(Image.open(path)) > 0


def test_a_set_is_complete_and_well_shaped(green: tuple[Path, Photoset]) -> None:
    photoset = green[1]
    assert photoset.names == ("photo_000.jpg", "photo_001.jpg")
    assert photoset.K.shape == (2, 3, 3)
    assert photoset.cam_from_world.shape == (2, 4, 4)
    assert (photoset.sizes == (128, 96)).all()
    rotation = photoset.cam_from_world[:, :3, :3]
    np.testing.assert_allclose(rotation @ rotation.transpose(0, 2, 1), np.tile(np.eye(3), (2, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(rotation), 1, atol=1e-9)
    np.testing.assert_allclose(photoset.K[0], [[32 / 36 * 128, 0, 64], [0, 32 / 36 * 128, 48], [0, 0, 1]])
    assert all(Image.open(p).size == (128, 96) for p in (*photoset.photos, *photoset.masks))
    assert not list(photoset.mesh.parents[1].rglob("*.tmp"))


def test_the_true_mesh_is_canonical_and_stands_on_the_floor(green: tuple[Path, Photoset]) -> None:
    photoset = green[1]
    vertices = np.asarray(trimesh.load_mesh(photoset.mesh, process=False).vertices)
    np.testing.assert_allclose(vertices.min(0), -vertices.max(0), atol=1e-6)
    assert np.ptp(vertices, axis=0).max() == pytest.approx(1, abs=1e-6)
    back = vertices[vertices[:, 2] > 0.1]
    assert back[:, 1].min() > 0.1  # it faces -Y, so the back is at +Y
    assert back[:, 0].max() < 0.1  # right stays right: not mirrored
    world = staging.apply(photoset.world_from_canonical, vertices)
    assert world[:, 2].min() == pytest.approx(0, abs=1e-6)
    assert world[:, 2].max() == pytest.approx(SMALL.object_height, abs=1e-6)
    assert np.linalg.det(photoset.world_from_canonical) > 0


def test_masks_cameras_mesh_and_photos_agree(green: tuple[Path, Photoset]) -> None:
    photoset = green[1]
    for i, path in enumerate(photoset.photos):
        mask = load_mask(photoset.masks[i])
        assert iou(mask, filled_triangles(photoset, i)) > 0.98
        red, of_green, blue = np.moveaxis(np.array(Image.open(path)).astype(float), -1, 0)
        seen = (of_green > 1.7 * red + 5) & (of_green > 1.7 * blue + 5)  # no patch of floor is that green
        seen = cv2.morphologyEx(seen.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
        assert iou(mask, seen) > 0.9


def test_photos_carry_the_focal_length(green: tuple[Path, Photoset]) -> None:
    exif = Image.open(green[1].photos[0]).getexif().get_ifd(0x8769)
    diagonal = np.hypot(128, 96)
    assert exif[0xA405] * diagonal / 43.2666 == pytest.approx(SMALL.focal, rel=0.02)
    assert float(exif[0x920A]) / 6.17 * 128 == pytest.approx(SMALL.focal, rel=0.001)


def test_an_interrupted_run_goes_on(
    green: tuple[Path, Photoset], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh, whole = green
    shutil.copytree(whole.mesh.parents[1], tmp_path / "set.partial")
    (tmp_path / "set.partial" / "photos" / "photo_001.jpg").unlink()
    shots = []

    def shoot(shot: render.Shot, path: Path) -> None:
        shots.append(shot)
        Image.new("RGB", (128, 96)).save(path)

    monkeypatch.setattr(render, "shoot", shoot)
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "README.md").write_text("kept")
    again = render_photoset(mesh, tmp_path / "set", SMALL)
    assert len(shots) == 1
    np.testing.assert_allclose(np.linalg.inv(shots[0].world_from_cam), whole.cam_from_world[1], atol=1e-12)
    assert again.photos[0].read_bytes() == whole.photos[0].read_bytes()
    assert (tmp_path / "set" / "README.md").is_file()
    assert not (tmp_path / "set.partial").exists()
    render_photoset(mesh, tmp_path / "set", dataclasses.replace(SMALL, threads=1))
    assert len(shots) == 1  # finished: read back
    with pytest.raises(PhotosetError, match="other options"):
        render_photoset(mesh, tmp_path / "set", dataclasses.replace(SMALL, seed=1))


def test_reading_complains_about_what_is_missing(green: tuple[Path, Photoset], tmp_path: Path) -> None:
    with pytest.raises(PhotosetError, match="not a finished photo set"):
        read_photoset(tmp_path)
    shutil.copytree(green[1].mesh.parents[1], tmp_path / "set")
    (tmp_path / "set" / "truth" / "masks" / "photo_001.png").unlink()
    with pytest.raises(PhotosetError, match=r"photo_001\.png"):
        read_photoset(tmp_path / "set")
    (tmp_path / "set" / "truth" / "cameras.json").write_text("{}")
    with pytest.raises(PhotosetError, match="broken"):
        read_photoset(tmp_path / "set")


@pytest.mark.parametrize("front", ["x", "-x", "y", "-y", "z", "-z"])
@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
def test_axes_turn_but_never_mirror(up: str, front: str) -> None:
    options = PhotosetOptions(up=up, front=front)
    points = np.random.default_rng(0).uniform(-1, 3, (20, 3))
    if up[-1] == front[-1]:
        with pytest.raises(PhotosetError, match="one axis"):
            staging.canonical_from_file(points, ".obj", options)
        return
    turn = staging.canonical_from_file(points, ".obj", options)[:3, :3]
    turn = turn / np.cbrt(np.linalg.det(turn))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) > 0
    np.testing.assert_allclose(turn @ staging.AXES[up], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(turn @ staging.AXES[front], [0, -1, 0], atol=1e-12)


@pytest.mark.parametrize("extents", [(0.4, 0.4, 0.9), (2.0, 1.4, 0.6), (1.5, 0.3, 0.05)])
def test_the_whole_object_fills_every_picture(extents: tuple[float, float, float]) -> None:
    points = np.asarray(trimesh.creation.box(extents).vertices)
    options = PhotosetOptions(views=12)
    plan = staging.plan(points, np.zeros((0, 3), int), ".ply", options)
    world = staging.apply(plan.world_from_canonical, plan.vertices)
    for pose in plan.cam_from_world:
        pixels, depth = camera_rings.project(world, plan.K, pose)
        assert (depth > 0).all()
        assert (pixels > 0.03 * np.array([800, 600])).all()
        assert (pixels < 0.97 * np.array([800, 600])).all()
        fill = np.ptp(pixels, axis=0) / (800, 600)
        assert fill[1] < 0.75
        reach = np.abs(pixels / (800, 600) - 0.5).max()
        assert fill[1] > 0.6 or reach > 0.45  # a wide thing reaches the margin at the side instead
        assert np.linalg.inv(pose)[2, 3] > 0  # above the floor


def test_the_seed_decides() -> None:
    points = np.asarray(trimesh.creation.box((0.5, 0.6, 0.9)).vertices)
    first, second, other = (
        staging.plan(points, np.zeros((0, 3), int), ".ply", PhotosetOptions(seed=s)).cam_from_world for s in (3, 3, 4)
    )
    np.testing.assert_array_equal(first, second)
    assert np.abs(first - other).max() > 0.01


def test_a_mask_keeps_holes_and_counts_half_pixels() -> None:
    outer = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    vertices = np.concatenate([np.c_[outer * 10.5, np.full(4, 100)], np.c_[outer * 5, np.full(4, 100)]])
    faces = np.array([f for a in range(4) for b in [(a + 1) % 4] for f in [(a, b, b + 4), (a, b + 4, a + 4)]])
    K = camera_rings.intrinsics(60, 40, 100.0)  # one pixel a unit at depth 100
    mask = ground_truth.true_mask(vertices, faces, K, np.eye(4), (60, 40))
    truth = np.zeros((40, 60), bool)
    truth[10:30, 20:40] = True
    truth[15:25, 25:35] = False
    # The outer edge cuts pixels in half, where either answer is right.
    edge = np.zeros_like(truth)
    edge[9:31, 19:41] = True
    edge[10:30, 20:40] = False
    np.testing.assert_array_equal(mask[~edge], truth[~edge])


def test_a_mosaic_is_rich_and_follows_its_seed() -> None:
    first, second, other = (floor_textures.mosaic(300, 200, 60, np.random.default_rng(s)) for s in (0, 0, 1))
    assert first.shape == (200, 300, 3)
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(first, second)
    assert (first != other).mean() > 0.9
    assert first.std() > 30


@pytest.mark.parametrize(
    "change", [{"views": 1}, {"width": 0}, {"up": "w"}, {"object_height": float("nan")}, {"seed": -1}, {"samples": 0}]
)
def test_senseless_options_are_refused(change: dict) -> None:
    with pytest.raises(PhotosetError):
        PhotosetOptions(**change)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("none.obj", None, "no such file"),
        ("empty.obj", "", "no surface"),
        ("flat.obj", "v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n", "no height"),
        ("broken.ply", "junk", "cannot read it"),
        ("chair.max", "junk", "cannot read .max"),
    ],
)
def test_the_command_explains_bad_meshes(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, text: str | None, message: str
) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    assert photosets.main([str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
    assert message in capfd.readouterr().err
    assert not list(tmp_path.glob("out*"))


def test_the_command_explains_bad_flags(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for argv in (
        [],
        ["a.obj"],
        ["a.obj", "--sh3f", "b", "--model", "c", "--out", "d"],
        ["a.obj", "--out", "d", "--size", "8"],
    ):
        assert photosets.main(argv) == 2
        assert capsys.readouterr().err.startswith("error: ")
    assert photosets.main(["a.obj", "--out", "d", "--up", "-z", "--front", "-y"]) == 2
    assert "a.obj: no such file" in capsys.readouterr().err


def test_the_shipped_sample_agrees_with_itself() -> None:
    photoset = read_photoset(SAMPLE)
    assert len(photoset.names) == 28
    for i in (0, 9, 20):
        assert iou(load_mask(photoset.masks[i]), filled_triangles(photoset, i, detail=4)) > 0.98
    size = sum(p.stat().st_size for p in SAMPLE.rglob("*") if p.is_file())
    assert size < 5e6
