"""Reading photos: formats, orientation, focal length, alpha, and every way in which a folder can be wrong."""

import math

import numpy as np
import pillow_heif
import pytest
from PIL import ExifTags, Image
from skimage import data

from recon.files import frames
from recon.files.frames import FramesOptions
from recon.files.photo import exif_focal
from recon.scene import InputError

pillow_heif.register_heif_opener()
COFFEE = Image.fromarray(data.coffee())  # 600 x 400


def photo(seed: int = 0, size: tuple[int, int] = (120, 90)) -> Image.Image:
    """A different detail of a photograph for each seed."""
    x, y = np.random.default_rng(seed).integers(0, 200, 2)
    return COFFEE.crop((x, y, x + 240, y + 180)).resize(size)


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "photos"
    path.mkdir()
    return path


def read(folder, **options):
    return frames.run(folder, folder.parent / "work", FramesOptions(**options))


def fill(folder, count=3):
    for i in range(count):
        photo(i).save(folder / f"good{i}.jpg", quality=95)


@pytest.mark.parametrize("ending", ["jpg", "png", "heic", "webp", "tif", "bmp"])
def test_format(folder, ending):
    for i in range(2):
        photo(i).save(folder / f"{i}.{ending}", quality=95)
    found = read(folder)
    assert found.names == (f"0.{ending}", f"1.{ending}")
    assert found.sizes.tolist() == [[120, 90]] * 2
    back = np.asarray(Image.open(found.paths[0]), float)
    assert np.abs(back - np.asarray(photo(0), float)).mean() < 4
    assert found.alpha == (None, None)
    assert not found.skipped


def test_several_pictures_in_one_file(folder):
    """Phones write a JPEG with a second picture behind it (MPO); the first one counts."""
    photo(0).save(folder / "a.jpg", format="MPO", save_all=True, append_images=[photo(5)], quality=95)
    photo(1).save(folder / "b.jpg")
    copy = np.asarray(Image.open(read(folder).paths[0]), float)
    assert np.abs(copy - np.asarray(photo(0), float)).mean() < 4


def test_content_counts_not_the_name(folder):
    photo(0).save(folder / "a.jpg", format="PNG")
    photo(1).save(folder / "b", format="JPEG")
    (folder / "c.jpg").write_text("no photo at all")
    (folder / "notes.txt").write_text("no photo either")
    (folder / ".hidden.jpg").write_text("hidden")
    found = read(folder)
    assert found.names == ("a.jpg", "b")
    assert [name for name, _ in found.skipped] == ["c.jpg"]


def test_natural_order(folder):
    for i, name in enumerate(["p10.jpg", "p2.jpg", "P1.jpg"]):
        photo(i).save(folder / name)
    assert read(folder).names == ("P1.jpg", "p2.jpg", "p10.jpg")


@pytest.mark.parametrize("ending", ["jpg", "png", "tif", "heic"])
@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_orientation_is_applied_once(folder, ending, orientation):
    upright = photo(0)
    turn = {1: None, 3: Image.Transpose.ROTATE_180, 6: Image.Transpose.ROTATE_90, 8: Image.Transpose.ROTATE_270}
    stored = upright if turn[orientation] is None else upright.transpose(turn[orientation])
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    stored.save(folder / f"a.{ending}", exif=exif.tobytes(), quality=95)  # HEIF becomes self-turning
    photo(1).save(folder / "b.jpg")
    copy = Image.open(read(folder).paths[0])
    assert copy.size == upright.size
    assert copy.getexif().get(ExifTags.Base.Orientation, 1) == 1
    assert np.abs(np.asarray(copy, float) - np.asarray(upright, float)).mean() < 4


def test_large_photos_are_reduced_and_small_ones_kept(folder):
    photo(0, (3000, 2000)).save(folder / "a.jpg")
    photo(1, (200, 300)).save(folder / "b.jpg")
    assert read(folder).sizes.tolist() == [[1000, 667], [200, 300]]
    assert read(folder, longest_side=150).sizes.tolist() == [[150, 100], [100, 150]]


def exif_with(**values):
    exif = Image.Exif()
    for name, value in values.items():
        exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base[name]] = value
    return exif


def test_focal_length_in_pixels_of_the_working_copy(folder):
    exif = exif_with(FocalLengthIn35mmFilm=28)
    photo(0, (4000, 3000)).save(folder / "a.jpg", exif=exif)
    photo(1, (4000, 3000)).save(folder / "b.jpg")
    focal = read(folder).focal_px
    assert focal[0] == pytest.approx(28 / 43.27 * math.hypot(1000, 750), rel=1e-6)
    assert math.isnan(focal[1])


def test_focal_length_from_the_sensor():
    # 22.3 mm wide sensor, 5184 px: a focal length of 50 mm is 11623 px.
    per_inch = 5184 / 22.3 * 25.4
    exif = exif_with(FocalLength=50.0, FocalPlaneXResolution=per_inch, FocalPlaneResolutionUnit=2)
    assert exif_focal(exif, (5184, 3456)) * math.hypot(5184, 3456) == pytest.approx(50 / 22.3 * 5184)
    # The same photo made smaller by an editor: EXIF still says what the camera wrote.
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.ExifImageWidth] = 5184
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.ExifImageHeight] = 3456
    assert exif_focal(exif, (1296, 864)) * math.hypot(1296, 864) == pytest.approx(50 / 22.3 * 1296)
    assert exif_focal(exif, (864, 1296)) * math.hypot(1296, 864) == pytest.approx(50 / 22.3 * 1296)


