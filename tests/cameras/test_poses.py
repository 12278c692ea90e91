"""Placing photos: accuracy on a rendered corner of a room with known cameras, and what is said when it fails."""

import json
import math
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from skimage import data

from recon.cameras import poses, sfm_attempts, sfm_diagnosis, sfm_options
from recon.cameras.pair_selection import camera_groups, image_pairs
from recon.cameras.sfm_options import Attempt, PosesOptions, Rung
from recon.files import frames as frames_stage
from recon.geometry.undistort import undistorted, undistorted_mask
from recon.scene import Cameras, Frames, Lens, Poses, ReconstructionError

SIZE = (480, 360)
K = np.array([[430.0, 0, 240], [0, 430, 180], [0, 0, 1]])
DISTORTION = -0.08
COUNT = 10
SAMPLE = Path(__file__).parents[2] / "datasets" / "samples" / "chair"


def look_at(eye, target):
    """cam_from_world (4, 4), z up in the world."""
    z = np.asarray(target, float) - eye
    z /= np.linalg.norm(z)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    out = np.eye(4)
    out[:3, :3] = np.stack([x, np.cross(z, x), z])
    out[:3, 3] = -out[:3, :3] @ eye
    return out


def shift(by):
    return np.array([[1, 0, by], [0, 1, by], [0, 0, 1.0]])


def room():
    """Three textured squares of side 3 that meet in the origin: (corner, edge, edge, texture)."""
    names = ("coffee", "chelsea", "astronaut", "rocket", "immunohistochemistry", "hubble_deep_field")
    tiles = [cv2.resize(np.ascontiguousarray(getattr(data, n)()[:400, :400, ::-1]), (300, 300)) for n in names]
    x, y, z = np.eye(3) * 3
    for i, (a, b) in enumerate([(x, y), (y, z), (z, x)]):
        four = [np.rot90(tiles[(2 * i + j) % len(tiles)], i + j) for j in range(4)]
        yield np.zeros(3), a, b, np.vstack([np.hstack(four[:2]), np.hstack(four[2:])])


def render(cam_from_world):
    """What a pinhole camera inside the room sees; twice the size, then averaged. Pixel centres at +0.5."""
    out = np.full((SIZE[1] * 2, SIZE[0] * 2, 3), 200, np.uint8)
    double = np.diag([2.0, 2, 1]) @ K @ cam_from_world[:3]
    for corner, a, b, texture in room():
        rows, columns = texture.shape[:2]
        plane = np.column_stack([np.r_[a / columns, 0], np.r_[b / rows, 0], np.r_[corner, 1]])
        homography = shift(-0.5) @ double @ plane @ shift(0.5)  # OpenCV's pixel centres are at whole numbers
        size = (out.shape[1], out.shape[0])
        seen = cv2.warpPerspective(np.full((rows, columns), 255, np.uint8), homography, size) > 127
        out[seen] = cv2.warpPerspective(texture, homography, size)[seen]
    return cv2.resize(out, SIZE, interpolation=cv2.INTER_AREA)


def distorted(image):
    """The same picture through a lens with radial distortion DISTORTION (the inverse of what the stage does)."""
    centred = K.copy()
    centred[:2, 2] -= 0.5
    pixels = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).reshape(-1, 1, 2).astype(float)
    lens = np.array([DISTORTION, 0, 0, 0])
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
    source = cv2.undistortPointsIter(pixels, centred, lens, None, centred, stop).reshape(SIZE[1], SIZE[0], 2)
    return cv2.remap(image, source.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def truth():
    """cam_from_world (COUNT, 4, 4) on an arc in front of the corner."""
    angles = np.linspace(0.25, 1.3, COUNT)
    eyes = [(3.4 * np.cos(a), 3.4 * np.sin(a), 1.2 + 0.5 * (i % 2)) for i, a in enumerate(angles)]
    return np.stack([look_at(np.array(eye), [0.6, 0.6, 0.7]) for eye in eyes])


def errors(found, true):
    """Largest rotation error (degrees) and centre error (of the true median distance) after a similarity alignment."""
    a, b = (-np.einsum("vji,vj->vi", m[:, :3, :3], m[:, :3, 3]) for m in (found, true))
    a, b = a - a.mean(0), b - b.mean(0)
    u, s, vt = np.linalg.svd(b.T @ a)
    flip = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    turn = u @ flip @ vt
    scale = np.trace(flip @ np.diag(s)) / (a**2).sum()
    centre = np.linalg.norm(scale * a @ turn.T - b, axis=1) / np.median(np.linalg.norm(b, axis=1))
    cosines = (np.einsum("vij,vij->v", found[:, :3, :3] @ turn.T, true[:, :3, :3]) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosines, -1, 1))).max(), centre.max()


