"""One image: the shape and the camera come back from a drawn mask; records, boxes and masks are read."""

import dataclasses
import json

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image

from nnproc.rays import look_at_cameras
from recon.evaluate import pix3d_dev
from recon.evaluate.robust import knocked
from recon.files import pix3d_camera
from recon.fitting.camera_search import find, find_all
from recon.fitting.one_view import CameraSearchOptions, OneView
from recon.fitting.search import Schedule
from recon.fitting.silhouette_bank import BankOptions, load_bank, search
from recon.geometry.raster import iou, silhouettes
from recon.geometry.view_geometry import guessed_K, seen_from, touching
from recon.masks import single_mask
from recon.outputs.write import OutputsOptions
from recon.pipelines import image, single_view
from recon.pipelines.single_view import ImageOptions
from recon.scene import InputError

CHAIR = {"width": 0.62, "depth": 0.47, "leg_height": 0.41, "legs": "basic", "arms": "solid", "back": "hbar"}
SIZE = (320, 240)
SMALL = CameraSearchOptions(
    bank=BankOptions(shapes=64, elevations=(8.0, 26.0), jitter=8.0, azimuth_step=20.0),
    placed=20,
    starts=6,
    finals=2,
)


@pytest.fixture(scope="module")
def bank(chair, tmp_path_factory):
    return load_bank(chair, SMALL.bank, cache=tmp_path_factory.mktemp("cache"))


def _drawn(chair, azimuth, elevation, params=CHAIR, distance=2.3):
    """A mask of 320 x 240, its K and its pose."""
    K, pose = (t[0].numpy() for t in look_at_cameras([azimuth], [elevation], distance, 40, 240))
    K[0, 2] = 160
    return silhouettes(chair.build(params), K[None], pose[None], np.array([SIZE]))[0], K, pose


def _saved(mask, path):
    Image.fromarray(mask.astype(np.uint8) * 255).save(path)
    return path


def _record(K, pose, scale=0.8):
    """Pix3D's record of a camera; their model is ours times `scale`, y up."""
    rotation = pix3d_camera.OPENCV_FROM_PIX3D.T @ pose[:3, :3] @ pix3d_camera.PIX3D_FROM_CANONICAL.T
    translation = pix3d_camera.OPENCV_FROM_PIX3D.T @ pose[:3, 3] * scale
    return {
        "img": "img/chair/0007.jpg",
        "mask": "mask/chair/0007.png",
        "category": "chair",
        "img_size": list(SIZE),
        "rot_mat": rotation.tolist(),
        "trans_mat": translation.tolist(),
        "focal_length": K[0, 0] * 32 / SIZE[0],
    }


def test_a_known_camera_gives_the_parameters_back(chair, bank):
    mask, K, pose = _drawn(chair, 40, 22)
    model_pose = pose.copy()
    model_pose[:3, 3] *= 0.8
    found = find(chair, OneView(mask, K, True, model_pose), bank, SMALL)
    assert iou(pix3d_dev.redrawn(chair, found, mask.shape), mask) > 0.95
    assert {k: v for k, v in found.refined.params.items() if isinstance(v, str)} == {
        k: v for k, v in CHAIR.items() if isinstance(v, str)
    }
    for s in chair.space.scalars:
        assert found.refined.params[s.name] == pytest.approx(CHAIR[s.name], abs=0.06 * (s.high - s.low))
    assert found.azimuth == pytest.approx(40, abs=2)


def test_a_given_camera_that_is_off_is_found_with_the_shape(chair, bank):
    mask, K, pose = _drawn(chair, 40, 22)
    given = knocked(pose)
    held, freed = (find(chair, OneView(mask, K, True, given, doubt), bank, SMALL) for doubt in (0, 10))
    assert freed.refined.mean_iou > held.refined.mean_iou + 0.03
    off = [abs(f.azimuth - 40) + abs(f.elevation - 22) for f in (held, freed)]
    assert off[0] > 10 > 3 * off[1]
    wrong = [
        max(abs(f.refined.params[s.name] - CHAIR[s.name]) / (s.high - s.low) for s in chair.space.scalars)
        for f in (held, freed)
    ]
    assert wrong[1] < 0.5 * wrong[0]


def test_doubt_about_a_camera_needs_a_camera_and_some_degrees(tmp_path):
    assert single_mask.checked_doubt(None, None) == 0
    assert single_mask.checked_doubt(8, tmp_path / "pix3d.json") == 8
    with pytest.raises(InputError, match="without --pix3d"):
        single_mask.checked_doubt(8, None)
    for degrees in (0, -3, 90, float("nan")):
        with pytest.raises(InputError, match="between 0 and 45"):
            single_mask.checked_doubt(degrees, tmp_path / "pix3d.json")


