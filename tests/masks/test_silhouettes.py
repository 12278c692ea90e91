"""The stage that finds the object in every photo: floor, automatic masks, the user's masks, and what can be wrong.

The photos are drawn here: a small table of plain boxes on a patterned floor, with exact masks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from recon.files import mask_images
from recon.geometry.align import looked_at
from recon.geometry.mask_checks import EDGED, implausible, outline_support, unusable
from recon.geometry.room_planes import find_room, floor_plane, up_direction
from recon.geometry.undistort import undistorted_mask
from recon.masks import silhouettes
from recon.masks.segmentation import CutoutOptions
from recon.scene import Cameras, Frames, InputError, Lens, Poses, ReconstructionError, Silhouettes

SIZE = (240, 180)  # width, height
FAST = silhouettes.SilhouetteOptions(cutout=CutoutOptions(small=200, coarse=48, fine=96), judge_cells=64)
# (low corner, high corner) of a table's top and legs; metres, z up, floor at z = 0.
TABLE = (
    ((-0.5, -0.35, 0.62), (0.5, 0.35, 0.72)),
    *(((x - 0.05, y - 0.05, 0.0), (x + 0.05, y + 0.05, 0.62)) for x in (-0.45, 0.45) for y in (-0.3, 0.3)),
)
BASE = np.array([[0.48, -0.6, 0.64], [0.8, 0.6, -0.0375], [-0.36, 0.53, 0.767]])
TURN = np.linalg.qr(BASE)[0] * np.sign(np.linalg.det(np.linalg.qr(BASE)[0]))
WORLD_FROM_ROOM = np.vstack([np.column_stack([3.0 * TURN, [1.0, -2.0, 0.5]]), [0, 0, 0, 1]])  # no axis is special


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    out = np.eye(4)
    out[:3, :3] = [right, np.cross(forward, right), forward]
    out[:3, 3] = -out[:3, :3] @ eye
    return out


def pattern(rng: np.random.Generator, pixels: int = 800) -> np.ndarray:
    """(pixels, pixels, 3) uint8: coloured patches of several sizes, nowhere alike."""
    out = np.zeros((pixels, pixels, 3), np.float32)
    for cells, weight in ((16, 0.5), (60, 0.35), (200, 0.15)):
        patches = rng.uniform(0, 255, (cells, cells, 3)).astype(np.float32)
        out += weight * cv2.resize(patches, (pixels, pixels), interpolation=cv2.INTER_NEAREST)
    return np.clip(1.6 * out - 75, 0, 255).astype(np.uint8)


def paint(K: np.ndarray, cam_from_room: np.ndarray, floor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Photo (h, w, 3) uint8 and mask (h, w) bool of the table."""
    width, height = SIZE
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([u, v, np.ones_like(u)], -1) @ (np.linalg.inv(K).T @ cam_from_room[:3, :3])
    eye = np.linalg.inv(cam_from_room)[:3, 3]
    reach = np.where(rays[..., 2] < -1e-6, -eye[2] / np.minimum(rays[..., 2], -1e-6), 0)
    place = (eye + rays * reach[..., None])[..., :2]
    spot = ((place / 4 + 0.5) * len(floor)).astype(np.float32)
    photo = cv2.remap(floor, spot[..., 0], spot[..., 1], cv2.INTER_LINEAR, borderValue=(235, 230, 225))
    photo[rays[..., 2] >= -1e-6] = (235, 230, 225)
    mask = np.zeros((height, width), np.uint8)
    shades = [np.array([60, 90, 200]) * s for s in (0.7, 0.85, 1.0)]
    boxes = sorted(TABLE, key=lambda b: -np.linalg.norm(np.mean(b, axis=0) - eye))
    for low, high in boxes:
        corners = np.array([[(low, high)[bit][axis] for axis, bit in enumerate(bits)] for bits in np.ndindex(2, 2, 2)])
        local = corners @ cam_from_room[:3, :3].T + cam_from_room[:3, 3]
        pixels = (local @ K.T)[:, :2] / local[:, 2:]
        for axis in range(3):
            side = 1 if eye[axis] > high[axis] else 0 if eye[axis] < low[axis] else None
            if side is not None:
                face = pixels[[i for i, bits in enumerate(np.ndindex(2, 2, 2)) if bits[axis] == side]]
                # 8 bits of fraction; cv2 counts pixel centres from 0.
                polygon = np.rint((cv2.convexHull(face.astype(np.float32))[:, 0] - 0.5) * 256).astype(np.int32)
                cv2.fillConvexPoly(photo, polygon, shades[axis].tolist(), cv2.LINE_8, 8)
                cv2.fillConvexPoly(mask, polygon, 1, cv2.LINE_8, 8)
    return photo, mask > 0


