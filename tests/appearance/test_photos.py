"""What photos say about colours: a known paint comes back, whatever hides it, shines on it, or stands beside it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from procmodels.look import linear
from recon.appearance import photos
from recon.appearance.atlas import unwrapped
from recon.appearance.photos import LookOptions
from recon.appearance.texels import Texels
from recon.scene import InputError
from tests.appearance.made_photos import FLOOR, around, part_named, photographed, screen, stool

SIZE = 256
PLAIN = LookOptions(size=SIZE, unshaded=False)  # the photos here are drawn without light
PARTS = np.array([(0.5, 0.1, 0.08), (0.1, 0.12, 0.5), (0.4, 0.32, 0.1)])  # linear RGB


def stripes(places, normals, parts):
    """Broad waves, the same on both sides."""
    wave = np.stack([np.abs(places[:, 0]), places[:, 1], places[:, 2]], 1) * 14
    return 0.35 + 0.2 * np.sin(wave + np.array([0.0, 1.0, 2.0]))


def by_part(places, normals, parts):
    return PARTS[parts]


def _truth(shape, paint) -> tuple[Texels, np.ndarray]:
    atlas = unwrapped(shape, SIZE)
    texels = Texels.of(atlas)
    return texels, paint(texels.places, atlas.normals[texels.triangle], atlas.part[texels.triangle])


def _apart(look, texels, truth) -> np.ndarray:
    """(n,) largest difference of a channel, in 8 bits of sRGB."""
    from procmodels.look import srgb

    shown = look.picture.reshape(-1, 3)[texels.flat].astype(float)
    return np.abs(shown - 255 * srgb(truth)).max(1)


@pytest.fixture(scope="module")
def striped(tmp_path_factory):
    return photographed(stool(), stripes, around(10), tmp_path_factory.mktemp("striped"))


@pytest.fixture(scope="module")
def look(striped):
    return photos.run(stool(), striped, PLAIN).look


def test_a_known_texture_comes_back(look):
    texels, truth = _truth(stool(), stripes)
    low = texels.places[:, 2] < 0.18  # boards; the seat's underside is not seen
    assert np.median(_apart(look, texels, truth)) < 4
    assert np.quantile(_apart(look, texels, truth)[low], 0.9) < 20, "a photo's pixel is as wide as four of the texture"


def test_the_same_photos_give_the_same_bytes(striped, look):
    again = photos.run(stool(), striped, PLAIN).look
    assert again.picture.tobytes() == look.picture.tobytes()
    assert again.colours.tobytes() == look.colours.tobytes()


def test_uv_lead_to_the_part_that_they_belong_to(tmp_path):
    """Read as any program would: the picture at the corners' uv, a little inwards, has the part's colour."""
    shape = stool()
    found = photos.run(shape, photographed(shape, by_part, around(8), tmp_path), PLAIN).look
    assert found.colours == pytest.approx(PARTS, abs=0.012)
    for i, part in enumerate(shape.parts):
        start = 0
        for face in part.faces:
            u, v = found.uv[i][start : start + len(face)].mean(0)
            start += len(face)
            shown = linear(found.picture[int((1 - v) * SIZE), int(u * SIZE)] / 255)
            assert shown == pytest.approx(PARTS[i], abs=0.02)


def test_exposures_that_differ_leave_no_seams(tmp_path):
    gains = 2 ** np.random.default_rng(1).uniform(-0.4, 0.4, 10)[:, None] * np.ones(3)
    scene = photographed(stool(), by_part, around(10), tmp_path, gains)
    found = photos.run(stool(), scene, PLAIN).look
    assert found.colours / PARTS == pytest.approx(np.tile(np.median(gains), (3, 3)), rel=0.08)
    texels, truth = _truth(stool(), by_part)
    shown = linear(found.picture.reshape(-1, 3)[texels.flat] / 255) / truth
    assert np.quantile(shown, 0.95) / np.quantile(shown, 0.05) < 1.12, "photos alone differ by up to 1.7"


def test_highlights_are_left_out(striped, look, tmp_path):
    """Every photo has a white disc somewhere else: they change little where several photos look."""
    paths = []
    for i, path in enumerate(striped.poses.paths):
        image = cv2.imread(str(path))
        rows, columns = np.nonzero(striped.silhouettes.masks[i])
        k = (7919 * i) % len(rows)
        cv2.circle(image, (int(columns[k]), int(rows[k])), 4, (255, 255, 255), -1)
        paths.append(tmp_path / path.name)
        cv2.imwrite(str(paths[-1]), image)
    scene = replace(striped, poses=replace(striped.poses, paths=tuple(paths)))
    found = photos.run(stool(), scene, PLAIN).look
    apart = np.abs(found.picture.astype(int) - look.picture).max(2)
    assert (apart > 40).mean() < 0.02
    assert found.colours == pytest.approx(look.colours, abs=0.03)


def test_a_camera_that_something_hides_does_not_paint(tmp_path):
    """All cameras but two stand before the screen: the post behind it keeps its own colour."""
    shape, colours = screen(), np.array([(0.5, 0.05, 0.05), (0.05, 0.05, 0.5)])
    poses = [*around(6, arc=60, start=-120), *around(2, arc=60, start=60)]
    found = photos.run(shape, photographed(shape, lambda p, n, k: colours[k], poses, tmp_path), PLAIN).look
    post, _ = part_named(shape, "post")
    texels, _ = _truth(shape, lambda p, n, k: colours[k])
    atlas = unwrapped(shape, SIZE)
    mine = texels.flat[atlas.part[texels.triangle] == post]
    shown = linear(found.picture.reshape(-1, 3)[mine] / 255)
    assert found.colours[post] == pytest.approx(colours[0], abs=0.02)
    assert (shown[:, 2] < 0.1).mean() > 0.99


def test_masks_that_are_too_wide_take_no_floor(tmp_path):
    scene = photographed(stool(), by_part, around(8), tmp_path, spread=2)
    turned = np.radians(0.12)  # about a third of a pixel: and poses that are a little off
    cos, sin = np.cos(turned), np.sin(turned)
    off = np.array([(cos, 0, sin, 0), (0, 1, 0, 0), (-sin, 0, cos, 0), (0, 0, 0, 1)])
    cameras = replace(scene.cameras, cam_from_world=off @ scene.cameras.cam_from_world)
    found = photos.run(stool(), replace(scene, poses=replace(scene.poses, cameras=cameras)), PLAIN).look
    texels, _ = _truth(stool(), by_part)
    shown = linear(found.picture.reshape(-1, 3)[texels.flat] / 255)
    assert (shown[:, 1] > 0.5 * FLOOR[1]).mean() < 0.005
    assert found.colours == pytest.approx(PARTS, abs=0.02)


def test_a_side_that_nobody_saw_is_the_mirror_image(tmp_path):
    """Photos from the right alone: the left board's outer side is striped as well."""
    scene = photographed(stool(), stripes, around(6, arc=110, start=-55), tmp_path)
    found = photos.run(stool(), scene, PLAIN)
    atlas, (texels, truth) = unwrapped(stool(), SIZE), _truth(stool(), stripes)
    outer = (atlas.normals[texels.triangle, 0] < -0.9) & (texels.places[:, 0] < -0.4)
    assert outer.sum() > 500
    assert np.median(_apart(found.look, texels, truth)[outer]) < 10
    assert found.seen < 0.6