def test_an_unknown_camera_is_found_with_the_shape(chair, bank):
    mask, _, _ = _drawn(chair, 325, 18)
    found = find(chair, OneView(mask, guessed_K(*SIZE)), bank, SMALL)
    assert iou(pix3d_dev.redrawn(chair, found, mask.shape), mask) > 0.9
    assert abs((found.azimuth - 325 + 180) % 360 - 180) < 25
    assert -5 < found.elevation < 45


def test_the_bank_ranks_the_right_side_first_wherever_the_object_is(chair, bank):
    mask, _, _ = _drawn(chair, 300, 12)
    moved = np.zeros((300, 420), bool)
    small = cv2.resize(mask.astype(np.uint8), None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA) > 0
    moved[20 : 20 + small.shape[0], 200 : 200 + small.shape[1]] = small
    all_of_it = np.ones(len(bank.bits), bool)
    hits = search(bank, moved, np.ones_like(moved), SMALL.bank, all_of_it)
    unmoved = search(bank, mask, np.ones_like(mask), SMALL.bank, all_of_it)
    assert hits[0].score == pytest.approx(unmoved[0].score, abs=0.1)
    assert abs((bank.azimuth[hits[0].entry] - 300 + 180) % 360 - 180) <= 30


def test_the_bank_comes_from_the_cache(chair, tmp_path, caplog):
    options = BankOptions(shapes=3, elevations=(10.0,), azimuth_step=90.0)
    first, again = (load_bank(chair, options, cache=tmp_path) for _ in range(2))
    assert (first.bits == again.bits).all()
    assert first.params == again.params
    kept = sorted(tmp_path.iterdir())
    for file in kept:
        file.write_bytes(b"damaged")
        assert (load_bank(chair, options, cache=tmp_path).bits == first.bits).all()
        assert f"{file} is damaged" in caplog.text
    other_source = dataclasses.replace(chair, code="edited")
    load_bank(other_source, options, cache=tmp_path)
    assert len(list(tmp_path.iterdir())) == 2 * len(kept), "another build, another bank"


def test_an_object_that_the_edge_cuts_off_is_noticed():
    mask = np.zeros((50, 60), bool)
    mask[20:, 10:30] = True
    assert touching(mask, np.ones_like(mask)) == (False, False, False, True)


def test_what_is_hidden_counts_neither_way(chair, bank, tmp_path):
    mask, K, pose = _drawn(chair, 40, 22)
    columns = np.flatnonzero(mask.any(0))
    grey = np.zeros(mask.shape, bool)
    grey[:, int(np.quantile(columns, 0.7)) :] = True  # behind a curtain
    picture = np.where(grey, 128, np.where(mask, 255, 0)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "mask.png"), picture)
    masked = single_mask.run(tmp_path / "mask.png", tmp_path / "work")
    assert masked.known is not None
    assert (masked.mask == (mask & ~grey)).mean() > 0.999
    assert touching(masked.mask, masked.known) == (False, False, True, False)
    seen = find(chair, OneView(masked.mask, K, True, pose, known=masked.known), bank, SMALL)
    taken = find(chair, OneView(masked.mask, K, True, pose), bank, SMALL)
    off = [abs(f.refined.params["width"] - CHAIR["width"]) for f in (seen, taken)]
    assert off[0] < 0.04 < off[1]


def test_a_record_projects_the_model_onto_its_mask(chair, tmp_path):
    mask, K, pose = _drawn(chair, 70, 25)
    file = tmp_path / "pix3d.json"
    other = {**_record(K, pose), "img": "img/bed/0007.png", "mask": "mask/bed/0007.png", "focal_length": 99.0}
    file.write_text(json.dumps([other, _record(K, pose)]))
    camera = pix3d_camera.read_camera(file, "somewhere/chair/0007.png", SIZE)
    assert pytest.approx(K) == camera.K
    # A model as Pix3D keeps it: y up, facing -z, 0.8 tall; its own rot_mat and trans_mat, x left and y up.
    record = _record(K, pose)
    vertices = 0.8 * chair.build(CHAIR).vertices()[:, (0, 2, 1)] * (-1, 1, 1)
    x, y, z = (vertices @ np.array(record["rot_mat"]).T + record["trans_mat"]).T
    focal = record["focal_length"] * SIZE[0] / 32
    column, row = 160 - focal * x / z, 120 - focal * y / z
    near = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3)))
    assert near[np.floor(row).astype(int), np.floor(column).astype(int)].all()
    ours = 0.8 * chair.build(CHAIR).vertices() @ camera.cam_from_model[:3, :3].T + camera.cam_from_model[:3, 3]
    pixels = ours @ camera.K.T
    assert pixels[:, :2] / pixels[:, 2:] == pytest.approx(np.stack([column, row], 1))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mask": "mask/chair/0001.png", "img": "img/chair/0001.jpg"}, "no record"),
        ({"rot_mat": [[1, 2], [3, 4]]}, "not complete"),
        ({"rot_mat": np.diag([2.0, 1, 1]).tolist()}, "not a rotation"),
        ({"trans_mat": [0, 0, -1]}, "behind the camera"),
    ],
)
def test_a_bad_record_is_named(change, words, tmp_path):
    record = _record(np.diag([300.0, 300, 1]), np.eye(4)) | {"trans_mat": [0, 0, 2]}
    (tmp_path / "pix3d.json").write_text(json.dumps([record | change]))
    with pytest.raises(InputError, match=words):
        pix3d_camera.read_camera(tmp_path / "pix3d.json", "0007.png", SIZE)