@dataclass
class Scene:
    frames: Frames
    poses: Poses
    truth: list[np.ndarray]

    def scores(self, masks: tuple[np.ndarray, ...]) -> np.ndarray:
        return np.array([(m & t).sum() / max(1, (m | t).sum()) for m, t in zip(masks, self.truth, strict=True)])


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return build(tmp_path_factory.mktemp("photos"))


def build(folder: Path, views: int = 14) -> Scene:
    rng = np.random.default_rng(3)
    floor, names, truth, poses = pattern(rng), [], [], []
    K = np.array([[230.0, 0, SIZE[0] / 2], [0, 230.0, SIZE[1] / 2], [0, 0, 1]])
    for i in range(views):
        angle, rise = 2 * np.pi * i / views * 2 + 0.1 * (i >= views / 2), np.radians(22 if i < views / 2 else 42)
        eye = 2.6 * np.array([np.cos(rise) * np.cos(angle), np.cos(rise) * np.sin(angle), np.sin(rise)])
        cam_from_room = look_at(eye + np.array([0, 0, 0.3]), np.array([0, 0, 0.33]))
        photo, mask = paint(K, cam_from_room, floor)
        noisy = np.clip(photo * 1.05 ** rng.uniform(-1, 1) + rng.normal(0, 2, photo.shape), 0, 255)
        names.append(f"IMG_{i:02d}.jpg")
        cv2.imwrite(str(folder / names[-1]), noisy.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 95])
        truth.append(mask)
        poses.append(cam_from_room @ np.linalg.inv(WORLD_FROM_ROOM))
    cam_from_world = np.array(poses)
    cam_from_world[:, :3] *= 3.0  # rigid again: the world is three times as large as the room
    points = np.column_stack([rng.uniform(-1.4, 1.4, (800, 2)), rng.normal(0, 0.003, 800)])
    points = np.vstack([points, rng.uniform((-1.5, -1.5, 0), (1.5, 1.5, 1.5), (60, 3))])
    points = points @ WORLD_FROM_ROOM[:3, :3].T + WORLD_FROM_ROOM[:3, 3]
    sizes, paths = np.tile(SIZE, (views, 1)), tuple(folder / n for n in names)
    cameras = Cameras(tuple(names), np.tile(K, (views, 1, 1)), cam_from_world, sizes)
    nothing = np.full(views, np.nan)
    return Scene(
        Frames(tuple(names), paths, sizes, nothing, np.ones(views), (None,) * views),
        Poses(cameras, paths, points, np.ones((len(points), views), bool)),
        truth,
    )


@pytest.fixture(scope="module")
def found(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Silhouettes, Path]:
    folder = tmp_path_factory.mktemp("work")
    return silhouettes.run(scene.frames, scene.poses, None, folder, FAST), folder


def save_masks(scene: Scene, folder: Path, views: range | list[int] | None = None) -> Path:
    folder.mkdir(exist_ok=True)
    for v in range(len(scene.truth)) if views is None else views:
        Image.fromarray(scene.truth[v]).save(folder / f"IMG_{v:02d}.png")
    return folder


# ---- the floor ----


