"""A box that turns before a still camera: only with --turntable is it the box that structure from motion follows."""

import logging
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

from recon.cameras import poses, turntable
from recon.cameras.sfm_options import PosesOptions
from recon.command import main
from recon.files import frames as frames_stage
from recon.masks import silhouettes
from recon.scene import InputError, ReconstructionError

SIZE = (480, 360)
K = np.array([[520.0, 0, 240], [0, 520.0, 180], [0, 0, 1]])
COUNT = 15
HALF = np.array([0.5, 0.35, 0.3])  # of the box


def textures():
    """One picture for each side of the box, all different and rich."""
    rng = np.random.default_rng(5)
    photos = [data.coffee(), data.chelsea(), data.astronaut(), data.rocket(), data.hubble_deep_field(), data.retina()]
    out = []
    for image in photos:
        small = cv2.resize(np.ascontiguousarray(image[:300, :300]), (300, 300)).astype(float)
        noise = cv2.resize(rng.uniform(-60, 60, (60, 60, 3)), (300, 300), interpolation=cv2.INTER_CUBIC)
        out.append(np.clip(small + noise, 0, 255).astype(np.uint8))
    return out


def camera(angle):
    """(4, 4) cam_from_box: the camera looks down a little; the box is turned by `angle` about the vertical."""
    eye = 2.6 * np.array([np.sin(angle) * 0.85, -np.cos(angle) * 0.85, 0.53])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    out = np.eye(4)
    out[:3, :3] = [right, np.cross(forward, right), forward]
    out[:3, 3] = -out[:3, :3] @ eye
    return out


def photograph(cam_from_box, sides, behind):
    """Photo (h, w, 3) and mask (h, w) bool: the box before a picture that stands still."""
    photo, mask = behind.copy(), np.zeros(SIZE[::-1], bool)
    eye = np.linalg.inv(cam_from_box)[:3, 3]
    for side in range(6):
        axis, sign = side % 3, 1 if side < 3 else -1
        if sign * eye[axis] <= HALF[axis]:
            continue
        a, b = (axis + 1) % 3, (axis + 2) % 3
        corners = np.zeros((4, 3))
        corners[:, axis] = sign * HALF[axis]
        corners[:, a], corners[:, b] = HALF[a] * np.array([-1, 1, 1, -1]), HALF[b] * np.array([-1, -1, 1, 1])
        local = corners @ cam_from_box[:3, :3].T + cam_from_box[:3, 3]
        pixels = ((local @ K.T)[:, :2] / local[:, 2:]).astype(np.float32)
        square = np.array([[0, 0], [300, 0], [300, 300], [0, 300]], np.float32)
        warp = cv2.getPerspectiveTransform(square, pixels)
        seen = cv2.warpPerspective(np.full((300, 300), 255, np.uint8), warp, SIZE) > 127
        photo[seen] = cv2.warpPerspective(sides[side], warp, SIZE, flags=cv2.INTER_AREA)[seen]
        mask |= seen
    return photo, mask


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """A folder of COUNT photos, a folder of masks, and the true cam_from_box."""
    root = tmp_path_factory.mktemp("turning")
    (root / "photos").mkdir()
    (root / "masks").mkdir()
    behind = cv2.resize(np.ascontiguousarray(data.immunohistochemistry()), SIZE)
    sides, truth = textures(), []
    for i in range(COUNT):
        truth.append(camera(2 * np.pi * i / COUNT))
        photo, mask = photograph(truth[-1], sides, behind)
        Image.fromarray(photo).save(root / "photos" / f"p{i:02d}.png")
        Image.fromarray(mask).save(root / "masks" / f"p{i:02d}_mask.png")
    return root / "photos", root / "masks", np.array(truth)


def turns(cam_from_world):
    """Degrees from each camera to the next."""
    between = cam_from_world[1:, :3, :3] @ cam_from_world[:-1, :3, :3].transpose(0, 2, 1)
    return np.degrees(np.arccos(np.clip((np.trace(between, axis1=1, axis2=2) - 1) / 2, -1, 1)))