def _photo(path, size=SIZE, boxes=((100, 60, 80, 120),)):
    """Red blocks on a noisy green ground."""
    rng = np.random.default_rng(0)
    picture = np.full((size[1], size[0], 3), (60, 140, 70)) + rng.integers(-12, 12, (size[1], size[0], 3))
    for x, y, w, h in boxes:
        picture[y : y + h, x : x + w] = (190, 50, 40)
    Image.fromarray(picture.astype(np.uint8)).save(path)
    return path


def test_a_box_is_cut_out(tmp_path):
    photo = _photo(tmp_path / "a.png")
    masked = single_mask.run(photo, tmp_path / "work", box=(90, 50, 100, 140))
    true = np.zeros(SIZE[::-1], bool)
    true[60:180, 100:180] = True
    assert iou(masked.mask, true) > 0.95
    assert masked.source == "grabcut"
    assert not masked.warnings


def test_two_objects_in_the_box_are_told(tmp_path):
    photo = _photo(tmp_path / "a.png", boxes=((60, 60, 60, 100), (180, 60, 80, 120)))
    masked = single_mask.run(photo, tmp_path / "work", box=(50, 50, 220, 140))
    assert "2 large separate parts" in masked.warnings[0]
    assert masked.mask[100, 200]
    assert not masked.mask[100, 80]


@pytest.mark.parametrize(
    ("box", "words"),
    [
        (None, "nothing says where the object is"),
        ((300, 10, 100, 50), "outside the image, which is 320 x 240"),
        ((10, 10, 5, 5), "too small"),
        ((0, 0, 320, 240), "whole image"),
    ],
)
def test_a_box_that_cannot_be_used_is_named(box, words, tmp_path):
    with pytest.raises(InputError, match=words):
        single_mask.run(_photo(tmp_path / "a.png"), tmp_path / "work", box=box)


def test_masks_that_cannot_be_used_are_named(tmp_path):
    photo = _photo(tmp_path / "a.png")
    frame = np.ones(SIZE[::-1], bool)
    frame[60:180:40, 100:180:30] = False  # specks: no inverted object either
    dot = np.zeros(SIZE[::-1], bool)
    dot[5:8, 5:8] = True
    cases = {
        "all black": np.zeros(SIZE[::-1], bool),
        "border all round": frame,
        "tiny": dot,
        "not the shape": np.eye(64, dtype=bool),
    }
    for words, mask in cases.items():
        with pytest.raises(InputError, match=words):
            single_mask.run(photo, tmp_path / "work", mask_file=_saved(mask, tmp_path / "mask.png"))
    with pytest.raises(InputError, match="does not exist"):
        single_mask.run(photo, tmp_path / "work", mask_file=tmp_path / "none.png")
    (tmp_path / "b.png").write_bytes(b"no image")
    with pytest.raises(InputError):
        single_mask.run(tmp_path / "b.png", tmp_path / "work")


def test_an_inverted_mask_is_turned_round_and_that_is_said(tmp_path):
    """White background, black object: alone, beside a photo, and with a part that is hidden (middle grey)."""
    true = np.zeros(SIZE[::-1], bool)
    true[60:180, 100:180] = True
    file = _saved(~true, tmp_path / "mask.png")
    for masked in (
        single_mask.run(_photo(tmp_path / "a.png"), tmp_path / "work", mask_file=file),
        single_mask.run(file, tmp_path / "work"),
    ):
        assert (masked.mask == true).all()
        assert "inverted" in masked.warnings[0]
    grey = np.where(true, 0, 255).astype(np.uint8)
    grey[60:100, 100:180] = 128
    Image.fromarray(grey).save(file)
    masked = single_mask.run(file, tmp_path / "work")
    hidden = np.zeros_like(true)
    hidden[60:100, 100:180] = True
    assert (masked.mask == (true & ~hidden)).all()


