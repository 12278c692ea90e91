"""Layouts of INPUT, --masks, --cameras and --out: no file of the user's changes, and what would hit one is refused.

Whatever takes long between reading and writing is left out: the photos' pipeline ends after the frames, and writes
results that are like real ones in name and place.
"""

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from recon.command import main
from recon.files import frames, video
from recon.outputs import publish
from recon.outputs.write import OutputsOptions, _paths
from recon.pipelines import image, mask_set, photo_source, photos, shape

Content = Callable[[Path], object]


def photo(path: Path) -> None:
    seed = int(hashlib.sha256(os.fsencode(path.name) + os.fsencode(path.parent.name)).hexdigest()[:8], 16)
    noise = np.random.default_rng(seed).integers(0, 255, (9, 12, 3)).astype(np.uint8)
    path.write_bytes(cv2.imencode(".jpg" if path.suffix != ".png" else ".png", cv2.resize(noise, (120, 90)))[1])


def mask(path: Path) -> None:
    white = np.zeros((90, 120), np.uint8)
    white[20:70, 30 : 60 + len(path.name)] = 255
    path.write_bytes(cv2.imencode(".png", white)[1])


def mesh(path: Path) -> None:
    trimesh.creation.box((0.5, 0.5, 1)).export(path)


def text(path: Path) -> None:
    path.write_text(f"the user's own {path.name}\n")


def link(target: str, hard: bool = False) -> Content:
    """A link to a path that is relative to the root of the layout; symbolic ones may dangle."""

    def make(path: Path) -> None:
        if hard:
            os.link(Path(target), path)
        else:
            path.symlink_to(Path(target).absolute())

    return make


def folder(path: Path) -> None:
    path.mkdir()


def transforms(*images: str, masks: str | None = None) -> Content:
    """A transforms.json with a camera for each image; paths relative to it."""

    def write(path: Path) -> None:
        rows = []
        for i, name in enumerate(images):
            pose = np.eye(4)
            pose[:3, 3] = (0.1 * i, 0, 3)
            about = {"mask_path": f"{masks}/{Path(name).stem}.png"} if masks else {}
            rows.append({"file_path": name, "transform_matrix": pose.tolist(), **about})
        path.write_text(json.dumps({"fl_x": 100.0, "w": 120, "h": 90, "frames": rows}))

    return write


def several(where: str, make: Content, ending: str = "jpg", count: int = 3) -> dict[str, Content]:
    return {f"{where}/p{i}.{ending}": make for i in range(count)}


@dataclass(frozen=True)
class Layout:
    """Files in the working folder, a command, and what of a refusal must be named; None where it is accepted."""

    command: str
    files: dict[str, Content]
    names: str | None = None
    used: int | None = field(default=None)  # photos that are read, when accepted


PHOTOS = several("photos", photo)
MASKS = several("photos-masks", mask, "png")
PROJECT = {**several("project/photos", photo), "project/notes.txt": text}
SET = {**several("set/images", photo), "set/transforms.json": transforms(*(f"images/p{i}.jpg" for i in range(3)))}