def test_floor_is_found_in_any_frame_and_faces_the_cameras(scene: Scene) -> None:
    plane = floor_plane(scene.poses.points, scene.poses.cameras, np.random.default_rng(0))
    assert plane[:3] @ TURN[:, 2] > np.cos(np.radians(0.3))
    assert plane[:3] @ WORLD_FROM_ROOM[:3, 3] + plane[3] == pytest.approx(0, abs=0.02)
    assert (scene.poses.cameras.centres() @ plane[:3] + plane[3] > 0).all()
    assert up_direction(scene.poses.cameras) @ TURN[:, 2] > np.cos(np.radians(3))


def test_a_table_top_with_more_points_is_not_the_floor(scene: Scene) -> None:
    rng = np.random.default_rng(0)
    top = np.column_stack([rng.uniform(-0.5, 0.5, (4000, 2)), np.full(4000, 0.72)])
    points = np.vstack([scene.poses.points, top @ WORLD_FROM_ROOM[:3, :3].T + WORLD_FROM_ROOM[:3, 3]])
    plane = floor_plane(points, scene.poses.cameras, np.random.default_rng(0))
    assert plane[:3] @ WORLD_FROM_ROOM[:3, 3] + plane[3] == pytest.approx(0, abs=0.03)


def test_walls_are_upright_and_behind_the_object(scene: Scene) -> None:
    rng = np.random.default_rng(0)
    wall = np.column_stack([np.full(500, 3.2), rng.uniform(-2, 2, 500), rng.uniform(0, 2, 500)])
    points = np.vstack([scene.poses.points, wall @ WORLD_FROM_ROOM[:3, :3].T + WORLD_FROM_ROOM[:3, 3]])
    room = find_room(points, scene.poses.cameras, np.random.default_rng(0))
    assert len(room.walls) == 1
    assert room.walls[0, :3] @ -TURN[:, 0] == pytest.approx(1, abs=1e-3)
    assert room.axes @ room.axes.T == pytest.approx(np.eye(3), abs=1e-9)


@pytest.mark.parametrize("count", [0, 5, 400])
def test_no_floor_says_what_to_do(scene: Scene, tmp_path: Path, count: int) -> None:
    points = scene.poses.cameras.centres()[:1] + np.random.default_rng(0).normal(0, 5, (count, 3))
    bare = replace(scene.poses, points=points, tracks=np.ones((count, len(scene.truth)), bool))
    with pytest.raises(ReconstructionError, match="--masks"):
        silhouettes.run(scene.frames, bare, None, tmp_path)


# ---- found automatically ----


def test_object_is_found_with_the_holes_between_its_legs(scene: Scene, found: tuple[Silhouettes, Path]) -> None:
    result, folder = found
    scores = scene.scores(result.masks)
    assert scores.mean() > 0.93, scores.round(2)
    assert scores.min() > 0.85
    assert set(result.source) == {"grabcut"}
    assert result.used.all()
    assert result.reasons == ()
    assert result.floor is not None
    for mask, truth, name in zip(result.masks, scene.truth, result.names, strict=True):
        box = np.zeros_like(truth)
        rows, columns = np.flatnonzero(truth.any(1)), np.flatnonzero(truth.any(0))
        box[rows[0] : rows[-1], columns[0] : columns[-1]] = True
        assert (mask & box & ~truth).sum() < 0.1 * (box & ~truth).sum()
        assert (cv2.imread(str(folder / "masks" / f"{name}.png"), 0) > 127).tolist() == mask.tolist()
    assert not list((folder / "masks").glob("*.tmp"))


def test_same_seed_same_masks(scene: Scene, found: tuple[Silhouettes, Path], tmp_path: Path) -> None:
    again = silhouettes.run(scene.frames, scene.poses, None, tmp_path, FAST)
    assert all((a == b).all() for a, b in zip(again.masks, found[0].masks, strict=True))


