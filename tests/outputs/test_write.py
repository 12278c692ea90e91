"""What a run leaves behind: everything promised, in the frames promised, whole or not at all."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

import procmodels
from procmodels.look import Look
from procmodels.space import Choice
from recon.outputs import camera_export, colmap_export, contact_sheet, report, write
from recon.outputs.previews import ShadeOptions, render_previews
from recon.outputs.result import seen
from recon.outputs.write import OutputsOptions
from recon.scene import Canonical, InputError, Observations, Scene, cam_from_canonical
from tests.made_up import CHAIR, made_up, without_views
from tests.results import assert_opens

SMALL = OutputsOptions(blender=False, render_size=64, thumbnail=100)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return made_up(tmp_path_factory.mktemp("photos"))


@pytest.fixture(scope="module")
def model():
    return procmodels.load("paper/chair")


@pytest.fixture(scope="module")
def written(result, model, tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "new" / "out"
    return write.run(result, out, replace(SMALL, blender=True), model)


def _pixels(points: np.ndarray, cam: np.ndarray, K: np.ndarray) -> np.ndarray:
    projected = (points @ cam[:3, :3].T + cam[:3, 3]) @ K.T
    return projected[:, :2] / projected[:, 2:]


@pytest.fixture(scope="module")
def corners(model):
    return model.build(CHAIR).vertices()


def test_everything_is_there_and_nothing_else(written):
    names = {p.name for p in written.folder.iterdir()}
    assert names == {
        "mesh.glb",
        "mesh.obj",
        "mesh.stl",
        "mesh.usdz",
        "model.blend",
        "params.json",
        "report.json",
        "report.html",
        "contact_sheet.png",
        "cameras",
        "masks",
        ".recon",
    }
    assert [p.name for p in (written.folder / ".recon").iterdir()] == ["manifest.json"]
    for path in (
        written.glb,
        written.obj,
        written.stl,
        written.usd,
        written.blend,
        written.report_html,
        written.contact_sheet,
    ):
        assert_opens(path)


def test_colours_reach_the_files_and_the_pictures(result, model, tmp_path):
    shape = model.build(CHAIR)
    red = Look(np.tile((0.6, 0.02, 0.02), (len(shape.parts), 1)))
    out = write.run(replace(result, look=red), tmp_path / "out", SMALL, model)
    colours = json.loads(out.params_json.read_text())["colours"]
    assert colours == dict.fromkeys((p.name for p in shape.parts), "#cb2727")
    assert out.obj.with_suffix(".mtl").is_file()
    assert "mesh.mtl" in out.report_html.read_text()
    (seen,) = render_previews(shape, 1, (64, 64), look=red)
    solid = seen[np.ptp(seen.astype(int), axis=2) > 40]
    assert len(solid) > 100, "the floor is grey, the object is not"
    assert (solid[:, 0] > 2 * solid[:, 1]).mean() > 0.8, "all but the border"


def test_report_json(written):
    content = json.loads(written.report_json.read_text())
    assert content["class"] == "chair"
    assert content["params"] == CHAIR
    assert [v["used"] for v in content["views"]] == [True, True, False]
    assert content["mean_iou"] == pytest.approx(np.mean([v["iou"] for v in content["views"][:2]]), abs=1e-4)
    assert content["registered"]["n"] == 3
    assert content["registered"]["of"] == 4
    assert content["registered"]["missing"] == ["b.JPG"]
    assert content["registered"]["how"] == "3 of 4 photos registered"
    assert content["seconds"]["total"] >= 21.5
    assert content["seed"] == 3
    assert content["versions"] == {"python": "3.11"}


def test_a_view_whose_camera_stands_elsewhere_is_not_counted(result):
    masks = replace(result.scene.silhouettes, misplaced=(result.scene.silhouettes.names[0],))
    other = replace(result, scene=replace(result.scene, silhouettes=masks))
    assert seen(other) == "2 of 4 photos registered"


def test_params_json_leads_from_canonical_to_metres_and_back(written, result, corners):
    content = json.loads(written.params_json.read_text())
    assert content["values"] == CHAIR
    assert content["parameters"]["width"] | {"value": 0.5, "low": 0.3, "high": 1.0} == content["parameters"]["width"]
    assert content["parameters"]["width"]["metres"] == pytest.approx(0.45)
    assert content["parameters"]["legs"]["options"] == ["basic", "round", "support", "office"]
    assert content["size_metres"][2] == pytest.approx(0.9)
    to_mesh = np.array(content["mesh_from_canonical"])
    mesh = trimesh.load_mesh(written.obj)
    moved = corners @ to_mesh[:3, :3].T + to_mesh[:3, 3]
    assert content["obj_up"] == "y"
    moved = moved[:, [0, 2, 1]] * (1, 1, -1)
    assert mesh.bounds == pytest.approx(np.stack([moved.min(0), moved.max(0)]), abs=1e-5)
    # SfM units to metres: the world mesh, scaled, is as large as the real one.
    world = trimesh.load_mesh(written.cameras / "mesh.obj")
    assert world.volume * content["metres_per_sfm_unit"] ** 3 == pytest.approx(mesh.volume, rel=1e-3)
    assert Canonical(np.array(content["world_from_canonical"])).scale == pytest.approx(result.scene.canonical.scale)


def test_metres_follow_the_height_of_a_wide_object(result, model, tmp_path):
    """A chair's longest side is its height; with arms far apart and another scale the rule must still be z."""
    asset = write.asset_of(replace(result, height_m=1.8), model)
    extent = np.ptp(asset.shape.bounds(), axis=0)
    assert extent[2] * asset.metres_per_unit == pytest.approx(1.8)


