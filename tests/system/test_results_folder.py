"""The results folder: what is the command's own there, one run at a time, whole or not at all, on a full disk too."""

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import procmodels
from recon.files import image_library
from recon.outputs import publish, write
from recon.outputs.write import OutputsOptions
from recon.pipelines import out_folder
from recon.scene import InputError, ReconstructionError
from recon.system import manifest, names, run_lock, scratch, whole_files
from tests.made_up import made_up
from tests.system.test_users_files import content, error_of, laid_out, mask, mesh, photo, quick, run, several, text

ROOT = Path(__file__).parents[2]
SMALL = OutputsOptions(blender=False, renders=1, render_size=48, thumbnail=60)
quick = quick  # the fixture


def writes(out: Path, files: dict[str, str]) -> None:
    """Publish results of the given content."""
    with publish.replacing(out) as fresh:
        for name, words in files.items():
            (fresh / name).parent.mkdir(parents=True, exist_ok=True)
            (fresh / name).write_text(words)


OLD = dict.fromkeys(("mesh.obj", "model.blend", "masks/a.png", "masks/b.png", "cameras/images/a.jpg"), "old")
NEW = dict.fromkeys(("mesh.obj", "report.json", "masks/a.png", "masks/c.png"), "new")


def results(out: Path) -> dict[str, str]:
    """What lies in the folder, without .recon."""
    found = (p for p in sorted(out.rglob("*")) if p.is_file() and out / ".recon" not in p.parents)
    return {str(p.relative_to(out)): p.read_text() for p in found}


# ---- its own, and not its own


def test_the_next_results_replace_the_earlier_ones_and_nothing_else(tmp_path):
    writes(tmp_path, OLD)
    (tmp_path / "mine.txt").write_text("mine")
    writes(tmp_path, NEW)
    assert results(tmp_path) == {**NEW, "mine.txt": "mine"}
    assert not (tmp_path / "cameras").exists()


def test_what_was_changed_since_is_kept(tmp_path, caplog):
    """In the way of the new results, or no longer written: edited results are the user's work."""
    writes(tmp_path, OLD)
    for name in ("model.blend", "masks/a.png", "masks/b.png"):
        (tmp_path / name).write_text(f"edited {name}")
    writes(tmp_path, NEW)
    kept = {f"kept-1/{n}": f"edited {n}" for n in ("model.blend", "masks/a.png", "masks/b.png")}
    assert results(tmp_path) == {**NEW, **kept}
    assert str(tmp_path / "kept-1" / "model.blend") in caplog.text
    (tmp_path / "mesh.obj").write_text("edited again")
    writes(tmp_path, OLD)
    assert results(tmp_path) == {**OLD, **kept, "kept-2/mesh.obj": "edited again"}


def test_what_appears_during_the_run_is_kept(tmp_path):
    """Even when it has the name of a folder, or is a link to the user's files."""
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "a.png").write_text("mine")
    out = tmp_path / "out"
    with publish.replacing(out) as fresh:
        (fresh / "masks").mkdir()
        (fresh / "masks" / "a.png").write_text("new")
        (fresh / "mesh.obj").write_text("new")
        (out / "mesh.obj").write_text("mine")
        (out / "masks").symlink_to(tmp_path / "far")
    assert (out / "mesh.obj").read_text() == "new"
    assert (out / "kept-1" / "mesh.obj").read_text() == "mine"
    assert (out / "kept-1" / "masks").is_symlink()
    assert (tmp_path / "far" / "a.png").read_text() == "mine"
    assert (out / "masks" / "a.png").read_text() == "new"


def test_the_users_file_among_the_results_is_refused_next_time(quick, capsys):
    laid_out(several("photos", photo))
    assert run("photos --out out") == 0
    Path("out/masks/mine.png").write_text("mine")
    before = content()
    assert run("photos --out out") == 2
    assert "out/masks/mine.png" in error_of(capsys)
    assert content() == before


def test_an_edited_mask_given_to_the_same_run_is_refused(quick, capsys):
    laid_out(several("photos", photo))
    assert run("photos --out out") == 0
    assert run("photos --masks out/masks --out out") == 2
    assert "--masks out/masks would be replaced" in error_of(capsys)
    assert run("photos --out other") == 0
    assert run("out/cameras/images --out out") == 2