def test_nothing_over_the_floor_is_an_error(scene: Scene, tmp_path: Path) -> None:
    blank = tmp_path / "blank.png"
    Image.new("RGB", SIZE, (200, 200, 200)).save(blank)
    poses = replace(scene.poses, paths=(blank,) * len(scene.truth))
    with pytest.raises(ReconstructionError, match="no object found"):
        silhouettes.run(scene.frames, poses, None, tmp_path, FAST)


# ---- the user's masks ----


def test_user_masks_win_and_need_neither_floor_nor_points(scene: Scene, tmp_path: Path) -> None:
    bare = replace(scene.poses, points=np.zeros((0, 3)), tracks=np.zeros((0, len(scene.truth)), bool))
    alpha = tmp_path / "alpha.png"
    Image.fromarray(~scene.truth[0]).save(alpha)
    frames = replace(scene.frames, alpha=(alpha,) * len(scene.truth))
    found = silhouettes.run(frames, bare, save_masks(scene, tmp_path / "m"), tmp_path, FAST)
    assert set(found.source) == {"user"}
    assert found.used.all()
    world_from_room = np.asarray(WORLD_FROM_ROOM)
    floor = found.floor @ world_from_room  # in the room: z = 0, but for the room's scale
    assert floor[2] / np.linalg.norm(floor[:3]) > np.cos(np.radians(1.5))
    assert abs(floor[3] / floor[2]) < 0.02, "the floor is where the silhouettes stand"
    assert scene.scores(found.masks).min() == 1


def test_alpha_is_used_where_there_is_one_and_helps_the_others(scene: Scene, tmp_path: Path) -> None:
    folder = save_masks(scene, tmp_path / "alpha", [0, 3])
    paths = tuple(folder / f"IMG_{v:02d}.png" if v in (0, 3) else None for v in range(len(scene.truth)))
    found = silhouettes.run(replace(scene.frames, alpha=paths), scene.poses, None, tmp_path, FAST)
    assert [v for v, s in enumerate(found.source) if s == "alpha"] == [0, 3]
    scores = scene.scores(found.masks)
    assert scores[0] == scores[3] == 1
    assert scores.mean() > 0.93


def test_photos_without_a_mask_are_left_out_when_there_is_no_floor(scene: Scene, tmp_path: Path) -> None:
    bare = replace(scene.poses, points=np.zeros((0, 3)), tracks=np.zeros((0, len(scene.truth)), bool))
    found = silhouettes.run(scene.frames, bare, save_masks(scene, tmp_path / "m", range(8)), tmp_path)
    assert found.used.tolist() == [True] * 8 + [False] * (len(scene.truth) - 8)
    assert {name for name, _ in found.reasons} == set(found.names[8:])
    assert "no floor" in found.reasons[0][1]


def test_a_mask_that_contradicts_the_others_is_dropped_and_named(scene: Scene, tmp_path: Path) -> None:
    folder = save_masks(scene, tmp_path / "m")
    Image.fromarray(np.roll(scene.truth[5], 70, axis=1)).save(folder / "IMG_05.png")
    found = silhouettes.run(scene.frames, scene.poses, folder, tmp_path, FAST)
    assert np.flatnonzero(~found.used).tolist() == [5]
    assert found.reasons[0][0] == "IMG_05.jpg"
    assert "contradicts" in found.reasons[0][1]


def test_a_camera_on_the_wrong_side_is_refused_by_name(scene: Scene, tmp_path: Path) -> None:
    """One that stands elsewhere round the object than its photo was taken from."""
    poses = scene.poses.cameras.cam_from_world.copy()
    middle = looked_at(scene.poses.cameras, list(scene.truth))
    up = up_direction(scene.poses.cameras)
    turn = np.eye(4)
    turn[:3, :3] = cv2.Rodrigues(np.radians(70) * up)[0]
    turn[:3, 3] = middle - turn[:3, :3] @ middle
    poses[4] = poses[4] @ turn
    wrong = replace(scene.poses, cameras=replace(scene.poses.cameras, cam_from_world=poses))
    found = silhouettes.run(scene.frames, wrong, save_masks(scene, tmp_path / "m"), tmp_path, FAST)
    assert np.flatnonzero(~found.used).tolist() == [4]
    assert found.reasons[0][0] == "IMG_04.jpg"
    assert "camera" in found.reasons[0][1]