def test_colmap_text_projects_to_the_same_pixels(written, result, corners):
    import pycolmap

    model = pycolmap.Reconstruction(str(written.cameras / "sparse" / "0"))
    assert len(model.images) == 3
    assert len(model.points3D) == 20
    expected = cam_from_canonical(result.scene.cameras, result.scene.canonical)
    world = result.scene.canonical.world_from_canonical
    points = corners @ world[:3, :3].T + world[:3, 3]
    for i, image in enumerate(sorted(model.images.values(), key=lambda im: im.image_id)):
        pose = np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]])
        camera = model.cameras[image.camera_id]
        assert camera.model.name == "PINHOLE"
        K = camera.calibration_matrix()
        assert _pixels(points, pose, K) == pytest.approx(
            _pixels(corners, expected[i], result.scene.cameras.K[i]), abs=1e-5
        )
        assert cv2.imread(str(written.cameras / "images" / image.name)).shape[1::-1] == (camera.width, camera.height)


def test_colmap_tracks_lead_to_the_points_that_they_are_of(written, result):
    """Each 2D point of an image names a 3D point whose track names it back, and lies where that one is seen."""
    import pycolmap

    model = pycolmap.Reconstruction(str(written.cameras / "sparse" / "0"))
    tracks = result.scene.poses.tracks
    counted = 0
    for image in model.images.values():
        for k, measured in enumerate(image.points2D):
            point = model.points3D[measured.point3D_id]
            assert (image.image_id, k) in {(e.image_id, e.point2D_idx) for e in point.track.elements}
            assert image.project_point(point.xyz) == pytest.approx(measured.xy, abs=1e-3)
            assert tracks[measured.point3D_id - 1, image.image_id - 1]
            counted += 1
    assert counted == model.compute_num_observations() > 20


def test_measured_pixels_are_written_where_they_are_known(result, tmp_path):
    poses = result.scene.poses
    seen = colmap_export.observations(poses)
    moved = replace(poses, observations=Observations(seen.view, seen.point, seen.pixels + np.array([0.3, 0.4])))
    colmap_export.write(tmp_path / "model", moved, ["a.png", "b.png", "c.png"])
    lines = (tmp_path / "model" / "points3D.txt").read_text().splitlines()[1:]
    errors = [float(line.split()[7]) for line in lines if len(line.split()) > 8]
    assert errors == pytest.approx([0.5] * len(errors), abs=1e-3)


def test_sparse_points_as_trainers_read_them(written, result):
    content = json.loads((written.cameras / "transforms.json").read_text())
    cloud = trimesh.load(written.cameras / content["ply_file_path"])
    assert cloud.vertices == pytest.approx(result.scene.poses.points, rel=1e-6)
    assert cloud.colors.shape == (20, 4)
    head = (written.cameras / content["ply_file_path"]).read_bytes().split(b"end_header")[0]
    for name in (b"nx", b"nz", b"red", b"blue"):
        assert b" " + name + b"\n" in head


