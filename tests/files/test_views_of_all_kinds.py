"""Photos as people have them: raw ones, JPEG 2000 and AVIF, zips, AV1 videos, what systems leave, odd files."""

import io
import logging
import os
import stat
import struct
import zipfile
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from PIL import Image
from skimage import data

from recon.command import main
from recon.files import frames, raw_photo, recognise, video, zipped
from recon.files.frames import FramesOptions
from recon.files.video import VideoOptions
from recon.pipelines import photo_source
from recon.scene import InputError
from recon.system import limits

COFFEE = Image.fromarray(data.coffee())  # 600 x 400


def photo(seed=0, size=(240, 180)):
    x, y = np.random.default_rng(seed).integers(0, 200, 2)
    return COFFEE.crop((x, y, x + 240, y + 180)).resize(size)


def jpeg(image, **options):
    out = io.BytesIO()
    image.save(out, "JPEG", quality=95, **options)
    return out.getvalue()


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "photos"
    path.mkdir()
    return path


def read(folder, **options):
    return frames.run(folder, folder.parent / "work", FramesOptions(**options))


def difference(path, image):
    return np.abs(np.asarray(Image.open(path), float) - np.asarray(image, float)).mean()


def dng(path, image, preview=None, orientation=1):
    """A raw photo as cameras write it: a thumbnail of 60 x 45, the sensor's values, and maybe a preview as JPEG."""
    thumb = np.asarray(image.resize((60, 45))).tobytes()
    linear = np.round((np.asarray(image, float) / 255) ** 2.2 * 60000).astype("<u2")
    mosaic = linear[..., 1].copy()  # RGGB
    mosaic[::2, ::2], mosaic[1::2, 1::2] = linear[::2, ::2, 0], linear[1::2, 1::2, 2]
    blocks = [thumb, mosaic.tobytes(), *([] if preview is None else [preview])]
    ones = [(1, 1), (0, 1), (0, 1), (0, 1), (1, 1), (0, 1), (0, 1), (0, 1), (1, 1)]
    height, width = mosaic.shape
    raw = [(254, 4, [0]), (256, 4, [width]), (257, 4, [height]), (258, 3, [16]), (259, 3, [1]), (262, 3, [32803])]
    raw += [(273, 4, ["at1"]), (277, 3, [1]), (278, 4, [height]), (279, 4, [mosaic.nbytes])]
    raw += [(33421, 3, [2, 2]), (33422, 1, [0, 1, 1, 2]), (50717, 4, [60000])]
    small = [(254, 4, [1]), (256, 4, [60]), (257, 4, [45]), (258, 3, [8, 8, 8]), (259, 3, [1]), (262, 3, [2])]
    small += [(271, 2, b"Test\0"), (272, 2, b"Camera\0"), (273, 4, ["at0"]), (274, 3, [orientation]), (277, 3, [3])]
    small += [(278, 4, [45]), (279, 4, [len(thumb)]), (330, 4, ["raw", "preview"][: len(blocks) - 1])]
    small += [(50706, 1, [1, 4, 0, 0]), (50708, 2, b"Test Camera\0"), (50721, 10, ones), (50728, 5, [(1, 1)] * 3)]
    lists = {"": small, "raw": raw}
    if preview is not None:
        w, h = Image.open(io.BytesIO(preview)).size
        lists["preview"] = [(254, 4, [1]), (256, 4, [w]), (257, 4, [h]), (258, 3, [8, 8, 8]), (259, 3, [7])]
        lists["preview"] += [(262, 3, [6]), (273, 4, ["at2"]), (277, 3, [3]), (278, 4, [h]), (279, 4, [len(preview)])]
    path.write_bytes(tiff(lists, blocks))


FORMS = {1: "B", 2: "s", 3: "H", 4: "I", 5: "II", 10: "ii"}