NAMES = ["IMG_00.png", "IMG_00.jpg.png", "IMG_00.bmp", "img_00.PNG", "IMG_00.jpg", "IMG_00_mask.png", "mask_IMG_00.png"]
NAMES += ["IMG_00.jpg.mask.png", "IMG_00-mask.png", "mask-img_00.png", "Masks/IMG_00.png", "IMG_00/mask.png"]


@pytest.mark.parametrize("name", NAMES)
def test_names_that_fit(scene: Scene, tmp_path: Path, name: str) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    Image.fromarray(scene.truth[0]).convert("RGB").save(tmp_path / name, quality=90)
    (tmp_path / "._IMG_00.png").write_bytes(b"\0\5\x16\7" + b"\0" * 99)
    (tmp_path / "Thumbs.db").write_bytes(b"x")
    loaded = mask_images.load_folder(tmp_path, scene.frames, scene.poses)
    assert (loaded.masks["IMG_00.jpg"] == scene.truth[0]).mean() > 0.999


def test_of_a_photo_and_its_mask_in_one_folder_the_mask_is_taken(scene: Scene, tmp_path: Path) -> None:
    Image.fromarray(scene.truth[0]).save(tmp_path / "IMG_00_mask.png")
    (tmp_path / "IMG_00.jpg").write_bytes(scene.frames.paths[0].read_bytes())
    loaded = mask_images.load_folder(tmp_path, scene.frames, scene.poses)
    assert (loaded.masks["IMG_00.jpg"] == scene.truth[0]).all()
    assert not loaded.bad


def test_a_raw_photo_of_the_same_name_takes_no_mask_away(scene: Scene, tmp_path: Path) -> None:
    frames = replace(scene.frames, skipped=(("IMG_00.DNG", "raw"),))
    assert "IMG_00.jpg" in mask_images.load_folder(save_masks(scene, tmp_path), frames, scene.poses).masks


@pytest.mark.parametrize("which", ["all", "some"])
def test_inverted_masks_are_turned_round_and_that_is_said(scene: Scene, tmp_path: Path, which: str) -> None:
    folder = save_masks(scene, tmp_path / "m")
    inverted = range(len(scene.truth)) if which == "all" else (2, 9)
    for v in inverted:
        Image.fromarray(~scene.truth[v]).save(folder / f"IMG_{v:02d}.png")
    found = silhouettes.run(scene.frames, scene.poses, folder, tmp_path, FAST)
    assert scene.scores(found.masks).min() == 1
    assert found.used.all()
    assert f"{len(inverted)} of {len(scene.truth)} masks are inverted" in found.warnings[0]


def test_objects_that_fill_their_photos_are_not_turned_round(scene: Scene, tmp_path: Path) -> None:
    """White along most of the edge, and yet right: what is black are corners that have no common inside."""
    folder = tmp_path / "m"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for name in scene.frames.names:
        mask = np.ones(SIZE[::-1], np.uint8) * 255
        corner = rng.integers(0, 4)
        rows = slice(0, 60) if corner < 2 else slice(-60, None)
        mask[rows, slice(0, 70) if corner % 2 else slice(-70, None)] = 0
        Image.fromarray(mask).save(folder / f"{Path(name).stem}.png")
    found = silhouettes.run(scene.frames, scene.poses, folder, tmp_path, FAST)
    assert not found.warnings
    assert all(m.mean() > 0.8 for m in found.masks)