@pytest.mark.slow
def test_the_object_is_followed_and_not_what_stands_still(turning, tmp_path):
    photos, masks, truth = turning
    shots = frames_stage.run(photos, tmp_path)
    options = PosesOptions(turntable=True)
    found = poses.run(shots, tmp_path, options, turntable.object_alone(shots, masks, tmp_path))
    assert len(found.cameras) == COUNT
    np.testing.assert_allclose(turns(found.cameras.cam_from_world), turns(truth), atol=2)
    seen = silhouettes.run(shots, found, masks, tmp_path)
    assert seen.used.all()
    assert seen.floor is not None
    try:
        still = poses.run(shots, tmp_path / "still", PosesOptions(attempts=1))
        assert len(still.cameras) < COUNT or np.abs(turns(still.cameras.cam_from_world) - turns(truth)).max() > 5
    except ReconstructionError:
        pass


def test_everything_but_the_object_is_painted_over(turning, tmp_path):
    photos, masks, _ = turning
    shots = frames_stage.run(photos, tmp_path)
    alone = turntable.object_alone(shots, masks, tmp_path)
    assert alone.names == shots.names
    assert [p.name for p in alone.paths] == [p.name for p in shots.paths]
    mask = np.asarray(Image.open(masks / "p03_mask.png")) > 0
    painted = cv2.imread(str(alone.paths[3])).astype(int)
    kept = cv2.imread(str(shots.paths[3])).astype(int)
    inner = cv2.erode(mask.astype(np.uint8), np.ones((17, 17))) > 0
    outer = cv2.dilate(mask.astype(np.uint8), np.ones((17, 17))) == 0
    assert np.abs(painted[inner] - kept[inner]).mean() < 4
    assert np.abs(painted[outer] - 128).max() < 6


def test_inverted_masks_and_alpha_serve_as_well(turning, tmp_path):
    photos, masks, _ = turning
    (tmp_path / "inverted").mkdir()
    (tmp_path / "rgba").mkdir()
    for file in sorted(masks.iterdir()):
        mask, name = np.asarray(Image.open(file)) > 0, file.name.replace("_mask", "")
        Image.fromarray(~mask).save(tmp_path / "inverted" / name)
        photo = np.asarray(Image.open(photos / name))
        Image.fromarray(np.dstack([photo, mask * np.uint8(255)])).save(tmp_path / "rgba" / name)
    first = turntable.object_alone(frames_stage.run(photos, tmp_path / "a"), tmp_path / "inverted", tmp_path / "a")
    second = turntable.object_alone(frames_stage.run(tmp_path / "rgba", tmp_path / "b"), None, tmp_path / "b")
    for one, other in zip(first.paths, second.paths, strict=True):
        assert np.abs(cv2.imread(str(one)).astype(int) - cv2.imread(str(other))).mean() < 3


def test_without_masks_it_says_what_is_needed(turning, tmp_path, capsys):
    photos, masks, _ = turning
    shots = frames_stage.run(photos, tmp_path / "w")
    few = tmp_path / "few"
    few.mkdir()
    (few / "p00.png").write_bytes((masks / "p00_mask.png").read_bytes())
    with pytest.raises(InputError, match=r"1 of 15 photos have a mask; give --masks"):
        turntable.object_alone(shots, few, tmp_path / "w")
    logging.getLogger("recon").setLevel(logging.WARNING)
    assert main([str(photos), "--turntable", "--out", str(tmp_path / "out")]) == 2
    assert "0 of 15 photos have a mask" in capsys.readouterr().err


def test_an_empty_folder_of_masks_is_said_before_minutes_are_spent(turning, tmp_path, capsys):
    photos, _, _ = turning
    empty = tmp_path / "none"
    empty.mkdir()
    (empty / "._p00.png").write_bytes(b"\0\5\x16\7")
    assert main([str(photos), "--masks", str(empty), "--out", str(tmp_path / "out")]) == 2
    assert "holds no pictures" in capsys.readouterr().err
    assert not Path(tmp_path / "out").exists()