@pytest.fixture(scope="module")
def shots(tmp_path_factory):
    """COUNT photos of the room through a distorting lens, and one of something else."""
    folder = tmp_path_factory.mktemp("room") / "photos"
    folder.mkdir()
    for i, cam_from_world in enumerate(truth()):
        cv2.imwrite(str(folder / f"room{i}.png"), distorted(render(cam_from_world)))
    other = cv2.cvtColor(cv2.resize(data.page(), SIZE), cv2.COLOR_GRAY2BGR)
    cv2.imwrite(str(folder / "page.png"), other)
    return frames_stage.run(folder, folder.parent / "work")


@pytest.fixture(scope="module")
def placed(shots, tmp_path_factory):
    return poses.run(shots, tmp_path_factory.mktemp("placed"))


def test_cameras_are_where_they_were(placed):
    assert placed.cameras.names == tuple(f"room{i}.png" for i in range(COUNT))
    rotation, centre = errors(placed.cameras.cam_from_world, truth())
    assert rotation < 0.3
    assert centre < 0.005
    assert placed.cameras.K[:, 0, 0] == pytest.approx(430, rel=0.01)
    assert [lens.params[3] for lens in placed.lenses] == pytest.approx([DISTORTION] * COUNT, abs=0.02)
    assert len(np.unique(placed.cameras.K[:, 0, 0])) == 1  # one camera took them all


def test_photo_of_something_else_is_named(placed):
    assert placed.unregistered == ("page.png",)
    assert any("page.png" in w for w in placed.warnings)


def test_points_lie_on_the_walls_and_project_where_they_were_seen(placed):
    cameras = placed.cameras
    assert placed.tracks.sum(axis=1).min() >= 2
    homogeneous = np.c_[placed.points, np.ones(len(placed.points))]
    for v in range(len(cameras)):
        seen = homogeneous[placed.tracks[:, v]] @ cameras.cam_from_world[v].T
        assert (seen[:, 2] > 0).all()
        pixels = seen[:, :3] @ cameras.K[v].T
        pixels = pixels[:, :2] / pixels[:, 2:]
        assert ((pixels > -8) & (pixels < np.array(SIZE) + 8)).all()


def test_undistorted_photos_are_pinhole_pictures(placed):
    """Half a pixel of shift between the two pixel-centre conventions would show here."""
    for path, cam_from_world in list(zip(placed.paths, truth(), strict=True))[::3]:
        image, ideal = cv2.imread(str(path)), render(cam_from_world)
        assert image.shape == ideal.shape
        inner = (slice(40, -40), slice(40, -40))
        grey = [cv2.cvtColor(im, cv2.COLOR_BGR2GRAY).astype(np.float32)[inner] for im in (image, ideal)]
        (dx, dy), _ = cv2.phaseCorrelate(*grey)
        assert math.hypot(dx, dy) < 0.2
        assert np.abs(grey[0] - grey[1]).mean() < 6


def test_distorting_and_undistorting_gives_the_picture_back():
    ideal = render(truth()[0])
    lens = Lens("SIMPLE_RADIAL", np.array([K[0, 0], K[0, 2], K[1, 2], DISTORTION]), np.array(SIZE))
    back = undistorted(distorted(ideal), K, lens)
    shifted = undistorted(distorted(ideal), shift(0.5) @ K, lens)
    inner = (slice(30, -30), slice(30, -30))
    error, worse = (np.abs(im[inner].astype(float) - ideal[inner]).mean() for im in (back, shifted))
    assert error < 4
    assert error < worse
    assert np.array_equal(undistorted(ideal, K, None), ideal)


def test_masks_follow_the_photos(placed):
    mask = np.zeros((SIZE[1], SIZE[0]), bool)
    mask[:80, :90] = True
    moved = undistorted_mask(mask, placed, "room0.png")
    assert moved.dtype == bool
    # Barrel distortion pulls corners inwards; taking it out pushes them outwards, so the block shrinks.
    assert 0.6 * mask.sum() < moved.sum() < mask.sum()
    with pytest.raises(ValueError, match=r"mask of room0\.png"):
        undistorted_mask(mask[1:], placed, "room0.png")