def test_transforms_json_projects_to_the_same_pixels(written, result, corners):
    content = json.loads((written.cameras / "transforms.json").read_text())
    expected = cam_from_canonical(result.scene.cameras, result.scene.canonical)
    world = result.scene.canonical.world_from_canonical
    points = corners @ world[:3, :3].T + world[:3, 3]
    for i, frame in enumerate(content["frames"]):
        seen = (points - np.array(frame["transform_matrix"])[:3, 3]) @ np.array(frame["transform_matrix"])[:3, :3]
        # OpenGL axes: the camera looks along -z, y is up.
        x = frame["fl_x"] * seen[:, 0] / -seen[:, 2] + frame["cx"]
        y = frame["fl_y"] * -seen[:, 1] / -seen[:, 2] + frame["cy"]
        assert np.stack([x, y], 1) == pytest.approx(_pixels(corners, expected[i], result.scene.cameras.K[i]), abs=1e-5)
        assert (written.cameras / frame["file_path"]).is_file()
        mask = cv2.imread(str(written.cameras / frame["mask_path"]), cv2.IMREAD_GRAYSCALE)
        np.testing.assert_array_equal(mask == 255, result.scene.silhouettes.masks[i])
        assert set(np.unique(mask)) == {0, 255}


def test_transforms_share_intrinsics_that_are_equal(result):
    cameras = result.scene.cameras.subset([0, 0])
    content = camera_export.transforms(cameras, ["a", "b"], ["c", "d"])
    assert content["fl_x"] == cameras.K[0, 0, 0]
    assert "fl_x" not in content["frames"][0]


def test_file_stems_stay_different():
    assert camera_export.stems(("a.jpg", "b.jpg")) == ["a", "b"]
    assert camera_export.stems(("a.jpg", "a.png", "x y.jpg")) == ["a.jpg", "a.png", "x_y"]


