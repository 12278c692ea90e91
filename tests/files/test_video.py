"""Frames of a video: sharp ones are chosen, spread over the clip; what cannot be decoded is said."""

import cv2
import numpy as np
import pytest

from recon.files import video
from recon.files.video import Look, VideoOptions
from recon.pipelines import photo_source
from recon.scene import InputError

SIZE = (160, 120)


def picture(at, rng_seed=0):
    """A textured view that moves with `at`."""
    noise = np.random.default_rng(rng_seed).integers(0, 255, (40, 160, 3)).astype(np.uint8)
    wide = cv2.resize(noise, (1280, 320), interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(wide[40 : 40 + SIZE[1], at : at + SIZE[0]])


def write(path, images, codec="mp4v"):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), 30, images[0].shape[1::-1])
    assert writer.isOpened()
    for image in images:
        writer.write(image)
    writer.release()
    return path


def clip(path, count=60, sharp=lambda i: i % 5 == 2, step=8, codec="mp4v"):
    """Frames that are blurred but for some."""
    images = [picture(i * step) for i in range(count)]
    return write(path, [m if sharp(i) else cv2.GaussianBlur(m, (0, 0), 4) for i, m in enumerate(images)], codec)


def numbers(folder):
    return [int(p.stem.split("_")[1]) for p in sorted(folder.glob("*.jpg"))]


@pytest.mark.parametrize("name", ["a.mp4", "b.avi", "c.mkv", "d.mov"])
def test_sharp_frames_are_chosen_and_spread(tmp_path, name):
    path = clip(tmp_path / name, codec="MJPG" if name == "b.avi" else "mp4v")
    assert video.is_video(path)
    assert video.extract(path, tmp_path / "f", VideoOptions(count=12)) == ()
    found = numbers(tmp_path / "f")
    assert found == [5 * i + 2 for i in range(12)], "the sharp one of every slot"
    first = cv2.imread(str(tmp_path / "f" / "frame_000002.jpg"))
    assert np.abs(first.astype(int) - picture(16)).mean() < 12


def test_the_same_again_and_skipped_when_unchanged(tmp_path):
    path = clip(tmp_path / "a.mp4")
    video.extract(path, tmp_path / "f", VideoOptions(count=6))
    before = {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in (tmp_path / "f").iterdir()}
    video.extract(path, tmp_path / "f", VideoOptions(count=6))
    assert {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in (tmp_path / "f").iterdir()} == before
    video.extract(path, tmp_path / "g", VideoOptions(count=6))
    assert {p.name: p.read_bytes() for p in (tmp_path / "g").iterdir()} == {n: b for n, (b, _) in before.items()}
    video.extract(path, tmp_path / "f", VideoOptions(count=7))
    assert len(numbers(tmp_path / "f")) == 7


def test_other_content_makes_another_key(tmp_path):
    clip(tmp_path / "a.mp4", 20, step=8)
    one = photo_source.run(tmp_path / "a.mp4", tmp_path / "w", None, VideoOptions(count=5))
    clip(tmp_path / "a.mp4", 20, step=9)
    two = photo_source.run(tmp_path / "a.mp4", tmp_path / "w", None, VideoOptions(count=5))
    assert one.folder == two.folder == tmp_path / "w" / "video"
    assert one.key != two.key


def test_a_camera_that_stands_still(tmp_path):
    moving = [picture(8 * max(0, i - 30)) for i in range(60)]
    video.extract(write(tmp_path / "a.mp4", moving), tmp_path / "f", VideoOptions(count=12))
    found = numbers(tmp_path / "f")
    assert sum(n <= 30 for n in found) <= 1
    assert len(found) >= 6
    write(tmp_path / "b.mp4", [picture(0)] * 40)
    with pytest.raises(InputError, match="walk round"):
        video.extract(tmp_path / "b.mp4", tmp_path / "g", VideoOptions(count=12))
    assert not (tmp_path / "g").exists(), "nothing half-written"


def test_slots_without_a_sharp_frame_are_left_out(rng):
    sharpness = np.where(np.arange(40) < 8, 1.0, 100 + np.arange(40.0))
    look = Look(np.arange(40), sharpness, rng.integers(0, 255, (40, 24, 24)).astype(np.uint8), 40, 40)
    chosen = video.choose(look, VideoOptions(count=10))
    assert chosen.tolist() == [11, 15, 19, 23, 27, 31, 35, 39]