def test_same_seed_same_result(shots, placed, tmp_path):
    again = poses.run(shots, tmp_path)
    assert np.array_equal(again.cameras.cam_from_world, placed.cameras.cam_from_world)
    assert np.array_equal(again.cameras.K, placed.cameras.K)
    assert np.array_equal(again.points, placed.points)
    assert np.array_equal(again.tracks, placed.tracks)


def test_exif_focal_length_is_a_start_not_a_verdict(shots, tmp_path):
    told = Frames(shots.names, shots.paths, shots.sizes, np.full(len(shots.names), 600.0), shots.sharpness, shots.alpha)
    found = poses.run(told, tmp_path)
    assert found.cameras.K[:, 0, 0] == pytest.approx(430, rel=0.03)
    assert any("focal length" in w for w in found.warnings)


def frames_of(images, folder):
    """Frames of BGR images, written to a folder."""
    paths = []
    for i, image in enumerate(images):
        paths.append(folder / f"f{i}.png")
        cv2.imwrite(str(paths[-1]), image)
    count = len(images)
    sizes = np.array([(im.shape[1], im.shape[0]) for im in images])
    names = tuple(p.name for p in paths)
    return Frames(names, tuple(paths), sizes, np.full(count, np.nan), np.full(count, 100.0), (None,) * count)


def test_photos_without_texture_fail_with_advice(tmp_path, rng):
    smooth = [
        cv2.resize(rng.uniform(90, 160, (3, 4, 3)).astype(np.uint8), SIZE, interpolation=cv2.INTER_CUBIC)
        for _ in range(6)
    ]
    with pytest.raises(ReconstructionError) as error:
        poses.run(frames_of(smooth, tmp_path), tmp_path / "work")
    assert error.value.exit_code == 3
    for part in ("0 of 6", "f0.png", "weak texture", "newspaper", "20 to 60"):
        assert part in str(error.value)


def test_photos_without_overlap_fail_with_advice(tmp_path):
    names = ("coffee", "chelsea", "astronaut", "rocket", "brick")
    images = [cv2.resize(getattr(data, n)(), SIZE) for n in names]
    images = [im if im.ndim == 3 else cv2.cvtColor(im, cv2.COLOR_GRAY2BGR) for im in images]
    with pytest.raises(ReconstructionError, match="no overlap"):
        poses.run(frames_of(images, tmp_path), tmp_path / "work", PosesOptions(attempts=1))


def test_two_photos_are_too_few(tmp_path):
    with pytest.raises(ReconstructionError, match="2 photos are too few"):
        poses.run(frames_of([render(truth()[0])] * 2, tmp_path), tmp_path / "work")


def test_child_that_takes_too_long(shots, tmp_path):
    with pytest.raises(ReconstructionError, match="longer than 0 s"):
        poses.run(shots, tmp_path, PosesOptions(attempt_seconds=0.05, attempts=1))


def test_child_that_crashes(shots, tmp_path, monkeypatch):
    monkeypatch.setattr(sfm_options, "LADDER", (Rung("impossible settings", max_features=-1),))
    with pytest.raises(ReconstructionError, match="impossible settings: ended with code"):
        poses.run(shots, tmp_path)


def test_pycolmap_stays_out_of_the_commands_process():
    """Loaded beside cv2 or PIL it breaks their PNG writing. Asked of a fresh process: other tests may load it here."""
    ask = "import sys, recon.pipelines.photos; sys.exit('pycolmap' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", ask], check=False).returncode == 0


def test_pairs():
    assert image_pairs(4, "auto", 60, 10) == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    for count in (3, 61, 200):
        pairs = image_pairs(count, "sequential", 60, 10)
        assert len(set(pairs)) == len(pairs)
        assert all(0 <= i < j < count for i, j in pairs)
        assert {(i, i + 1) for i in range(count - 1)} <= set(pairs)
        assert (0, count - 1) in pairs  # round the end
    assert len(image_pairs(200, "auto", 60, 10)) < 4000
    assert len(image_pairs(61, "exhaustive", 60, 10)) == 61 * 60 // 2