LAYOUTS = {
    # Sensible ones, which must work, twice.
    "apart": Layout("photos --out out", PHOTOS, used=3),
    "default out": Layout("photos", PHOTOS, used=3),
    "from within the photos": Layout("./photos/../photos --out photos/out/run", PHOTOS, used=3),
    "out below the photos": Layout("photos --out photos/out", PHOTOS, used=3),
    "out in the project": Layout("project/photos --out project/out", PROJECT, used=3),
    "out is the project": Layout("project/photos --out project", PROJECT, used=3),
    "masks beside": Layout("photos --masks photos-masks --out out", {**PHOTOS, **MASKS}, used=3),
    "out below the masks": Layout("photos --masks photos-masks --out photos-masks/out", {**PHOTOS, **MASKS}, used=3),
    "out has the user's other files": Layout(
        "photos --out out", {**PHOTOS, "out/notes.txt": text, "out/b/c.obj": mesh}
    ),
    "out is a link": Layout("photos --out short", {**PHOTOS, "far/notes.txt": text, "short": link("far")}, used=3),
    "photos are links": Layout(
        "photos --out out", {**several("real", photo), **{f"photos/p{i}.jpg": link(f"real/p{i}.jpg") for i in range(3)}}
    ),
    "photos is a link": Layout("photos --out out", {**several("real", photo), "photos": link("real")}, used=3),
    "other capitals": Layout("photos --out out", {**PHOTOS, "out/MESH.OBJ": text, "out/Masks/p0.png": mask}, used=3),
    "a browser's hidden files": Layout(
        "photos --out out", {**PHOTOS, "out/masks/.DS_Store": text, "out/masks/Thumbs.db": text}
    ),
    "an empty folder masks": Layout("photos --out out", {**PHOTOS, "out/masks": folder}, used=3),
    "a set with cameras": Layout("set --out out", SET, used=3),
    "out in the set": Layout("set --out set/out", SET, used=3),
    "cameras' file in out": Layout("set/images --cameras set/transforms.json --out set", SET, used=3),
    "mesh beside": Layout("x/chair.obj --out x", {"x/chair.obj": mesh}),
    "mesh apart": Layout("x/mesh.obj --out y", {"x/mesh.obj": mesh}),
    "a mask": Layout("m.png --out out", {"m.png": mask}),
    "a mask in out": Layout("out/m.png --out out", {"out/m.png": mask}),
    "folder of masks": Layout("m --out out", several("m", mask, "png")),
    "hard links of photos": Layout(
        "photos --out out",
        {**several("real", photo), **{f"photos/p{i}.jpg": link(f"real/p{i}.jpg", hard=True) for i in range(3)}},
    ),
    # Clashing names: all are used, none is written to.
    "a/b.jpg, c/b.jpg, a_b.jpg": Layout(
        "set --out out",
        {
            **{f"set/images/{n}": photo for n in ("a/b.jpg", "c/b.jpg", "a_b.jpg")},
            "set/transforms.json": transforms("images/a/b.jpg", "images/c/b.jpg", "images/a_b.jpg"),
        },
        used=3,
    ),
    "names without endings": Layout(
        "set --out out",
        {
            **{f"set/cam{c}/frame.000{i}.png": photo for c in (1, 2) for i in (1, 2, 3)},
            "set/transforms.json": transforms(*(f"cam{c}/frame.000{i}" for c in (1, 2) for i in (1, 2, 3))),
        },
        used=6,
    ),
    "names without any ending": Layout(
        "set --out out",
        {
            **{f"set/cam{c}/frame.000{i}": photo for c in (1, 2) for i in (1, 2, 3)},
            "set/transforms.json": transforms(*(f"cam{c}/frame.000{i}" for c in (1, 2) for i in (1, 2, 3))),
        },
        used=6,
    ),
    "capitals alone differ": Layout(
        "set --out out",
        {
            **{f"set/images/{n}": photo for n in ("IMG.jpg", "img.jpg", "Img.JPG")},
            "set/transforms.json": transforms("images/IMG.jpg", "images/img.jpg", "images/Img.JPG"),
        },
        used=3,
    ),
    "folders joined are another's name": Layout(
        "set --out out",
        {
            **{f"set/{n}": photo for n in ("x/a/b.jpg", "x_a/b.jpg", "x/a_b.jpg", "b.jpg", "x_a_b.jpg")},
            "set/transforms.json": transforms("x/a/b.jpg", "x_a/b.jpg", "x/a_b.jpg", "b.jpg", "x_a_b.jpg"),
        },
        used=5,
    ),
    "masks of clashing names": Layout(
        "set --out out",
        {
            **{f"set/{n}": photo for n in ("a/p.jpg", "c/p.jpg")},
            "set/m/p.png": mask,
            "set/transforms.json": transforms("a/p.jpg", "c/p.jpg", masks="m"),
        },
        used=2,
    ),
    # Refused, by name.
    "out is the photos": Layout("photos --out photos", PHOTOS, "photos"),
    "out is the photos, absolute": Layout("photos --out {root}/photos", PHOTOS, "photos"),
    "out is the photos, dots": Layout("photos/ --out photos/../photos/.", PHOTOS, "photos"),
    "out is the photos, by a link": Layout("photos --out l", {**PHOTOS, "l": link("photos")}, "INPUT photos"),
    "photos by a link are out": Layout("l --out photos", {**PHOTOS, "l": link("photos")}, "INPUT l"),
    "out is the set": Layout("set --out set", SET, "INPUT set"),
    "out is the set's images": Layout("set --out set/images", SET, "INPUT set"),
    "out is the masks": Layout("photos --masks m --out m", {**PHOTOS, **several("m", mask, "png")}, "--masks m"),
    "out is the cameras' folder": Layout("set/images --cameras set --out set", SET, "--cameras set"),
    "own masks and cameras in the project": Layout(
        "project/photos --out project",
        {**PROJECT, "project/masks/p0.png": mask, "project/cameras/list.txt": text},
        "project/cameras/list.txt and 1 more",
    ),
    "own masks in out, and used": Layout(
        "project/photos --masks project/masks --out project",
        {**PROJECT, **several("project/masks", mask, "png")},
        "--masks project/masks",
    ),
    "cameras in out, and used": Layout(
        "project/photos --cameras project/cameras --out project",
        {**PROJECT, "project/cameras/transforms.json": transforms(*(f"../photos/p{i}.jpg" for i in range(3)))},
        "--cameras project/cameras",
    ),
    "photos below cameras": Layout(
        "project/cameras/images --out project", several("project/cameras/images", photo), "INPUT project/cameras/images"
    ),
    "masks below masks": Layout(
        "photos --masks out/masks/fine --out out", {**PHOTOS, **several("out/masks/fine", mask, "png")}, "--masks out"
    ),
    "photos in the work folder": Layout(
        "out/.recon/photos --out out", several("out/.recon/photos", photo), "INPUT out"
    ),
    "somebody else's work folder": Layout("photos --out out", {**PHOTOS, "out/.recon/diary.txt": text}, "out/.recon"),
    "the work folder is a link": Layout(
        "photos --out out", {**PHOTOS, "far/a.txt": text, "out/.recon": link("far")}, "out/.recon"
    ),
    "within the work folder is a link": Layout(
        "photos --out out", {**PHOTOS, "far/a.jpg": photo, "out/.recon/frames": link("far")}, "out/.recon/frames"
    ),
    "mesh would be replaced": Layout("x/mesh.obj --out x", {"x/mesh.obj": mesh}, "INPUT x/mesh.obj"),
    "mesh would be replaced, by a link": Layout(
        "m.obj --out x", {"x/mesh.obj": mesh, "m.obj": link("x/mesh.obj")}, "INPUT m.obj"
    ),
    "mesh would be replaced, hard link": Layout(
        "m.obj --out x", {"x/mesh.obj": mesh, "m.obj": link("x/mesh.obj", hard=True)}, "INPUT m.obj"
    ),
    "mesh.glb of the user's": Layout("x/chair.obj --out x", {"x/chair.obj": mesh, "x/mesh.glb": text}, "x/mesh.glb"),
    "a result's name is a link": Layout(
        "photos --out out", {**PHOTOS, "thesis.html": text, "out/report.html": link("thesis.html")}, "out/report.html"
    ),
    "a result's name is a dangling link": Layout(
        "photos --out out", {**PHOTOS, "out/mesh.obj": link("gone")}, "out/mesh.obj"
    ),
    "masks is a link": Layout("photos --out out", {**PHOTOS, **MASKS, "out/masks": link("photos-masks")}, "out/masks"),
    "masks is a file": Layout("photos --out out", {**PHOTOS, "out/masks": text}, "out/masks"),
    "report.json is a folder": Layout("photos --out out", {**PHOTOS, "out/report.json/a.txt": text}, "out/report.json"),
    "report.json of another program": Layout(
        "photos --out out", {**PHOTOS, "out/report.json": text}, "out/report.json"
    ),
    "a mask named like a result": Layout(
        "contact_sheet.png --out .", {"contact_sheet.png": mask}, "INPUT contact_sheet.png"
    ),
    "one image's mask in masks": Layout(
        "a.jpg --mask out/masks/a.png --out out", {"a.jpg": photo, "out/masks/a.png": mask}, "--mask out/masks/a.png"
    ),
    "a folder of masks as INPUT in out": Layout(
        "out/masks --out out", several("out/masks", mask, "png"), "INPUT out/masks"
    ),
}