def test_a_box_that_the_object_runs_into_or_fills(tmp_path):
    photo = _photo(tmp_path / "a.png", boxes=((100, 60, 80, 120),))
    masked = single_mask.run(photo, tmp_path / "work", box=(90, 50, 60, 140))
    assert "seems to cut the object of a.png (right)" in masked.warnings[0]
    with pytest.raises(InputError, match=r"fills the box|no object could be told"):
        single_mask.run(photo, tmp_path / "work", box=(105, 65, 70, 110))


def test_a_box_far_larger_than_what_is_found_is_told(tmp_path):
    photo = _photo(tmp_path / "a.png", boxes=((100, 60, 80, 120),))
    masked = single_mask.run(photo, tmp_path / "work", box=(5, 40, 310, 160))
    assert "takes up 26% of it" in masked.warnings[0]
    assert "--mask" in masked.warnings[0]


def test_specks_of_a_drawn_mask_are_no_object():
    mask = np.zeros((200, 300), bool)
    mask[60:160, 100:180] = True
    specks = mask.copy()
    specks[3:7, 280:284] = specks[190:193, 5:9] = True
    assert (single_mask.checked(specks, "a.png")[0] == mask).all()
    leg = mask.copy()
    leg[165:190, 110:114] = True  # seen below something that hides the rest
    assert (single_mask.checked(leg, "a.png")[0] == leg).all()


def test_a_box_is_four_numbers():
    assert single_mask.parse_box("1, 2,3,4.5") == (1, 2, 3, 4.5)
    for text in ("1,2,3", "a,b,c,d", "0,0,-5,5", "0,0,nan,5"):
        with pytest.raises(InputError, match="x,y,w,h"):
            single_mask.parse_box(text)


def test_a_mask_alone_ends_in_all_outputs(chair, bank, tmp_path, monkeypatch):
    monkeypatch.setattr(single_view, "load_bank", lambda *_: bank)
    mask, K, pose = _drawn(chair, 30, 20)
    path = _saved(mask, tmp_path / "0007.png")
    (tmp_path / "pix3d.json").write_text(json.dumps([_record(K, pose)]))
    written = OutputsOptions(blender=False, renders=1, render_size=64)
    options = ImageOptions("paper/chair", pix3d=tmp_path / "pix3d.json", height=0.9, search=SMALL, outputs=written)
    paths = image.run(path, tmp_path / "out", options)
    report = json.loads(paths.report_json.read_text())
    assert report["mean_iou"] > 0.95
    assert report["params"]["arms"] == "solid"
    assert "camera given" in report["explanation"]
    assert report["registered"]["how"] == "one mask, camera given"
    assert trimesh.load(paths.glb, force="mesh").extents[1] == pytest.approx(0.9)
    assert not (tmp_path / "out" / "mesh.mtl").exists(), "a mask has no colours"
    content = json.loads((paths.cameras / "transforms.json").read_text())
    assert content["fl_x"] == pytest.approx(K[0, 0])


def test_nothing_is_written_for_bad_input(tmp_path):
    with pytest.raises(InputError, match="nothing says where"):
        image.run(_photo(tmp_path / "a.png"), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="no model"):
        image.run(tmp_path / "a.png", tmp_path / "out", ImageOptions(class_name="lamp"))


def test_masks_of_unknown_views_share_one_shape(chair):
    K, poses = (t.numpy() for t in look_at_cameras([40, 150], [22, 15], 2.3, 40, 240))
    K[:, 0, 2] = 160
    masks = silhouettes(chair.build(CHAIR), K, poses, np.array([SIZE, SIZE]))
    views = [OneView(mask, k, True) for mask, k in zip(masks, K, strict=True)]
    few = CameraSearchOptions(
        bank=BankOptions(elevations=(16.0,)), placed=8, starts=4, coarse=Schedule(steps=(3, 2, 3), levels=(0, 1))
    )
    found = find_all(chair, views, {**CHAIR, "width": 0.7, "back": "vbar"}, few)
    seen = [seen_from(p[:3, :3], p[:3, 3])[0] for p in found.cam_from_canonical]
    assert seen == pytest.approx([40, 150], abs=5)
    assert found.params["back"] == "hbar"
    assert found.mean_iou > 0.93
    np.testing.assert_array_equal(found.K, K)