def without_manifest(out: Path) -> None:
    """As version 0.2.0 left it."""
    shutil.rmtree(out / ".recon")


def test_results_without_a_manifest_are_told_by_their_report(quick, capsys):
    laid_out({**several("photos", photo), "photos/notes.txt": text})
    assert run("photos --out out") == 0
    without_manifest(Path("out"))
    assert run("photos --out out") == 0
    assert Path("out/report.html").read_text() == "result 1 report.html"
    assert not Path("out/kept-1").exists()


@pytest.mark.parametrize("name", ["model.blend", "masks/p0.jpg.png", "cameras/mine.txt"])
@pytest.mark.parametrize("hours", [-1, 1])
def test_without_a_manifest_what_is_older_or_newer_is_the_users(quick, capsys, name, hours):
    laid_out(several("photos", photo))
    assert run("photos --out out") == 0
    without_manifest(Path("out"))
    when = Path("out/report.json").stat().st_mtime + 3600 * hours
    Path("out", name).write_text("mine")
    os.utime(Path("out", name), (when, when))
    before = content()
    assert run("photos --out out") == 2
    assert f"out/{name}" in error_of(capsys)
    assert content() == before


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b'{"files": {"../../mine.txt": ""}, "coming": null}'])
def test_a_damaged_manifest_counts_as_none(quick, damage):
    laid_out(several("photos", photo))
    assert run("photos --out out") == 0
    Path("out/.recon/manifest.json").write_bytes(damage)
    assert run("photos --out out") == 0
    assert manifest.read(Path("out")).files["mesh.obj"] == manifest.file_hash(Path("out/mesh.obj"))


def test_a_manifest_does_not_lead_out_of_its_folder(tmp_path):
    out = tmp_path / "out"
    writes(out, OLD)
    (tmp_path / "mine.txt").write_text("mine")
    forged = {"../mine.txt": manifest.file_hash(tmp_path / "mine.txt")}
    content = {"files": {**manifest.read(out).files, **forged}, "coming": None}
    content["checksum"] = manifest._checksum(manifest.Manifest(content["files"]))
    (out / manifest.WORK / manifest.NAME).write_text(json.dumps(content))
    writes(out, NEW)
    assert (tmp_path / "mine.txt").read_text() == "mine"


def test_the_sheet_of_an_earlier_run_is_no_photo(quick):
    """Nor is it when its folder is given as INPUT later; a photo of that name without a report beside it is."""
    laid_out({**several("project", photo), **several("other", photo), "other/contact_sheet.png": photo})
    assert run("project --out project/out") == 0
    for name in ("contact_sheet.png", "report.json"):
        photo(Path("project", name)) if name.endswith("png") else shutil.copy(f"project/out/{name}", f"project/{name}")
    assert run("project --out elsewhere") == 0
    assert quick[1] == quick[0]
    assert run("other --out again") == 0
    assert "contact_sheet.png" in quick[2]


# ---- whole or not at all


class Killed(BaseException):
    pass


@pytest.mark.parametrize("after", range(9))
def test_a_kill_while_results_are_moved_is_completed_by_the_next_run(tmp_path, monkeypatch, after):
    """Whenever it comes, the next run finds the earlier results or all of the new ones, and takes none for foreign."""
    writes(tmp_path, OLD)
    (tmp_path / "mine.txt").write_text("mine")
    real, count = Path.replace, iter(range(100))

    def killed(self, target):
        if next(count) == after:
            raise Killed
        return real(self, target)

    monkeypatch.setattr(Path, "replace", killed)
    try:
        writes(tmp_path, NEW)
    except Killed:
        assert after < 6, "the manifest twice and four files are moved"
    else:
        assert after >= 6
    monkeypatch.undo()
    with out_folder.claimed(tmp_path, {}):
        pass
    assert results(tmp_path) in ({**OLD, "mine.txt": "mine"}, {**NEW, "mine.txt": "mine"})
    assert (results(tmp_path)["mesh.obj"] == "old") == (after == 0)
    assert not (tmp_path / ".recon" / publish.STAGING).exists()


