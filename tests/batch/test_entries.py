"""What lists say: folders, CSV, JSON and data sets become the words of a command line, each with a name of its own."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.batch.entries import entries
from recon.batch.options import known_options
from recon.command import asked_of, parser
from recon.scene import InputError
from tests.files.test_recognise import FACES, TETRAHEDRON, obj

OUT = Path("/nowhere/out")


def asked(entry):
    """What a run would be asked for."""
    return asked_of(parser().parse_args(list(entry.words)), OUT)


def picture(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.zeros((8, 8, 3), np.uint8))
    return path


def mesh(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    return obj(path, TETRAHEDRON, FACES)


def test_a_folder_of_folders_and_files(tmp_path):
    mesh(tmp_path / "b.obj")
    (tmp_path / "b.mtl").write_text("")
    (tmp_path / "notes.txt").write_text("")
    for i in range(8):
        picture(tmp_path / "photos" / f"{i}.jpg")
    mesh(tmp_path / "asset" / "model.obj")
    picture(tmp_path / "asset" / "wood.png")
    mesh(tmp_path / "two" / "left.obj")
    mesh(tmp_path / "two" / "right.obj")
    picture(tmp_path / "cover.jpg")
    (tmp_path / ".hidden").mkdir()
    (tmp_path / "out").mkdir()
    found = entries(tmp_path, {"class": "table"}, tmp_path / "out")
    assert [e.name for e in found] == ["model", "b", "photos", "two"]
    assert [asked(e).source.relative_to(tmp_path).as_posix() for e in found] == [
        "asset/model.obj",
        "b.obj",
        "photos",
        "two",
    ]
    assert {asked(e).class_name for e in found} == {"table"}
    assert entries(tmp_path, {}, tmp_path / "out", limit=2)[1].name == "b"


def test_pictures_alone_are_inputs_only_when_that_is_said(tmp_path):
    for name in ("a.jpg", "b.jpg"):
        picture(tmp_path / name)
    with pytest.raises(InputError, match="add --input image"):
        entries(tmp_path, {}, OUT)
    found = entries(tmp_path, {"input": "image"}, OUT)
    assert [(e.name, asked(e).input) for e in found] == [("a", "image"), ("b", "image")]


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_list_as_csv(tmp_path, delimiter):
    rows = [
        ["Input", "class", "height", "turntable", "camera_off", "masks"],
        ["a.obj", "", "0.9", "no", "", ""],
        ["sub/a.obj", "paper/table", "", "yes", "3.5", "sub/masks"],
        ["", "", "", "", "", ""],
        ["/elsewhere/b", "own.py", "", "", "", ""],
    ]
    path = tmp_path / "list.csv"
    path.write_bytes(("\r\n".join(delimiter.join(row) for row in rows) + "\r\n").encode("utf-8-sig"))
    first, second, third = entries(path, {"class": "sofa", "seed": "4"}, OUT)
    assert [first.name, second.name, third.name] == ["a", "a-2", "b"]
    a, b, c = map(asked, (first, second, third))
    assert (a.source, a.class_name, a.height, a.turntable, a.seed) == (tmp_path / "a.obj", "sofa", 0.9, False, 4)
    assert (b.source, b.class_name, b.height) == (tmp_path / "sub" / "a.obj", "paper/table", None)
    assert (b.turntable, b.camera_off, b.masks) == (True, 3.5, tmp_path / "sub" / "masks")
    assert (c.source, c.class_name) == (Path("/elsewhere/b"), str(tmp_path / "own.py"))
    assert third.reads == (Path("/elsewhere/b"), tmp_path / "own.py")


def test_a_list_as_json(tmp_path):
    rows = ["a.obj", {"input": "b.jpg", "name": "the second", "box": [1, 2, 30, 40], "turntable": False, "height": 1.5}]
    path = tmp_path / "list.json"
    path.write_text(json.dumps(rows))
    first, second = entries(path, {}, OUT)
    assert (first.name, second.name) == ("a", "the_second")
    got = asked(second)
    assert (got.box, got.turntable, got.height, got.class_name) == ("1,2,30,40", False, 1.5, "chair")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("file,class\na.obj,chair\n", 'no column "input"'),
        ("input,colour\na.obj,red\n", "there is no option colour; known: input, name, "),
        ('input\n"a.obj\n', "line"),
        ("input\n", "lists nothing"),
        ("", 'no column "input"'),
    ],
)
def test_a_list_that_cannot_be_used_is_refused_as_a_whole(tmp_path, text, said):
    path = tmp_path / "list.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as refused:
        entries(path, {}, OUT)
    assert str(path) in str(refused.value)


def test_a_line_that_is_wrong_is_no_others_fault(tmp_path):
    path = tmp_path / "list.json"
    path.write_text(json.dumps([{"class": "table"}, {"input": "a.obj", "turntable": "perhaps"}, "b.obj"]))
    nameless, unsure, fine = entries(path, {}, OUT)
    assert "entry 1 names no input" in nameless.wrong
    assert "turntable is yes or no, got 'perhaps'" in unsure.wrong
    assert (fine.wrong, fine.name) == (None, "b")


def test_names_are_folders_of_their_own(tmp_path):
    path = tmp_path / "list.json"
    path.write_text(
        json.dumps(["A/x.obj", "B/X.obj", "C/table.csv", {"input": "d", "name": "../../etc/x y"}, "index.html/"])
    )
    names = [e.name for e in entries(path, {}, OUT)]
    assert len({n.casefold() for n in names}) == len(names)
    assert all("/" not in n and n not in ("table.csv", "index.html", "thumbs", ".batch", "..") for n in names)


def test_shapenet_brings_classes_and_axes(tmp_path):
    mesh(tmp_path / "03001627" / "m1" / "models" / "model_normalized.obj")
    mesh(tmp_path / "04379243" / "m2" / "models" / "model_normalized.obj")
    found = entries(tmp_path, {}, OUT)
    assert [e.name for e in found] == ["chair_m1", "table_m2"]
    got = asked(found[1])
    assert (got.class_name, got.up, got.front) == ("table", "y", "-z")
    assert got.source == (tmp_path / "04379243" / "m2" / "models" / "model_normalized.obj").resolve()
    (chair,) = entries(tmp_path, {"class": "paper/chair"}, OUT)
    assert (chair.name, asked(chair).class_name) == ("chair_m1", "paper/chair")
    assert [asked(e).class_name for e in entries(tmp_path, {"class": "auto"}, OUT)] == ["auto", "auto"]


def test_meshes_by_class_leave_their_axes_to_be_found_unless_they_are_known(tmp_path):
    mesh(tmp_path / "chairs" / "one.obj")
    mesh(tmp_path / "desk" / "one.obj")
    found = entries(tmp_path, {}, OUT)
    assert [(e.name, asked(e).class_name, asked(e).up) for e in found] == [
        ("chair_one", "chair", None),
        ("table_one", "table", None),
    ]
    (tmp_path / "axes.json").write_text('{"up": "z", "front": "-y", "files": {"desk/one.obj": {"front": "x"}}}')
    assert [(asked(e).up, asked(e).front) for e in entries(tmp_path, {}, OUT)] == [("z", "-y"), ("z", "x")]


def test_pix3d_brings_photos_with_masks_and_cameras(tmp_path):
    records = [
        {
            "img": f"img/chair/{n}.jpg",
            "mask": f"mask/chair/{n}.png",
            "model": "model/chair/A/m.obj",
            "category": "chair",
        }
        for n in ("0001", "0002")
    ]
    (tmp_path / "pix3d.json").write_text(json.dumps(records))
    picture(tmp_path / "mask/chair/0001.png")
    first, second = entries(tmp_path, {"seed": "2"}, OUT)
    assert (first.name, asked(first).pix3d) == ("chair_0001", tmp_path / "pix3d.json")
    assert (asked(first).mask, asked(second).mask) == (tmp_path / "mask/chair/0001.png", None)
    assert (asked(second).source, asked(second).seed) == (tmp_path / "img/chair/0002.jpg", 2)


def test_every_option_of_the_command_is_one_of_a_list():
    flags = {a.dest for a in parser()._actions} - {"help", "photos", "out", "force", "start", "verbose"}
    assert {o.dest for o in known_options().values()} == flags
