"""Camera files of other programs: a set of known cameras written by each one's conventions is read back exactly."""

import csv
import json
import re

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from recon.cameras import known_cameras
from recon.files import recognise
from recon.files.image_library import Library
from recon.scene import InputError

SIZE = (160, 120)
COUNT = 4
FLIP = np.diag([1.0, -1, -1, 1])


@pytest.fixture
def truth(rng, tmp_path):
    """COUNT cam_from_world (4, 4), with a photo of each in tmp_path/images."""
    (tmp_path / "images").mkdir()
    out = np.tile(np.eye(4), (COUNT, 1, 1))
    out[:, :3, :3] = Rotation.random(COUNT, random_state=1).as_matrix()
    out[:, :3, 3] = rng.normal(size=(COUNT, 3))
    for i in range(COUNT):
        pixels = rng.integers(0, 255, (SIZE[1], SIZE[0], 3)).astype(np.uint8)
        Image.fromarray(pixels).save(tmp_path / "images" / f"p{i}.jpg")
    return out


def splat(folder, truth):
    world = np.linalg.inv(truth)
    entries = [
        {"id": i, "img_name": f"p{i}", "width": 160, "height": 120, "fx": 150.5, "fy": 151.5}
        | {"position": w[:3, 3].tolist(), "rotation": w[:3, :3].tolist()}
        for i, w in enumerate(world)
    ]
    (folder / "cameras.json").write_text(json.dumps(entries), encoding="utf-8-sig")
    return np.array([[150.5, 0, 80], [0, 151.5, 60], [0, 0, 1]])


def polycam(folder, truth, kind="corrected_"):
    keyframes = folder / "keyframes"
    (keyframes / f"{kind}cameras").mkdir(parents=True)
    (folder / "images").rename(keyframes / f"{kind}images")
    for i, w in enumerate(np.linalg.inv(truth) @ FLIP):
        entry = {f"t_{r}{c}": w[r, c] for r in range(3) for c in range(4)}
        entry |= {"width": 160, "height": 120, "fx": 150.5, "fy": 151.5, "cx": 81.0, "cy": 59.0, "blur_score": 100.0}
        (keyframes / f"{kind}cameras" / f"p{i}.json").write_text(json.dumps(entry))
    return np.array([[150.5, 0, 81], [0, 151.5, 59], [0, 0, 1]])


def llff(folder, truth):
    rows = []
    for w in np.linalg.inv(truth):
        right, down, forward, centre = w[:3].T
        matrix = np.column_stack([down, right, -forward, centre, (120, 160, 150.5)])
        rows.append([*matrix.ravel(), 0.5, 9.0])
    np.save(folder / "poses_bounds.npy", np.array(rows))
    return np.array([[150.5, 0, 80], [0, 150.5, 60], [0, 0, 1]])


METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true"><sensors next_id="1">
<sensor id="0" label="unknown" type="frame"><resolution width="160" height="120"/>
<calibration type="frame" class="initial"><resolution width="160" height="120"/><f>99</f></calibration>
<calibration type="{kind}" class="adjusted"><resolution width="160" height="120"/>
<f>150.5</f><cx>1.25</cx><cy>-0.5</cy><b1>0.5</b1>{terms}</calibration></sensor></sensors>
<components next_id="1"><component id="0"/></components>
<cameras next_id="9">{cameras}<camera id="8" sensor_id="0" label="unplaced"/></cameras></chunk></document>"""


def metashape(folder, truth, terms="<k1>-0.05</k1><k2>0.01</k2><p1>0.001</p1><p2>-0.002</p2>", kind="frame"):
    cameras = "".join(
        f'<camera id="{i}" sensor_id="0" component_id="0" label="p{i}"><transform>'
        f"{' '.join(map(repr, w.ravel().tolist()))}</transform></camera>"
        for i, w in enumerate(np.linalg.inv(truth))
    )
    (folder / "cameras.xml").write_text(METASHAPE.format(kind=kind, terms=terms, cameras=cameras))
    return np.array([[151.0, 0, 81.25], [0, 150.5, 59.5], [0, 0, 1]])


COLUMNS = [
    "#name",
    *("x", "y", "alt", "heading", "pitch", "roll", "f", "px", "py"),
    *("k1", "k2", "k3", "k4", "t1", "t2"),
]


def realitycapture(folder, truth):
    with (folder / "align.csv").open("w", newline="", encoding="utf-8-sig") as file:
        writer = csv.writer(file)
        writer.writerow(
            [
                *[
                    "#name",
                    "x",
                    "y",
                    "alt",
                    "heading",
                    "pitch",
                    "roll",
                    "f",
                    "px",
                    "py",
                    "k1",
                    "k2",
                    "k3",
                    "k4",
                    "t1",
                    "t2",
                ]
            ]
        )
        for i, w in enumerate(np.linalg.inv(truth) @ FLIP):
            # Turned by the heading about z, then pitched about x, then rolled about y.
            z, x, y = Rotation.from_matrix(w[:3, :3]).as_euler("ZXY", degrees=True)
            writer.writerow([f"p{i}.jpg", *w[:3, 3], -z, x, y, 36 * 150.5 / 160, 0.225, -0.45, *[0] * 6])
    return np.array([[150.5, 0, 81], [0, 150.5, 58], [0, 0, 1]])


def test_a_camera_that_looks_straight_down_with_north_at_the_top(tmp_path, truth):
    """RealityCapture's angles are 0 there; with heading 90 east is at the top."""
    head = "#name,x,y,alt,heading,pitch,roll,f\n"
    (tmp_path / "a.csv").write_text(head + "p0.jpg,1,2,5,0,0,0,36\np1.jpg,1,2,5,90,0,0,36\np2.jpg,0,-5,1,0,90,0,36\n")
    records = read(tmp_path)
    north, east = np.array([1, 3, 0, 1.0]), np.array([2, 2, 0, 1.0])
    np.testing.assert_allclose(records.cam_from_world[0] @ north, [0, -1, 5, 1], atol=1e-12)
    np.testing.assert_allclose(records.cam_from_world[1] @ east, [0, -1, 5, 1], atol=1e-12)
    np.testing.assert_allclose(records.cam_from_world[2] @ [0, 0, 2, 1], [0, -1, 5, 1], atol=1e-12)  # level, to north