def test_left_overs_of_killed_runs_are_swept_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    writes(out, OLD)
    for name in (".recon/writing/mesh.obj", ".recon/scratch-ab/frames/a.jpg", ".writing-abcd_123/masks/a.png"):
        (out / name).parent.mkdir(parents=True)
        (out / name).write_text("half")
    laid = {out / ".writing-mine/a.txt", out / ".writing-12345678/tmp123/masks/a.png"}
    for path in laid:
        path.parent.mkdir(parents=True)
        path.write_text("mine")
    with out_folder.claimed(out, {}):
        assert [p.name for p in sorted((out / ".recon").iterdir())] == ["lock", "manifest.json"]
    assert all(path.read_text() == "mine" for path in laid)
    assert not (out / ".writing-abcd_123").exists()


def fails(out: Path, *made: str) -> None:
    """A run that ends without a result after it, or the user, made these files."""
    with out_folder.claimed(out, {}):
        for name in made:
            (out / name).parent.mkdir(exist_ok=True)
            (out / name).write_text("{}")
        raise ReconstructionError("no result")


def test_a_failed_run_removes_only_what_it_made(tmp_path):
    """Also files that the user puts into the new folder meanwhile stay, and stages that were finished."""
    for made, left in (((".recon/frames/a",), None), (("mine.txt", ".recon/frames/a"), ["mine.txt"])):
        with pytest.raises(ReconstructionError, match="no result"):
            fails(tmp_path / "out", *made)
        assert (sorted(os.listdir(tmp_path / "out")) if (tmp_path / "out").exists() else None) == left
    with pytest.raises(ReconstructionError, match="no result"):
        fails(tmp_path / "late", ".recon/frames.json")
    assert content(tmp_path / "late").keys() == {str(tmp_path / f"late/{n}") for n in (".recon", ".recon/frames.json")}


# ---- one at a time