def test_what_gives_no_colours(striped, tmp_path):
    assert photos.run(stool(), striped, replace(PLAIN, plain=True)).look is None
    unused = replace(striped.silhouettes, used=np.zeros(10, bool))
    assert photos.run(stool(), replace(striped, silhouettes=unused), PLAIN).look is None
    empty = replace(striped.silhouettes, masks=tuple(np.zeros_like(m) for m in striped.silhouettes.masks))
    assert photos.run(stool(), replace(striped, silhouettes=empty), PLAIN).look is None
    gone = replace(striped.poses, paths=(tmp_path / "gone.png", *striped.poses.paths[1:]))
    with pytest.raises(InputError, match=r"gone\.png is missing"):
        photos.run(stool(), replace(striped, poses=gone), PLAIN)


def test_what_stands_beside_does_not_paint_a_thin_part(tmp_path):
    """Two of eight photos were taken from elsewhere than is believed: they show the floor or a neighbour on parts."""
    scene = photographed(stool(), by_part, around(8), tmp_path, spread=8)
    poses = scene.cameras.cam_from_world.copy()
    poses[[2, 5], 0, 3] += 0.08
    cameras = replace(scene.cameras, cam_from_world=poses)
    found = photos.run(stool(), replace(scene, poses=replace(scene.poses, cameras=cameras)), PLAIN).look
    texels, truth = _truth(stool(), by_part)
    assert found.colours == pytest.approx(PARTS, abs=0.02)
    assert (_apart(found, texels, truth) > 40).mean() < 0.03