def read(folder):
    source = known_cameras.required(folder)
    return known_cameras.read(source, Library(folder, source))


WRITERS = (splat, polycam, llff, metashape, realitycapture)


@pytest.mark.parametrize("write", WRITERS)
def test_cameras_are_read_as_written(tmp_path, truth, write):
    K = write(tmp_path, truth)
    assert recognise.recognise(tmp_path).kind == recognise.Kind.CAMERAS
    given = known_cameras.gather(tmp_path, tmp_path, tmp_path / "work")
    assert [n.split(".")[0] for n in given.names] == [f"p{i}" for i in range(COUNT)]
    np.testing.assert_allclose(given.records.cam_from_world, truth, atol=1e-12)
    np.testing.assert_allclose(given.records.K, np.tile(K, (COUNT, 1, 1)), atol=1e-9)
    assert (given.records.sizes == SIZE).all()
    assert not given.warnings


@pytest.mark.parametrize("write", [splat, llff, metashape, realitycapture])
def test_the_file_alone_is_known_by_its_content(tmp_path, truth, write):
    write(tmp_path, truth)
    file = next(p for p in tmp_path.iterdir() if p.is_file())
    other = file.with_name(f"export{file.suffix}")
    file.rename(other)
    assert recognise.recognise(other).kind == recognise.Kind.CAMERAS
    assert known_cameras.find(other) == other