@pytest.fixture
def quick(tmp_path, monkeypatch):
    """The command in a folder of its own, without what takes long; gives the names of the photos read, run by run."""
    read: list[tuple[str, ...]] = []

    def results(out, names):
        with publish.replacing(out) as fresh:
            for name in ("mesh.obj", "mesh.glb", "model.blend", "params.json", "report.html", "contact_sheet.png"):
                (fresh / name).write_text(f"result {len(read)} {name}")
            (fresh / "cameras" / "images").mkdir(parents=True)
            (fresh / "masks").mkdir()
            for name in names:
                (fresh / "masks" / f"{name}.png").write_text(f"mask {len(read)}")
                (fresh / "cameras" / "images" / name).write_text(f"image {len(read)}")
            facts = {"versions": {"nnproc-recon": "0"}, "seconds": {"outputs": 0.1, "total": 1}, "params": {}}
            facts |= {
                "class": "chair",
                "mean_iou": None,
                "registered": {"how": "quick"},
                "warnings": [],
                "confidence": 0,
            }
            (fresh / "report.json").write_text(json.dumps(facts))
        read.append(names)
        return _paths(out, OutputsOptions())

    def by_photos(source, out, work, models, options):
        found = photo_source.run(source, work, options.cameras, video.VideoOptions())
        return results(out, frames.run(found.folder, work, frames.FramesOptions(allow_single=True)).names)

    monkeypatch.setattr(photos, "_run", by_photos)
    monkeypatch.setattr(shape, "_run", lambda path, out, *_: results(out, ()))
    monkeypatch.setattr(image, "_run", lambda path, out, *_: results(out, (path.name,)))
    monkeypatch.setattr(mask_set, "_run", lambda path, out, *_: results(out, ("a", "b")))
    monkeypatch.chdir(tmp_path)
    return read


