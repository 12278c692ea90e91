"""A printed sheet through the whole pipeline: a few of the shipped photos, with a sheet laid on their floor."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh

from datasets.photosets import read_photoset
from recon.cameras.sfm_options import PosesOptions
from recon.fitting import refine, view_starts
from recon.outputs import camera_export, write
from recon.pipelines import photos as pipeline
from recon.scene import Cameras
from recon.sheet.layout import PAPERS
from tests.made_up_sheets import lay, lying
from tests.pipelines.test_photos import SHIPPED

UNIT = 3.3  # of the given cameras' world a metre
VIEWS = range(0, 28, 3)
PLACE = lying(0.55, 0.35, 25)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """Photos with an A3 sheet behind the chair's own outline, their masks, and a transforms.json in another unit."""
    folder, truth = tmp_path_factory.mktemp("sheet"), read_photoset(SHIPPED)
    for name in ("photos", "masks"):
        (folder / name).mkdir()
    paper = PAPERS["A3"]
    for v in VIEWS:
        photo, mask = cv2.imread(str(truth.photos[v])), cv2.imread(str(truth.masks[v]), cv2.IMREAD_GRAYSCALE)
        camera = truth.K[v], truth.cam_from_world[v]
        laid = [lay(channel, *camera, PLACE, paper.board(1), whole=paper) for channel in cv2.split(photo)]
        photo = np.where(mask[..., None] > 127, photo, cv2.merge(laid))
        cv2.imwrite(str(folder / "photos" / truth.names[v]), photo, [cv2.IMWRITE_JPEG_QUALITY, 95])
        cv2.imwrite(str(folder / "masks" / f"{truth.names[v]}.png"), mask)
    poses = truth.cam_from_world[VIEWS].copy()
    poses[:, :3, 3] *= UNIT
    names = tuple(truth.names[v] for v in VIEWS)
    cameras = Cameras(names, truth.K[VIEWS], poses, truth.sizes[VIEWS])
    content = camera_export.transforms(cameras, [f"photos/{n}" for n in names], [""] * len(names))
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder, truth


def run(folder, out, **options):
    little = pipeline.ReconOptions(
        class_name="paper/chair",
        masks=folder / "masks",
        cameras=folder / "transforms.json",
        poses=PosesOptions(attempts=1),
        fit=view_starts.FitOptions(size=32, max_views=4, random=8, kept=1),
        refine=refine.RefineOptions(size=48, max_views=4, candidates=1),
        outputs=write.OutputsOptions(blender=False, renders=1, render_size=64),
    )
    paths = pipeline.run(folder / "photos", out, replace(little, **options))
    return json.loads(paths.report_json.read_text()), json.loads(paths.params_json.read_text())


@pytest.mark.slow
def test_size_and_floor_come_from_the_sheet(case, tmp_path):
    folder, truth = case
    report, params = run(folder, tmp_path / "out")
    size = report["size"]
    assert size["from"] == "printed sheet"
    (sheet,) = size["sheets"]
    assert "A3" in sheet["name"]
    assert len(sheet["views"]) >= 5
    assert sheet["metres_per_sfm_unit"] * UNIT == pytest.approx(1, rel=5e-3)
    up = np.array(params["world_from_canonical"])[:3, 2]
    assert np.degrees(np.arccos(up[2] / np.linalg.norm(up))) < 0.5
    high = np.ptp(trimesh.load_mesh(truth.mesh).bounds[:, 2]) * np.linalg.norm(truth.world_from_canonical[:3, 0])
    assert params["height_metres"] == pytest.approx(high, rel=0.05)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "by the printed sheet" in page

    # The same run again with what the user says: finished stages stay, the word about the sheet comes.
    report, params = run(folder, tmp_path / "out", height=0.5)
    assert params["height_metres"] == 0.5
    assert report["size"]["from"] == "--height"
    assert any("--height says 0.500 m and the printed sheet" in w for w in report["warnings"])