def test_photos_of_one_size_share_a_camera():
    count = 6
    sizes = np.array([[100, 75]] * 4 + [[75, 100]] * 2)
    focal = np.array([80.0, 80.2, np.nan, 160.0, np.nan, np.nan])
    paths = tuple(Path(f"{i}.jpg") for i in range(count))
    shots = Frames(tuple(p.name for p in paths), paths, sizes, focal, np.ones(count), (None,) * count)
    groups = {tuple(g["images"]): g["params"] for g in camera_groups(shots)}
    assert groups[("0.jpg", "1.jpg", "2.jpg")] == pytest.approx([80.1, 50, 37.5, 0])
    assert groups[("3.jpg",)] == pytest.approx([160, 50, 37.5, 0])  # zoomed in
    assert groups[("4.jpg", "5.jpg")] is None


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"sharpness": 5.0}, "blur"),
        ({"keypoints": 30}, "weak texture"),
        ({"pairs": 0}, "no overlap"),
        ({}, "too few common points"),
        ({"models": [5, 3]}, "groups of 5, 3"),
    ],
)
def test_diagnosis(change, says):
    count = 8
    sharpness, keypoints, pairs = np.full(count, 100.0), np.full(count, 2000), np.full(count, 5)
    registered = np.arange(count) != 7
    for array, key in ((sharpness, "sharpness"), (keypoints, "keypoints"), (pairs, "pairs")):
        array[7] = change.get(key, array[7])
    names = tuple(f"{i}.jpg" for i in range(count))
    shots = Frames(
        names, tuple(map(Path, names)), np.full((count, 2), 100), np.full(count, np.nan), sharpness, (None,) * count
    )
    text = sfm_diagnosis.explain(shots, registered, keypoints, pairs, np.array(change.get("models", [7])))
    assert says in text
    assert "1 of 8" in text
    assert "7.jpg" in text


def test_a_lens_a_camera():
    cameras = Cameras(("a",), np.eye(3)[None], np.eye(4)[None], np.array([[4, 4]]))
    with pytest.raises(ValueError, match="lens"):
        Poses(cameras, (Path("a"),), np.zeros((0, 3)), np.zeros((0, 1), bool), lenses=(None, None))


@pytest.mark.slow
def test_sample_photo_set(tmp_path):
    """28 photos of a chair: about 15 s on two cores."""
    views = json.loads((SAMPLE / "truth" / "cameras.json").read_text())["views"]
    found = poses.run(frames_stage.run(SAMPLE / "photos", tmp_path), tmp_path)
    assert found.cameras.names == tuple(v["name"] for v in views)
    rotation, centre = errors(found.cameras.cam_from_world, np.array([v["cam_from_world"] for v in views]))
    assert rotation < 0.2
    assert centre < 0.004
    assert found.cameras.K[:, 0, 0] == pytest.approx(views[0]["K"][0][0], rel=0.005)


def attempt(places, observations, turn=None):
    """Cameras at `places` (v, 3), in a world turned by `turn`, that saw points so many times."""
    poses_ = np.tile(np.eye(4), (len(places), 1, 1))
    poses_[:, :3, 3] = -places if turn is None else -2 * places @ turn.T
    none = np.zeros(0)
    tracks = np.ones((observations, 1), bool)
    return Attempt(np.arange(len(places)), none, none, poses_, none, tracks, none, none, none)


def test_a_rival_that_places_the_photos_elsewhere_is_told():
    rng = np.random.default_rng(0)
    places = rng.normal(size=(8, 3))
    best = attempt(places, 100)
    turned = attempt(places, 95, cv2.Rodrigues(np.array([0.3, 1.0, -0.5]))[0])
    moved = places.copy()
    moved[3] += 2
    assert sfm_diagnosis.other_ways(best, [best, turned]) == []  # the same room in another frame
    assert sfm_diagnosis.other_ways(best, [best, attempt(moved, 50)]) == []  # explains too little
    assert "another way" in sfm_diagnosis.other_ways(best, [best, attempt(moved, 95)])[0]


def test_few_small_photos_are_matched_more_strictly(shots):
    options = PosesOptions()
    assert sfm_attempts.pair_error(shots, options) == 2
    assert sfm_attempts.pair_error(shots, PosesOptions(few_photos=3)) == 4