@pytest.mark.parametrize("write", WRITERS)
def test_a_cut_off_file_gives_one_line(tmp_path, truth, write):
    write(tmp_path, truth)
    source = known_cameras.required(tmp_path)
    file = known_cameras.camera_files(source)[0]
    whole, said = file.read_bytes(), []
    for length in range(0, len(whole), max(1, len(whole) // 23)):
        file.write_bytes(whole[:length])
        try:
            read(tmp_path)
        except InputError as error:
            said.append(str(error))
    assert len(said) > 5
    assert not any("\n" in message for message in said)


def test_metashapes_lens_bends_as_its_manual_says(tmp_path, truth):
    from recon.geometry.lenses import bent

    K = metashape(tmp_path, truth)
    (lens, *_), x, y = read(tmp_path).lenses, 0.3, -0.2
    r2 = x * x + y * y
    radial = 1 - 0.05 * r2 + 0.01 * r2**2
    u = x * radial + 0.001 * (r2 + 2 * x * x) + 2 * -0.002 * x * y
    v = y * radial - 0.002 * (r2 + 2 * y * y) + 2 * 0.001 * x * y
    np.testing.assert_allclose(bent(lens, np.array([[x, y, 1]]))[0], (K @ [u, v, 1])[:2], atol=1e-9)


def test_metashapes_other_lenses(tmp_path, truth):
    metashape(tmp_path, truth, "<k1>-0.05</k1><k2>0.01</k2><k3>0.002</k3>", "fisheye")
    assert read(tmp_path).lenses[0].model == "OPENCV_FISHEYE"
    metashape(tmp_path, truth, kind="spherical")
    with pytest.raises(InputError, match=r"camera p0: .*panorama"):
        read(tmp_path)
    metashape(tmp_path, truth, "<b2>30</b2>")
    with pytest.raises(InputError, match="undistorted"):
        read(tmp_path)
    file = tmp_path / "cameras.xml"
    file.write_text(re.sub(r"<document", '<!DOCTYPE d [<!ENTITY a "b">]><document', file.read_text()))
    assert known_cameras.find(tmp_path) is None, "a foreign file's entities could grow beyond all memory"


def test_llff_belongs_to_as_many_pictures(tmp_path, truth):
    llff(tmp_path, truth)
    (tmp_path / "images" / "p1.jpg").unlink()
    with pytest.raises(InputError, match=r"has 4 cameras.* there are 3 pictures"):
        read(tmp_path)


def test_raw_cameras_of_polycam_where_there_are_no_adjusted_ones(tmp_path, truth):
    polycam(tmp_path, truth, "")
    np.testing.assert_allclose(read(tmp_path).cam_from_world, truth, atol=1e-12)


def test_all_cameras_in_one_place(tmp_path, truth):
    """Turned only: said so, not a missing floor."""
    truth[:, :3, 3] = -np.einsum("vij,j->vi", truth[:, :3, :3], [3.0, 4, 5])
    splat(tmp_path, truth)
    with pytest.raises(InputError, match="all 4 cameras stand in one place"):
        known_cameras.gather(tmp_path, tmp_path, tmp_path / "work")


def transforms(folder, truth, names, **values):
    world = np.linalg.inv(truth) @ FLIP
    frames = [{"file_path": n, "transform_matrix": w.tolist()} for n, w in zip(names, world, strict=True)]
    folder.mkdir(exist_ok=True)
    content = {"fl_x": 150.5, "w": 160, "h": 120, "frames": frames, **values}
    (folder / "transforms.json").write_text(json.dumps(content), encoding="utf-8-sig")


def test_transforms_with_a_byte_order_mark(tmp_path, truth):
    transforms(tmp_path, truth, [f"images/p{i}.jpg" for i in range(COUNT)])
    assert recognise.recognise(tmp_path / "transforms.json").kind == recognise.Kind.CAMERAS
    np.testing.assert_allclose(read(tmp_path).cam_from_world, truth, atol=1e-12)


@pytest.mark.parametrize("absolute", [False, True])
def test_images_outside_the_folder_are_followed_only_when_allowed(tmp_path, truth, absolute):
    folder = tmp_path / "foreign"
    start = str(tmp_path / "images") if absolute else "../images"
    transforms(folder, truth, [f"{start}/p{i}.jpg" for i in range(COUNT)])
    with pytest.raises(InputError, match=rf"names {re.escape(start)}/p0\.jpg, which lies outside .*--allow-outside"):
        known_cameras.gather(folder, folder, tmp_path / "work")
    given = known_cameras.gather(folder, folder, tmp_path / "work", outside=True)
    assert len(given.names) == COUNT
    # INPUT holds them: no question of outside.
    assert len(known_cameras.gather(tmp_path / "images", folder, tmp_path / "work2").names) == COUNT


def test_masks_and_points_outside_the_folder(tmp_path, truth):
    names = [f"images/p{i}.jpg" for i in range(COUNT)]
    folder = tmp_path / "foreign"
    transforms(folder, truth, names, ply_file_path="../secret.ply")
    (tmp_path / "images").rename(folder / "images")
    (tmp_path / "secret.ply").write_text("no ply at all")
    content = json.loads((folder / "transforms.json").read_text(encoding="utf-8-sig"))
    assert len(known_cameras.read(folder / "transforms.json", Library(folder, folder / "transforms.json")).points) == 0
    for i, frame in enumerate(content["frames"]):
        frame["mask_path"] = f"/etc/p{i}.png"
    (folder / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"mask /etc/p0\.png lies outside"):
        known_cameras.gather(folder, folder, tmp_path / "work")


def test_one_photo_in_two_spellings_and_names_no_disk_can_hold(tmp_path, truth):
    transforms(tmp_path, truth, ["images/p0.jpg", "./images/../images/p0.jpg", "images/p1.jpg", "x" * 300 + ".jpg"])
    given = known_cameras.gather(tmp_path, tmp_path, tmp_path / "work")
    assert given.names == ("p0.jpg", "p1.jpg")
    np.testing.assert_allclose(given.records.cam_from_world[0], truth[0], atol=1e-12)
    assert any("another names, too" in w for w in given.warnings)