def tiff(lists, blocks):
    """Little-endian TIFF of named lists of (tag, type, values), the first is ""; names as values mean places."""
    places, at = {}, 8
    for name, entries in lists.items():
        places[name], at = at, at + 2 + 12 * len(entries) + 4
    for i, block in enumerate(blocks):
        places[f"at{i}"], at = at, at + len(block) + len(block) % 2
    body, extra = b"", b""
    for entries in lists.values():
        body += struct.pack("<H", len(entries))
        for tag, kind, values in sorted(entries):
            flat = [places.get(v, v) for v in values] if not isinstance(values, bytes) else values
            if isinstance(flat, bytes):
                packed = flat
            elif kind in (5, 10):
                packed = b"".join(struct.pack("<" + FORMS[kind], *v) for v in flat)
            else:
                packed = struct.pack(f"<{len(flat)}{FORMS[kind]}", *flat)
            if len(packed) > 4:
                place = at + len(extra)
                extra += packed + b"\0" * (len(packed) % 2)
                packed = struct.pack("<I", place)
            body += struct.pack("<HHI", tag, kind, len(values)) + packed.ljust(4, b"\0")
        body += struct.pack("<I", 0)
    return b"II*\0\x08\0\0\0" + body + b"".join(b + b"\0" * (len(b) % 2) for b in blocks) + extra


# ---- raw photos ----


def test_the_full_size_preview_of_a_raw_photo_is_used(folder):
    for i in range(2):
        dng(folder / f"{i}.DNG", photo(5), jpeg(photo(i)))
    found = read(folder)
    assert found.sizes.tolist() == [[240, 180]] * 2
    for i, path in enumerate(found.paths):
        assert difference(path, photo(i)) < 4


def test_a_raw_photo_without_a_large_preview_is_developed(folder):
    for i in range(2):
        dng(folder / f"{i}.dng", photo(i, (480, 360)), jpeg(photo(7, (160, 120))))
    found = read(folder)
    assert found.sizes.tolist() == [[240, 180]] * 2, "never the thumbnail of 60 or 160 pixels"
    # libraw chooses brightness and colour itself; what is seen is the same.
    pictures = [*map(Image.open, found.paths), photo(0), photo(1)]
    alike = np.corrcoef([np.asarray(im.convert("L"), float).ravel() for im in pictures])
    assert min(alike[0, 2], alike[1, 3]) > 0.85
    assert max(alike[0, 3], alike[1, 2]) < 0.5


def test_a_raw_photo_taken_upright(folder):
    for i in range(2):
        dng(folder / f"{i}.dng", photo(i, (480, 360)), orientation=6)
    assert read(folder).sizes.tolist() == [[180, 240]] * 2


def test_of_a_raw_photo_and_its_jpeg_one_is_used_and_that_is_said(folder, caplog):
    for i in range(3):
        dng(folder / f"DJI_{i}.DNG", photo(i))
        photo(i, (480, 360)).save(folder / f"dji_{i}.JPG", quality=95)
    with caplog.at_level(logging.INFO, "recon"):
        seen = recognise.recognise(folder)
    assert "3 photos (not used: 3 raw, beside the same photo developed (DJI_0.DNG, ...))" in caplog.text
    assert seen.kind == recognise.Kind.PHOTOS
    found = read(folder)
    assert found.names == ("dji_0.JPG", "dji_1.JPG", "dji_2.JPG")
    assert not found.skipped


def test_what_libraw_cannot_read_is_skipped_with_a_reason(folder):
    photo(0).save(folder / "a.jpg")
    photo(1).save(folder / "b.jpg")
    photo(2, (160, 120)).save(folder / "c.DNG", "TIFF")  # no more than a thumbnail
    found = read(folder)
    assert found.names == ("a.jpg", "b.jpg")
    assert "export it as JPEG" in dict(found.skipped)["c.DNG"]


def test_without_rawpy_the_way_to_get_it_is_said(folder, monkeypatch):
    dng(folder / "a.nef", photo(0))
    monkeypatch.setitem(__import__("sys").modules, "rawpy", None)
    with pytest.raises(raw_photo.RawError, match=r'pip install "nnproc-recon\[raw\]"'):
        raw_photo.read(folder / "a.nef")


# ---- other formats ----


@pytest.mark.parametrize("ending", ["jp2", "j2k", "avif", "webp", "tiff", "jfif"])
def test_formats(folder, ending):
    for i in range(2):
        photo(i).save(folder / f"{i}.{ending}", quality=95) if ending != "j2k" else photo(i).save(folder / f"{i}.j2k")
    found = read(folder)
    assert found.names == (f"0.{ending}", f"1.{ending}")
    assert difference(found.paths[0], photo(0)) < 4
    assert recognise.recognise(folder / f"0.{ending}").kind == recognise.Kind.IMAGE
    assert "a folder of 2 photos" in recognise.recognise(folder).what


