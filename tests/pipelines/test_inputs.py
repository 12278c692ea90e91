"""Which flags each kind of input takes: one that it does not take is an error, never ignored."""

import zipfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.command import main, parser
from recon.files import mask_images
from recon.files.shape import Kind, Recognised
from recon.pipelines import photos
from recon.pipelines.inputs import RIVALS, WAYS, Asked, way_of
from recon.scene import InputError
from tests.files.test_recognise import FACES, TETRAHEDRON, obj

GIVEN = {
    "up": "z",
    "front": "-y",
    "masks": Path("masks"),
    "mask": Path("mask.png"),
    "box": "1,2,3,4",
    "pix3d": Path("pix3d.json"),
    "camera_off": 3.0,
    "cameras": Path("cameras"),
    "allow_outside": True,
    "turntable": True,
    "intrinsics": "1,1,1,1",
    "focal_mm": "28",
    "frames": 12,
    "ruler": 147.0,
}
KINDS = {
    "photos": Kind.PHOTOS,
    "photos in cameras": Kind.CAMERAS,
    "video": Kind.VIDEO,
    "image": Kind.IMAGE,
    "shape": Kind.MESH,
    "splat": Kind.SPLAT,
}


def test_every_flag_of_the_command_is_common_or_in_the_table():
    flags = {a.dest for a in parser()._actions}
    common = {
        "help",
        "photos",
        "input",
        "class_name",
        "out",
        "height",
        "obj_up",
        "plain",
        "seed",
        "force",
        "start",
        "verbose",
    }
    assert flags - common == set(GIVEN) == {f for way in WAYS.values() for f in way.flags}


@pytest.mark.parametrize(
    ("kind", "asked", "plain"),
    [(Kind.PHOTOS, False, False), (Kind.PHOTOS, True, True), (Kind.MASKS, False, True), (Kind.SPLAT, False, True)],
)
def test_what_is_drawn_in_one_colour_gives_no_colours(kind, asked, plain, monkeypatch):
    given = []
    monkeypatch.setattr(photos, "run", lambda source, out, options: given.append(options.look.plain))
    WAYS["photos"].run(Asked(Path("thing"), Path("out"), plain=asked), Recognised(kind, "what it looks like"))
    assert given == [plain]


@pytest.mark.parametrize("row", KINDS)
@pytest.mark.parametrize("flag", GIVEN)
def test_a_flag_is_taken_or_refused(row, flag):
    kind, asked = KINDS[row], replace(Asked(Path("thing"), Path("out")), **{flag: GIVEN[flag]})
    seen = Recognised(kind, "what it looks like")
    if flag in WAYS[row].flags:
        assert flag in way_of(asked, seen).flags
        return
    with pytest.raises(InputError) as refused:
        way_of(asked, seen)
    assert f"--{flag.replace('_', '-')} is not for {WAYS[row].name}" in str(refused.value)
    takers = [w.name for w in WAYS.values() if flag in w.flags]
    assert all(t in str(refused.value) for t in takers), "where it belongs is said"


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (Kind.PHOTOS, "photos with known cameras"),
        (Kind.VIDEO, "a video with known cameras"),
        (Kind.SPLAT, "a splat with known cameras"),
    ],
)
def test_cameras_make_another_way(kind, name):
    asked = Asked(Path("thing"), Path("out"), cameras=Path("cameras"))
    assert way_of(asked, Recognised(kind, "")).name == name
    with pytest.raises(InputError, match="--turntable"):
        way_of(replace(asked, turntable=True), Recognised(kind, ""))


def test_masks_in_a_folder_and_alone(tmp_path):
    asked = Asked(tmp_path, Path("out"))
    assert way_of(asked, Recognised(Kind.MASKS, "")).name == "a folder of masks"
    assert way_of(replace(asked, cameras=Path("c")), Recognised(Kind.MASKS, "")).name == "masks with known cameras"
    assert way_of(replace(asked, source=tmp_path / "a.png"), Recognised(Kind.MASKS, "")).name == "one image"


@pytest.mark.parametrize("pair", RIVALS)
def test_two_flags_that_say_the_same(pair):
    asked = replace(Asked(Path("a.jpg"), Path("out")), **{flag: GIVEN[flag] for flag in pair})
    with pytest.raises(InputError, match="give one of them"):
        way_of(asked, Recognised(Kind.IMAGE, ""))


@pytest.mark.parametrize("words", [("--box", "1,2,3,4"), ("--frames", "9"), ("--turntable",), ("--from", "poses")])
def test_the_command_refuses_before_it_writes(tmp_path, capsys, words):
    path = obj(tmp_path / "a.obj", TETRAHEDRON, FACES)
    assert main([str(path), "--out", str(tmp_path / "out"), *words]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("error: ")
    assert not (tmp_path / "out").exists()


def test_masks_may_come_as_a_zip_file(tmp_path):
    archive = tmp_path / "masks.zip"
    picture = cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1].tobytes()
    with zipfile.ZipFile(archive, "w") as file:
        for name in ("a.png", "b.png"):
            file.writestr(f"masks/{name}", picture)
    folder = photos.unpacked(archive, tmp_path)
    assert folder is not None
    assert {p.name for p in mask_images.files(folder)} == {"a.png", "b.png"}
    assert photos.unpacked(folder, tmp_path) == folder
    assert photos.unpacked(None, tmp_path) is None