@pytest.mark.parametrize("values", [{}, {"FocalLength": 50.0}, {"FocalLengthIn35mmFilm": 0}])
def test_unknown_focal_length(values):
    assert math.isnan(exif_focal(exif_with(**values), (400, 300)))


def test_sharpness_orders_blur(folder):
    from PIL import ImageFilter

    for i, radius in enumerate([0, 2, 6]):
        photo(0, (800, 600)).filter(ImageFilter.GaussianBlur(radius)).save(folder / f"{i}.png")
    found = read(folder, same_difference=-1)
    assert found.sharpness[0] > found.sharpness[1] > found.sharpness[2]


def test_alpha_becomes_a_mask(folder):
    image = photo(0).convert("RGBA")
    alpha = np.zeros((90, 120), np.uint8)
    alpha[20:70, 30:90] = 255
    image.putalpha(Image.fromarray(alpha))
    image.save(folder / "a.png")
    opaque = photo(1).convert("RGBA")
    opaque.save(folder / "b.png")
    found = read(folder)
    assert found.alpha[1] is None
    assert np.array_equal(np.asarray(Image.open(found.alpha[0])), alpha)
    copy = np.asarray(Image.open(found.paths[0]), float)
    assert np.abs(copy[:15] - 128).max() < 12  # grey where nothing is
    assert np.abs(copy[25:65, 35:85] - np.asarray(photo(0), float)[25:65, 35:85]).mean() < 4


def test_sixteen_bits_grey_cmyk_and_palette(folder):
    grey = np.asarray(photo(0).convert("L"))
    Image.fromarray(grey.astype(np.uint16) * 257).save(folder / "a16.png")
    Image.fromarray(grey[:, ::-1].copy()).save(folder / "b8.png")
    photo(1).convert("CMYK").save(folder / "c.jpg", quality=95)
    photo(2).quantize(64).save(folder / "d.png")
    photo(3).convert("LA").save(folder / "e.png")
    found = read(folder)
    copies = [np.asarray(Image.open(p), float) for p in found.paths]
    assert len(copies) == 5
    assert all(c.shape == (90, 120, 3) for c in copies)
    assert np.abs(copies[0] - grey[..., None]).mean() < 2
    assert np.abs(copies[2] - np.asarray(photo(1), float)).mean() < 6


def test_damaged_photos_are_named_and_skipped(folder):
    fill(folder)
    content = (folder / "good0.jpg").read_bytes()
    (folder / "cut.jpg").write_bytes(content[: len(content) // 2])
    (folder / "empty.png").write_bytes(b"")
    photo(9, (20, 20)).save(folder / "tiny.png")
    found = read(folder)
    assert found.names == ("good0.jpg", "good1.jpg", "good2.jpg")
    assert dict(found.skipped).keys() == {"cut.jpg", "empty.png", "tiny.png"}
    assert "cut off" in dict(found.skipped)["cut.jpg"]
    assert "20 x 20" in dict(found.skipped)["tiny.png"]


def test_huge_image_is_refused_with_a_reason(folder, monkeypatch):
    fill(folder)
    photo(9, (500, 400)).save(folder / "huge.png")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 50_000)
    found = read(folder)
    assert "too large" in dict(found.skipped)["huge.png"]


def test_repeated_photo_is_kept_once(folder):
    fill(folder)
    photo(1).save(folder / "good1.png")
    found = read(folder)
    assert len(found.names) == 3
    assert found.skipped == (("good1.png", "the same picture as good1.jpg"),)


def test_single_photo(folder):
    photo().save(folder / "a.jpg")
    with pytest.raises(InputError, match="single photo needs a mask"):
        read(folder)
    assert read(folder, allow_single=True).names == ("a.jpg",)
    cut_out = photo().convert("RGBA")
    cut_out.putalpha(Image.linear_gradient("L").resize(cut_out.size))
    (folder / "a.jpg").unlink()
    cut_out.save(folder / "a.png")
    assert read(folder).alpha[0] is not None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, "is empty"),
        ({"a.txt": b"x", "b.pdf": b"%PDF-1.4"}, "no photo among the 2 files"),
        ({"walk.mp4": b"\0\0\0\x20ftypisom"}, "is a video"),
        ({"a.jpg": b"nonsense"}, "none of the 1 photos"),
    ],
)
def test_nothing_usable(folder, content, message):
    for name, data_ in content.items():
        (folder / name).write_bytes(data_)
    with pytest.raises(InputError, match=message) as error:
        read(folder)
    assert error.value.exit_code == 2


def test_missing_folder(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read(tmp_path / "nowhere")


def test_only_subfolders(folder):
    (folder / "day1").mkdir()
    with pytest.raises(InputError, match="day1"):
        read(folder)


def test_identical_photos(folder):
    for i in range(3):
        photo().save(folder / f"{i}.jpg", quality=80 + 5 * i)
    with pytest.raises(InputError, match="all 3 photos"):
        read(folder)


def test_photos_inside_the_work_folder_survive(tmp_path):
    inside = tmp_path / "work" / "frames"
    inside.mkdir(parents=True)
    photo().save(inside / "a.jpg")
    with pytest.raises(InputError, match="work folder"):
        frames.run(inside, tmp_path / "work")
    assert (inside / "a.jpg").exists()