def laid_out(files: dict[str, Content]) -> None:
    """Make the files of a layout, links last."""
    for name, make in files.items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        make(Path(name))


def content(root: Path = Path()) -> dict[str, str]:
    """Everything below a folder: hashes of files, targets of links, and folders."""
    found = {}
    for path in sorted(root.rglob("*")):
        if path.is_symlink():
            found[str(path)] = f"link to {os.readlink(path)}"
        else:
            found[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "folder"
    return found


def run(command: str) -> int:
    return main([word.format(root=Path.cwd()) for word in command.split()])


def error_of(capsys) -> str:
    """The one line of a refusal."""
    message = capsys.readouterr().err
    assert "Traceback" not in message
    lines = [line for line in message.splitlines() if line.startswith("error: ")]
    assert lines == message.splitlines()[-1:]
    return lines[0]


ACCEPTED = {n: x for n, x in LAYOUTS.items() if x.names is None}
REFUSED = {n: x for n, x in LAYOUTS.items() if x.names is not None}


@pytest.mark.parametrize("layout", REFUSED.values(), ids=REFUSED.keys())
def test_what_would_hit_the_users_files_is_refused_by_name(quick, capsys, layout):
    laid_out(layout.files)
    before = content()
    assert run(layout.command) == 2
    assert layout.names in (line := error_of(capsys))
    assert "--out" in line
    assert content() == before, "nothing changed, nothing made"
    assert not quick, "before any work"


@pytest.mark.parametrize("layout", ACCEPTED.values(), ids=ACCEPTED.keys())
def test_sensible_layouts_work_again_and_again(quick, capsys, layout):
    """Also the second run: it reads what the first one read, and replaces what that wrote."""
    laid_out(layout.files)
    before = content()
    for again in range(2):
        assert run(layout.command) == 0, capsys.readouterr().err
        after = content()
        assert {name: after.get(name) for name in before} == before
        assert len(set(quick)) == 1
        assert layout.used in (None, len(quick[0]))
        report = next(Path(name) for name in after if name.endswith("report.html") and name not in before)
        assert report.read_text() == f"result {again} report.html"
        assert not [name for name in after if "kept-" in name]


@pytest.mark.slow
def test_the_whole_command_beside_the_users_files(tmp_path, monkeypatch, caplog):
    """Nothing left out: a mesh, then one mask, into a folder with the user's files, with a result edited in between."""
    monkeypatch.chdir(tmp_path)
    laid_out({"x/box.obj": mesh, "x/m.png": mask, "x/notes.txt": text, "x/old/mesh.obj": text})
    before = content()
    assert run("x/box.obj --class table --out x") == 0
    first = {n: h for n, h in content().items() if n not in before and ".recon" not in n}
    assert {f"x/{n}" for n in ("mesh.obj", "model.blend", "report.html", "contact_sheet.png")} <= first.keys()
    Path("x/model.blend").write_text("edited")
    assert run("x/m.png --class table --out x") == 0
    assert "x/kept-1/model.blend" in caplog.text
    after = content()
    assert {name: after.get(name) for name in before} == before
    assert Path("x/kept-1/model.blend").read_text() == "edited"
    assert {name for name in first if after[name] == first[name]} == set(), "all are of the second run"
    assert Path("x/masks/m.png").is_file()
    Path("x/mesh.obj").rename("x/mine.obj")
    assert run("x/mine.obj --class table --out x --up z --front -y") == 0
    assert not Path("x/masks").exists(), "a mesh has none, and those were the last run's"
    kept = {
        "frames",
        "manifest.json",
        *(f"{s}.{e}" for s in ("shape", "fit", "mask", "search", "colours") for e in ("json", "npz")),
    }
    assert {p.name for p in Path("x/.recon").iterdir()} == kept, "nothing half done"


def test_enough_layouts():
    assert len(LAYOUTS) >= 40
    assert len(REFUSED) >= 20