def png_header(width, height):
    """A PNG of that size by its header, with a few bytes of data."""
    chunk = lambda name, body: struct.pack(">I", len(body)) + name + body + struct.pack(">I", 0)  # noqa: E731
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    crc = struct.pack(">I", __import__("zlib").crc32(b"IHDR" + head))
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + head + crc + chunk(b"IDAT", b"x" * 20)


def bmp_header(width, height):
    return b"BM" + struct.pack("<IHHI", 54, 0, 0, 54) + struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, *[0] * 6)


@pytest.mark.parametrize("make", [png_header, bmp_header])
@pytest.mark.parametrize("size", [(32000, 32000), (60000, 60000), (100_000, 100)])
def test_sizes_are_looked_at_before_memory_is_taken(folder, make, size):
    photo(0).save(folder / "a.jpg")
    photo(1).save(folder / "b.jpg")
    (folder / "huge.png").write_bytes(make(*size))
    found = read(folder)
    assert found.names == ("a.jpg", "b.jpg")
    assert dict(found.skipped)["huge.png"].startswith("too large: at most 200 megapixels")
    assert recognise.recognise(folder).kind == recognise.Kind.PHOTOS


# ---- what is in folders besides photos ----


def test_what_systems_leave_is_nowhere(folder):
    for i in range(3):
        photo(i).save(folder / f"{i}.jpg")
        (folder / f"._{i}.jpg").write_bytes(b"\0\5\x16\7" + b"\0" * 300)
    for name in (".DS_Store", "Thumbs.db", "desktop.ini"):
        (folder / name).write_bytes(b"xyz")
    found = read(folder)
    assert found.names == ("0.jpg", "1.jpg", "2.jpg")
    assert not found.skipped
    assert recognise.recognise(folder).what == "a folder of 3 photos"


def test_odd_files_among_photos(folder, caplog):
    for i in range(2):
        photo(i).save(folder / f"{i}.jpg")
    os.mkfifo(folder / "pipe.jpg")
    (folder / "folder.jpg").mkdir()
    (folder / "loop.jpg").symlink_to(folder / "loop.jpg")
    (folder / "gone.jpg").symlink_to(folder / "nowhere")
    (folder / "null.jpg").symlink_to("/dev/zero")
    (folder / "notes.txt").write_text("x")
    with caplog.at_level(logging.INFO, "recon"):
        what = recognise.recognise(folder).what
    assert what.startswith("a folder of 2 photos (not used: 5 no ordinary files (")
    assert "1 no photos by their names (notes.txt)" in what
    assert read(folder).names == ("0.jpg", "1.jpg")
    assert photo_source.run(folder, folder.parent / "w", None, VideoOptions()).folder == folder


def test_a_file_that_may_not_be_read(folder, monkeypatch):
    for i in range(3):
        photo(i).save(folder / f"{i}.jpg")
    whole = Image.open

    def refusing(path, **options):
        if path.name == "1.jpg":
            raise PermissionError(13, "Permission denied")
        return whole(path, **options)

    monkeypatch.setattr(Image, "open", refusing)
    found = read(folder)
    assert found.names == ("0.jpg", "2.jpg")
    assert "permissions" in dict(found.skipped)["1.jpg"]