def test_automatic_masks_that_cannot_be_right_are_told() -> None:
    good = np.zeros((90, 120), bool)
    good[20:70, 30:90] = True
    cut, two, full = good.copy(), good.copy(), np.ones_like(good)
    cut[70:] = cut[69]
    two[:, 50:60] = False
    assert implausible([good] * 4 + [cut]) == []
    assert "in 3 of 5 photos the object that was found reaches" in implausible([good] * 2 + [cut] * 3)[0]
    assert "separate pieces" in implausible([two, two, good])[0]
    assert any("fills the photo" in w and "--masks" in w for w in implausible([full, full, good]))


def test_an_automatic_mask_that_fills_its_photo_is_not_used() -> None:
    good, frame = np.zeros((90, 120), bool), np.ones((90, 120), bool)
    good[20:70, 30:90] = True
    frame[10:-10, 10:-10] = False
    assert unusable(good) is None
    for bad in (np.ones_like(good), frame):
        assert "give a mask" in (unusable(bad) or "")


def test_outlines_beside_the_photos_edges_are_told() -> None:
    """A right mask runs along edges, one that takes in a shadow's width of plain floor does not."""
    photo = np.full((120, 160, 3), 150, np.uint8) + np.random.default_rng(0).integers(0, 6, (120, 160, 3), np.uint8)
    mask = np.zeros((120, 160), bool)
    mask[30:90, 50:110] = True
    photo[mask] = (40, 60, 190)
    wide = cv2.dilate(mask.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    half = mask.copy()
    half[:, 80:] = False
    assert outline_support(photo, mask) > 0.99
    assert outline_support(photo, wide) < EDGED
    assert outline_support(photo, half) < 0.85
    assert outline_support(photo, np.zeros_like(mask)) == 1


def test_same_stem_twice_needs_the_full_name(scene: Scene, tmp_path: Path) -> None:
    frames = replace(scene.frames, names=("IMG_01.png", *scene.frames.names[1:]))  # IMG_01.png and IMG_01.jpg
    Image.fromarray(scene.truth[1]).save(tmp_path / "IMG_01.tif")
    with pytest.raises(InputError, match="could belong to"):
        mask_images.load_folder(tmp_path, frames, scene.poses)
    (tmp_path / "IMG_01.tif").unlink()
    Image.fromarray(scene.truth[1]).save(tmp_path / "IMG_01.jpg.png")
    assert set(mask_images.load_folder(tmp_path, frames, scene.poses).masks) == {"IMG_01.jpg"}


def test_any_size_any_depth_and_turned_files(tmp_path: Path) -> None:
    truth = np.zeros((60, 80), bool)
    truth[10:50, 20:30] = True
    big = Image.fromarray(truth).resize((800, 600))
    big.save(tmp_path / "big.png")
    Image.fromarray(truth.astype(np.uint8)).save(tmp_path / "zero_one.png")
    Image.fromarray(truth.astype(np.uint16) * 40000).save(tmp_path / "deep.png")
    cut = np.dstack([np.full((60, 80, 3), 30, np.uint8), truth.astype(np.uint8) * 255])
    Image.fromarray(cut).save(tmp_path / "cut.png")
    exif = Image.Exif()
    exif[0x0112] = 6  # stored on its side: turn clockwise to see it upright
    Image.fromarray(np.rot90(truth)).save(tmp_path / "turned.png", exif=exif)
    Image.fromarray(truth).resize((41, 31)).save(tmp_path / "small.png")
    for file in sorted(tmp_path.iterdir()):
        mask = mask_images.read_mask(file, (80, 60))
        assert (mask == truth).mean() > (0.97 if file.name == "small.png" else 0.9999), file.name


def test_masks_are_undistorted_as_the_photos_were(scene: Scene, tmp_path: Path) -> None:
    lenses = tuple(
        Lens("SIMPLE_RADIAL", np.array([K[0, 0], K[0, 2], K[1, 2], 0.2]), size)
        for K, size in zip(scene.poses.cameras.K, scene.poses.cameras.sizes, strict=True)
    )
    poses = replace(scene.poses, lenses=lenses)
    loaded = mask_images.load_folder(save_masks(scene, tmp_path), scene.frames, poses)
    expected = undistorted_mask(scene.truth[0], poses, "IMG_00.jpg")
    assert (expected != scene.truth[0]).any()
    assert (loaded.masks["IMG_00.jpg"] == expected).all()


def _all(value: int, size: tuple[int, int] = SIZE) -> Image.Image:
    return Image.new("L", size, value)


BAD = {
    "black": ("IMG_00.png", _all(0), "all black"),
    "white": ("IMG_00.png", _all(255), "all white"),
    "shape": ("IMG_00.png", _all(255, (200, 200)), "not the shape"),
    "turned": ("IMG_00.png", _all(255, (SIZE[1], SIZE[0])), "turned by 90"),
    "name": ("chair_mask.png", _all(255), "no photo has this name"),
    "broken": ("IMG_00.png", None, "cannot be read"),
}


@pytest.mark.parametrize("case", BAD)
def test_one_bad_mask_alone_is_an_input_error(scene: Scene, tmp_path: Path, case: str) -> None:
    name, picture, reason = BAD[case]
    folder = tmp_path / "m"
    folder.mkdir()
    if picture is None:
        (folder / name).write_bytes(b"\x89PNG\r\n\x1a\nnot really")
    else:
        picture.save(folder / name)
    with pytest.raises(InputError, match=reason) as error:
        silhouettes.run(scene.frames, scene.poses, folder, tmp_path, FAST)
    assert name in str(error.value)
    assert "white = object" in str(error.value)


def test_one_bad_mask_among_good_ones_loses_that_view_only(scene: Scene, tmp_path: Path) -> None:
    folder = save_masks(scene, tmp_path / "m")
    _all(0).save(folder / "IMG_02.png")
    _all(255).save(folder / "elsewhere.png")
    found = silhouettes.run(scene.frames, scene.poses, folder, tmp_path, FAST)
    assert np.flatnonzero(~found.used).tolist() == [2]
    assert dict(found.reasons)["IMG_02.jpg"].startswith("IMG_02.png: is all black")
    assert "no photo" in dict(found.reasons)["elsewhere.png"]


def test_folder_without_masks(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        silhouettes.run(scene.frames, scene.poses, tmp_path / "nowhere", tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / ".DS_Store").touch()
    with pytest.raises(InputError, match="holds no pictures"):
        silhouettes.run(scene.frames, scene.poses, tmp_path / "empty", tmp_path)


def test_single_photo_with_a_mask(scene: Scene, tmp_path: Path) -> None:
    folder = save_masks(scene, tmp_path / "m", [0])
    frames = Frames(
        scene.frames.names[:1], scene.frames.paths[:1], scene.frames.sizes[:1], np.ones(1), np.ones(1), (None,)
    )
    poses = Poses(scene.poses.cameras.subset([0]), scene.poses.paths[:1], np.zeros((0, 3)), np.zeros((0, 1), bool))
    found = silhouettes.run(frames, poses, folder, tmp_path)
    assert found.used.tolist() == [True]
    assert scene.truth[0].tolist() == found.masks[0].tolist()


@pytest.mark.slow
def test_shipped_photos_from_end_to_end(tmp_path: Path) -> None:
    from datasets.photosets import read_photoset
    from recon.cameras import poses
    from recon.files import frames

    sample = read_photoset(Path(__file__).parents[2] / "datasets" / "samples" / "chair")
    shots = frames.run(sample.photos[0].parent, tmp_path)
    placed = poses.run(shots, tmp_path)
    found = silhouettes.run(shots, placed, None, tmp_path)
    truth = {n: cv2.imread(str(p), 0) > 127 for n, p in zip(sample.names, sample.masks, strict=True)}
    scores = [(m & truth[n]).sum() / (m | truth[n]).sum() for n, m in zip(found.names, found.masks, strict=True)]
    assert len(scores) >= 26
    assert np.mean(scores) > 0.95
    assert min(scores) > 0.9