@pytest.mark.parametrize("count", [3, 10, 39, 60])
def test_spread_holds_for_any_sharpness(rng, count):
    look = Look(
        np.arange(200), rng.uniform(50, 60, 200), rng.integers(0, 255, (200, 24, 24)).astype(np.uint8), 200, 200
    )
    chosen = video.choose(look, VideoOptions(count=count))
    assert len(chosen) == count
    slots = chosen * count // 200
    assert (slots == np.arange(count)).all()


def rotated(path, source, matrix):
    """The clip with another display matrix in its track header, as a phone held upright writes it."""
    data = bytearray(source.read_bytes())
    at = data.index(b"tkhd") + 4 + 40
    for i, value in enumerate(matrix):
        data[at + 4 * i : at + 4 * i + 4] = int(value).to_bytes(4, "big", signed=True)
    path.write_bytes(data)
    return path


def test_rotation_is_honoured(tmp_path):
    source = clip(tmp_path / "a.mp4", 20, sharp=lambda i: True)
    turned = rotated(tmp_path / "b.mp4", source, [0, 65536, 0, -65536, 0, 0, SIZE[1] * 65536, 0, 1 << 30])
    video.extract(turned, tmp_path / "f", VideoOptions(count=5))
    number = numbers(tmp_path / "f")[0]
    image = cv2.imread(str(tmp_path / "f" / f"frame_{number:06d}.jpg"))
    assert image.shape == (SIZE[0], SIZE[1], 3)
    upright = cv2.rotate(picture(8 * number), cv2.ROTATE_90_CLOCKWISE)
    assert np.abs(image.astype(int) - upright).mean() < 20


def test_a_video_that_is_cut_short(tmp_path):
    """AVI begins with its frame count; the frames up to the cut are used when there are enough."""
    data = clip(tmp_path / "a.avi", 60, codec="MJPG").read_bytes()
    (tmp_path / "most.avi").write_bytes(data[: int(0.6 * len(data))])
    warnings = video.extract(tmp_path / "most.avi", tmp_path / "f", VideoOptions(count=20))
    assert "of the 60 frames" in warnings[0]
    assert len(numbers(tmp_path / "f")) >= 12
    assert photo_source.run(tmp_path / "most.avi", tmp_path / "w", None, VideoOptions(count=20)).warnings == warnings
    (tmp_path / "little.avi").write_bytes(data[: int(0.1 * len(data))])
    with pytest.raises(InputError, match=r"cut off|decoded"):
        video.extract(tmp_path / "little.avi", tmp_path / "g", VideoOptions(count=20))
    assert not (tmp_path / "g").exists()


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.9])
def test_an_mp4_without_its_end_has_no_index(tmp_path, share):
    data = clip(tmp_path / "a.mp4", 30).read_bytes()
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match=r"cut off|no video") as caught:
        video.extract(cut, tmp_path / "f")
    assert caught.value.exit_code == 2
    assert not (tmp_path / "f").exists()


def test_damage_in_the_middle_is_survived(tmp_path):
    data = bytearray(clip(tmp_path / "a.mp4", 40).read_bytes())
    start, end = data.index(b"mdat"), data.index(b"moov")
    middle = (start + end) // 2
    data[middle : middle + 400] = bytes(400)
    (tmp_path / "b.mp4").write_bytes(data)
    video.extract(tmp_path / "b.mp4", tmp_path / "f", VideoOptions(count=10))
    assert len(numbers(tmp_path / "f")) >= 3


def test_names_that_are_not_the_content(tmp_path):
    fake = tmp_path / "fake.mp4"
    fake.write_text("#EXTM3U\nhttp://example.com/a.ts\n" * 30)
    with pytest.raises(InputError, match="no video"):
        video.extract(fake, tmp_path / "f")
    with pytest.raises(InputError, match="no video"):
        photo_source.check(fake, None)
    hidden = clip(tmp_path / "a.mp4", 10).rename(tmp_path / "clip.bin")
    assert video.is_video(hidden)
    cv2.imwrite(str(tmp_path / "photo.jpg"), picture(0))
    assert not video.is_video(tmp_path / "photo.jpg")
    with pytest.raises(InputError, match="--frames"):
        video.extract(hidden, tmp_path / "f", VideoOptions(count=1))