class _Page(HTMLParser):
    """Collects tags, links and text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href", "srcset", "data") and value]

    def handle_data(self, data):
        self.words += data


def test_report_html_stands_alone_and_escapes_names(written):
    text = written.report_html.read_text()
    page = _Page(text)
    assert not {"script", "link", "iframe", "i><"} & set(page.tags)
    assert "<i>&" not in text
    assert "c <i>&.png" in page.words
    assert "look out for <script>" in page.words
    assert "x<y.mov" in page.words
    for link in page.links:
        assert link.startswith("data:image/") or (written.folder / link).exists(), link[:80]
    assert not re.search(r"https?://|@import|url\(", text)


def test_report_html_says_what_matters(written):
    words = _Page(written.report_html.read_text()).words
    assert "A chair with basic legs, basic arms and vbar back" in words
    assert "0.90 m high" in words
    assert "2 of 4 photos used" in words
    assert "b.JPG" in words
    assert "it disagrees" in words
    assert words.index("c <i>&.png") < words.rindex("d.jpg"), "views that are not used come last"


def test_report_says_which_blender_wrote_the_file(result, model, tmp_path):
    told = replace(result, versions={"python": "3.11", "bpy": "5.0.1"})
    paths = write.run(told, tmp_path / "out", replace(SMALL, blender=True), model)
    words = _Page(paths.report_html.read_text()).words
    assert "Blender 5.0.1" in words
    assert "4.2 LTS takes mesh.usdz or mesh.glb" in words


def test_words_without_a_real_size_or_views(result, model, tmp_path):
    empty = without_views(result)
    text = report.words(empty, write.asset_of(empty, model))
    assert "times as wide" in text.sentence
    assert "agreement" not in text.sentence
    paths = write.run(empty, tmp_path / "out", SMALL, model)
    assert not paths.cameras.exists()
    assert json.loads(paths.report_json.read_text())["mean_iou"] is None


def test_contact_sheet_shows_every_photo_and_both_outlines(result, model):
    tiles = contact_sheet.tiles(result, model.build(CHAIR), 200)
    assert [t.name for t in tiles] == list(result.frames.names)
    assert [t.used for t in tiles] == [True, False, True, False]
    assert [t.iou is None for t in tiles] == [False, True, False, False]
    for tile in tiles:
        assert tile.image.shape[1] == 200
        assert tile.image.dtype == np.uint8
        near = [
            (np.abs(tile.image.astype(int) - colour).sum(2) < 60).sum()
            for colour in (contact_sheet.MASK_COLOUR, contact_sheet.RESULT_COLOUR)
        ]
        assert all(n > 20 for n in near) == (tile.iou is not None)
    sheet = contact_sheet.draw(tiles * 3, [np.zeros((50, 50, 3), np.uint8)] * 3, "A title", "Words. " * 60)
    assert sheet.ndim == 3
    assert sheet.shape[1] > 1000


def test_previews_show_the_object_on_a_light_floor(model):
    pictures = render_previews(model.build(CHAIR), 2, (80, 60), ShadeOptions(supersample=1))
    assert [p.shape for p in pictures] == [(60, 80, 3)] * 2
    for picture in pictures:
        assert picture[0, 0].min() > 230
        wood = (picture[..., 0].astype(int) - picture[..., 2]) > 40
        assert 0.05 < wood.mean() < 0.6
        rows = np.flatnonzero(wood.any(1))
        assert rows[0] >= 3, "it does not touch the border"
        assert rows[-1] <= 56


def test_a_failure_leaves_the_earlier_results(result, model, tmp_path, monkeypatch):
    out = tmp_path / "out"
    write.run(result, out, SMALL, model)
    (out / "mine.txt").write_text("the user's own file")
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(report, "page", stop)
    with pytest.raises(KeyboardInterrupt):
        write.run(replace(result, class_name="sofa"), out, SMALL, model)
    assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before


def test_a_second_run_replaces_all_of_the_first(result, model, tmp_path):
    out = tmp_path / "out"
    write.run(result, out, replace(SMALL, blender=True), model)
    (out / "masks" / "old.png").write_bytes(b"")
    paths = write.run(replace(result, height_m=None), out, SMALL, model)
    assert paths.blend is None
    assert not (out / "model.blend").exists(), "it would be taken for this run's"
    assert (out / "masks" / "old.png").exists(), "nobody here wrote it"
    assert [p.name for p in (out / ".recon").iterdir()] == ["manifest.json"], "nothing half-written"
    assert json.loads(paths.params_json.read_text())["metres_per_canonical_unit"] is None


def test_a_folder_that_cannot_be_written(result, model, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=re.escape(str(tmp_path / "file" / "out"))) as caught:
        write.run(result, tmp_path / "file" / "out", SMALL, model)
    assert caught.value.exit_code == 2


def test_a_photo_that_vanished(result, model, tmp_path):
    gone = replace(result, frames=replace(result.frames, paths=(Path("gone.png"),) * 4))
    with pytest.raises(InputError, match=re.escape("gone.png")):
        write.run(gone, tmp_path / "out", SMALL, model)


def test_views_and_their_cameras_in_words(result, model):
    """What is said is true of what was given: photos that were placed, one image, masks, a splat."""
    assert seen(result) == "3 of 4 photos registered"
    assert seen(replace(result, placed="given")) == "3 of 4 photos, cameras given"
    one = only_the_first(result)
    assert seen(one) == "one image, camera estimated"
    assert "One image, camera estimated; outline agreement" in report.words(one, write.asset_of(one, model)).sentence
    assert report.words(one, write.asset_of(one, model)).title == "Chair from one image"
    assert seen(replace(one, views="masks", placed="given")) == "one mask, camera given"


def only_the_first(result):
    """The result as if its first photo had been the only one."""
    frames, poses, masks = result.frames, result.scene.poses, result.scene.silhouettes
    return replace(
        result,
        frames=replace(
            frames,
            names=frames.names[:1],
            paths=frames.paths[:1],
            sizes=frames.sizes[:1],
            focal_px=frames.focal_px[:1],
            sharpness=frames.sharpness[:1],
            alpha=frames.alpha[:1],
            original=None,
        ),
        scene=Scene(
            replace(
                poses,
                cameras=poses.cameras.subset([0]),
                paths=poses.paths[:1],
                tracks=poses.tracks[:, :1],
                unregistered=(),
            ),
            replace(
                masks,
                names=masks.names[:1],
                masks=masks.masks[:1],
                source=masks.source[:1],
                used=masks.used[:1],
                reasons=(),
            ),
            result.scene.canonical,
        ),
        view_iou=result.view_iou[:1],
        views="images",
        placed="estimated",
    )


def test_a_choice_is_said_in_the_models_own_words():
    space = procmodels.load("chair").space
    said = {p.name: p.said for p in space.discrete if isinstance(p, Choice)}
    assert all(len(said[name]) == len(space.by_name[name].options) for name in ("base", "stretchers", "back", "arms"))
    assert report._trait(space.by_name["base"], "star") == "a star base"
    assert report._trait(Choice("legs", ("round", "none")), "round") == "round legs"