@pytest.mark.parametrize("option", ["INPUT", "--masks", "--cameras"])
@pytest.mark.parametrize("kind", ["long", "pipe", "device", "loop"])
def test_paths_that_are_no_files(folder, capsys, option, kind):
    for i in range(3):
        photo(i).save(folder / f"{i}.jpg")
    os.mkfifo(folder.parent / "pipe")
    (folder.parent / "loop").symlink_to(folder.parent / "loop")
    odd = {"long": "x" * 300, "device": "/dev/zero"}.get(kind, str(folder.parent / kind))
    given = [odd] if option == "INPUT" else [str(folder), option, odd]
    assert main([*given, "--out", str(folder.parent / "out")]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("error: ")
    assert odd in last


@pytest.mark.parametrize("name", ["{}_mask.png", "{}.jpg.mask.png", "mask_{}.png"])
def test_masks_beside_their_photos_are_no_photos(folder, name):
    for i in range(3):
        photo(i).save(folder / f"p{i}.jpg")
        Image.fromarray(np.uint8(np.arange(240)[None] > 99).repeat(180, 0) * 255).save(folder / name.format(f"p{i}"))
    assert "3 masks by their names, which --masks wants" in recognise.recognise(folder).what
    assert read(folder).names == ("p0.jpg", "p1.jpg", "p2.jpg")


# ---- zip files ----


def archive(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name, content in members:
            out.writestr(name, content)
    return path


def test_a_zip_of_photos(tmp_path):
    members = [(f"trip/{i}.jpg", jpeg(photo(i))) for i in range(3)]
    members += [("__MACOSX/trip/._0.jpg", b"x"), ("trip/.DS_Store", b"x"), ("trip/readme.exe", b"MZ")]
    path = archive(tmp_path / "a.zip", members)
    assert recognise.recognise(path) == recognise.Recognised(recognise.Kind.PHOTOS, "a zip file of 3 photos")
    photo_source.check(path, None)
    given = photo_source.run(path, tmp_path / "w", None, VideoOptions())
    assert [p.name for p in sorted(given.folder.iterdir())] == ["0.jpg", "1.jpg", "2.jpg"]
    assert frames.run(given.folder, tmp_path / "w2").names == ("0.jpg", "1.jpg", "2.jpg")
    assert photo_source.run(path, tmp_path / "w3", None, VideoOptions()).key == given.key


@pytest.mark.parametrize("name", ["../evil.jpg", "/tmp/evil.jpg", "a/../../evil.jpg", "..\\evil.jpg", "C:\\evil.jpg"])
def test_a_zip_cannot_write_outside(tmp_path, name):
    path = archive(tmp_path / "a.zip", [("a.jpg", jpeg(photo(0))), (name, b"evil")])
    with pytest.raises(InputError, match="outside its folder"):
        zipped.unpack(path, tmp_path / "in" / "side")
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["a.zip"]


def test_links_and_bombs_in_a_zip(tmp_path, monkeypatch):
    link = zipfile.ZipInfo("b.jpg")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as out:
        out.writestr("a.jpg", jpeg(photo(0)))
        out.writestr(link, "/etc/passwd")
    with pytest.raises(InputError, match="holds a link"):
        zipped.unpack(tmp_path / "a.zip", tmp_path / "u")
    monkeypatch.setattr(limits, "PICTURE_BYTES", 1 << 20)
    path = archive(tmp_path / "b.zip", [("a.jpg", b"\0" * (2 << 20))])
    with pytest.raises(InputError, match="which is no photo"):
        zipped.unpack(path, tmp_path / "u")


def test_a_damaged_zip_gives_one_line(tmp_path):
    path = archive(tmp_path / "a.zip", [(f"{i}.jpg", jpeg(photo(i))) for i in range(3)])
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(40):
        broken = bytearray(whole)
        for at in rng.integers(0, len(whole), 20):
            broken[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        try:
            zipped.unpack(path, tmp_path / "u")
        except InputError as error:
            assert "\n" not in str(error)  # noqa: PT017


# ---- videos ----


def clip(path, codec, count=24, options=None):
    """A film of a detail that moves, by PyAV."""
    wide = np.asarray(COFFEE.resize((900, 600)))
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=Fraction(8), options=options or {})
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        for i in range(count):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(wide[100:340, 20 * i : 20 * i + 320]), "rgb24")
            for packet in stream.encode(frame):
                out.mux(packet)
        for packet in stream.encode():
            out.mux(packet)
    return path, [cv2.cvtColor(wide[100:340, 20 * i : 20 * i + 320], cv2.COLOR_RGB2BGR) for i in range(count)]


@pytest.mark.parametrize(("name", "codec"), [("a.mp4", "libsvtav1"), ("b.mts", "mpeg2video"), ("c.webm", "libvpx-vp9")])
def test_videos(tmp_path, name, codec):
    path, images = clip(tmp_path / name, codec)
    assert recognise.recognise(path).kind == recognise.Kind.VIDEO
    assert video.extract(path, tmp_path / "f", VideoOptions(count=8)) == ()
    found = sorted((tmp_path / "f").glob("*.jpg"))
    assert len(found) == 8
    for file in found:
        true = images[int(file.stem.split("_")[1])]
        assert np.abs(cv2.imread(str(file)).astype(int) - true).mean() < 12


def test_an_av1_video_that_is_cut_off(tmp_path):
    path, _ = clip(tmp_path / "a.webm", "libsvtav1")
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(InputError) as caught:
        video.extract(path, tmp_path / "f", VideoOptions(count=8))
    assert "\n" not in str(caught.value)