HOLDER = """
import sys, time
from pathlib import Path
from recon.pipelines import out_folder
with out_folder.claimed(Path(sys.argv[1]), {}):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def other_run():
    """Starts a process that holds a results folder."""
    processes = []

    def start(out: Path) -> subprocess.Popen:
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        processes.append(
            subprocess.Popen([sys.executable, "-c", HOLDER, str(out)], stdout=subprocess.PIPE, env=environment)
        )
        assert processes[-1].stdout.readline() == b"held\n"
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.wait()


@pytest.mark.parametrize("source", ["photos", "chair.obj", "one.png", "masks"])
def test_a_second_run_says_who_holds_the_folder(quick, other_run, capsys, source):
    laid_out({**several("photos", photo), "chair.obj": mesh, "one.png": mask, **several("masks", mask, "png")})
    holder = other_run(Path("out"))
    before = content()
    assert run(f"{source} --out out") == 2
    assert f"out is in use by another run (process {holder.pid} on " in error_of(capsys)
    assert content() == before
    assert run(f"{source} --out other") == 0
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert run(f"{source} --out out") == 0
    assert not Path("out/.recon/lock").exists()


def test_a_lock_counts_by_its_process_where_files_cannot_be_locked(tmp_path, other_run, monkeypatch):
    holder = other_run(tmp_path)

    def no_locks(*_):
        raise OSError(errno.ENOLCK, "no locks available")

    monkeypatch.setattr(run_lock.fcntl, "flock", no_locks)
    with pytest.raises(InputError, match=f"process {holder.pid} "), out_folder.claimed(tmp_path, {}):
        pass
    lock = tmp_path / ".recon" / "lock"
    words = json.loads(lock.read_text())
    holder.kill()
    holder.wait()
    with out_folder.claimed(tmp_path, {}):
        assert json.loads(lock.read_text())["pid"] == os.getpid()
    # The number of the dead process may belong to another one by now.
    lock.write_text(json.dumps({**words, "pid": os.getpid()}))
    with out_folder.claimed(tmp_path, {}):
        pass
    lock.write_text(json.dumps({**words, "pid": os.getpid(), "started": scratch.started(os.getpid())}))
    with pytest.raises(InputError, match="in use"), out_folder.claimed(tmp_path, {}):
        pass


@pytest.mark.parametrize("damage", [b"", b"\0\0", b"{}", b'{"pid": "x"}', b"[" * 5000])
def test_a_damaged_lock_of_nobody_is_taken_over(tmp_path, damage):
    (tmp_path / ".recon").mkdir()
    (tmp_path / ".recon" / "lock").write_bytes(damage)
    with out_folder.claimed(tmp_path, {}):
        assert json.loads((tmp_path / ".recon" / "lock").read_text())["pid"] == os.getpid()


def test_a_lock_that_is_a_link_is_not_written_through(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "out" / ".recon").mkdir(parents=True)
    (tmp_path / "out" / ".recon" / "lock").symlink_to(tmp_path / "mine.txt")
    with pytest.raises(InputError, match="lock is a link"), out_folder.claimed(tmp_path / "out", {}):
        pass
    assert (tmp_path / "mine.txt").read_text() == "mine"


# ---- a full disk


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 2 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", place], capture_output=True)
    if mounted.returncode:
        pytest.skip("mounting a file system takes root")
    yield place
    subprocess.run(["umount", place], check=True)


def test_a_full_disk_leaves_the_earlier_results(tmp_path, small_disk):
    """Wherever in the outputs it becomes full, for anything between nothing and all that they need."""
    result, model, out = made_up(tmp_path), procmodels.load("paper/chair"), small_disk / "out"
    write.run(result, out, SMALL, model)
    before = content(out)
    free = shutil.disk_usage(small_disk).free
    failed = []
    for left in range(0, free, 65536):
        (small_disk / "filler").write_bytes(b"x" * (free - left))
        try:
            with out_folder.claimed(out, {}):
                write.run(replace(result, height_m=None), out, SMALL, model)
            break
        except ReconstructionError as error:
            failed.append(str(error))
        assert content(out) == before
        (small_disk / "filler").unlink()
    assert len(failed) >= 5
    assert all(re.fullmatch("the disk is full .*", line) for line in failed)
    assert json.loads((out / "params.json").read_text())["height_metres"] is None


def test_a_full_disk_ends_the_command_in_one_line(quick, small_disk, capsys, monkeypatch):
    """Here among the working copies: earlier results stay, and the command goes on when there is space again."""
    laid_out(several("photos", photo))
    out = small_disk / "out"
    assert run(f"photos --out {out}") == 0
    before = results(out)
    filler = small_disk / "filler"
    filler.write_bytes(b"x" * (shutil.disk_usage(small_disk).free // 4096 * 4096))
    assert run(f"photos --out {out}") == 3
    assert "the disk is full" in error_of(capsys)
    assert results(out) == before
    assert run(f"photos --out {small_disk / 'other'}") == 3
    assert not (small_disk / "other").exists()
    filler.unlink()
    assert run(f"photos --out {out}") == 0


def test_a_picture_that_cannot_be_written_is_an_error(tmp_path, monkeypatch):
    grey = np.zeros((4, 5), np.uint8)
    whole_files.write_picture(tmp_path / "a.png", grey)
    assert (whole_files.read_picture(tmp_path / "a.png", cv2.IMREAD_GRAYSCALE) == grey).all()
    before = content(tmp_path)
    with pytest.raises(OSError, match=r"a\.jpg"):
        whole_files.write_picture(tmp_path / "a.jpg", np.zeros((1, 70000), np.uint8))
    with pytest.raises(FileNotFoundError):
        whole_files.write_picture(tmp_path / "none" / "a.png", grey)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space"):
        whole_files.write_picture(tmp_path / "a.png", grey + 1)
    assert content(tmp_path) == before


def test_no_picture_is_written_unchecked():
    assert not [f for f in (ROOT / "recon").rglob("*.py") if "cv2.imwrite" in f.read_text()]


# ---- names

ODD = (
    os.fsdecode(b"caf\xe9.jpg"),
    "two\nlines.png",
    "\"quotes\" & 'apostrophes'.jpg",
    "<script>alert(1)</script>.jpg".replace("/", "\u2215"),
    "x y.jpg",
    "x_y.jpg",
    "x y.jpeg",
    "long" * 62 + ".jpg",
    "long" * 62 + ".png",
    "\u202eright to left.jpg",
    "Stuhl \u00e4\u6905\u5b50.JPG",
    "-r.jpg",
)


@pytest.mark.parametrize("four", [ODD[0:4], ODD[4:8], ODD[8:12]])
def test_odd_names_are_shown_safely(tmp_path, four):
    import pycolmap

    result = made_up(tmp_path, four)
    paths = write.run(result, tmp_path / "out", SMALL, procmodels.load("paper/chair"))
    page = paths.report_html.read_bytes().decode()
    assert "<script>alert" not in page
    facts = json.loads(paths.report_json.read_bytes().decode())
    written = [v["name"] for v in facts["views"]]
    assert len(set(written)) == 3
    assert all(n.isprintable() for n in (*written, *facts["registered"]["missing"]))
    frames = json.loads((paths.cameras / "transforms.json").read_bytes().decode())["frames"]
    images = pycolmap.Reconstruction(str(paths.cameras / "sparse" / "0")).images.values()
    assert sorted(f"images/{i.name}" for i in images) == sorted(f["file_path"] for f in frames)
    for frame in frames:
        assert (paths.cameras / frame["file_path"]).is_file()
        assert (paths.cameras / frame["mask_path"]).is_file()
    assert len(list(paths.masks.iterdir())) == len({f["mask_path"] for f in frames}) == 3


def test_odd_names_of_photos_folders_and_masks(quick, capsys):
    folder = os.fsdecode(b"m\xf6bel")
    laid_out({f"{folder}/{n}": photo for n in ODD if not n.startswith("long")})
    laid_out({f"masks/{n}": mask for n in (os.fsdecode(b"\xe9.png"), "b.png", "c\nd.png")})
    before = content()
    assert run(f"{folder} --out out") == 0
    assert len(quick[0]) == 10
    assert run("masks --out other") == 0
    after = content()
    assert {n: after[n] for n in before} == before
    assert run(f"photos --out {folder}/out") == 2
    assert run(f"{folder} --out {folder}-out") == 2
    assert "is not UTF-8" in capsys.readouterr().err.splitlines()[-1]


def test_names_never_clash():
    wanted = ["a.jpg", "A.jpg", "a-2.jpg", "a.JPG", "b", "b", "x" * 300 + ".jpg", "x" * 301 + ".jpg", "\u00e9" * 120]
    made = names.unique(wanted, taken=["B"])
    assert len({n.casefold() for n in (*made, "B")}) == len(wanted) + 1
    assert made[:2] == ("a.jpg", "A-2.jpg")
    assert max(len(os.fsencode(n)) for n in made) <= 200
    assert made[6].endswith(".jpg")
    assert names.shown(os.fsdecode(b"a\xe9\n")) == "a\\xe9\\n"
    assert names.shown("\u00e4 \u6905") == "\u00e4 \u6905"


@pytest.mark.parametrize("links", [True, False])
def test_photos_are_gathered_under_their_own_content(tmp_path, monkeypatch, links):
    """With links, and with copies where the file system has none; an existing name is never written to."""
    inside = ["cam1/frame.0001", "cam1/frame.0002", "cam2/frame.0001", "a/b.jpg", "c/b.jpg", "a_b.jpg", "d/a_b.jpg"]
    paths = [tmp_path / "photos" / n for n in inside]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(str(path))
    if not links:
        monkeypatch.setattr(os, "symlink", lambda *_: (_ for _ in ()).throw(PermissionError(errno.EPERM, "no links")))
    flat = image_library.flat_names(inside, paths)
    for _ in range(2):
        image_library.link(paths, flat, tmp_path / "given")
        assert [(tmp_path / "given" / n).read_text() for n in flat] == list(map(str, paths))
        assert [(tmp_path / "given" / n).is_symlink() for n in flat] == [links] * len(flat)
    with pytest.raises(FileExistsError):
        image_library.link(paths[:2], ("a", "a"), tmp_path / "given")
    assert [p.read_text() for p in paths] == list(map(str, paths))
    assert re.fullmatch(r"cam1_frame\.0001", flat[0])
