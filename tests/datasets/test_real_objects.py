"""Outside layouts of real furniture: whatever the layout and its axes, the same chair comes back in the same frame."""

from __future__ import annotations

import json
import logging
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from datasets import pix3d, sweethome3d_objects
from datasets.axis_rotations import turn
from datasets.catalogue_object import CLASSES
from datasets.catalogues import DataError, objects
from datasets.sweethome3d import CatalogueError
from recon.evaluate import axes

AWAY = 3.7, np.array([0.5, -2.0, 11.0])  # a file has any scale and place


@pytest.fixture(scope="module")
def truth() -> trimesh.Trimesh:
    """A chair of two parts that is like itself from no other side: a bar stands out at its left, low at the front."""
    import procmodels

    model = procmodels.load("paper/chair")
    shape = model.build(model.space.sample(np.random.default_rng(3)))
    bar = trimesh.creation.box(bounds=[(0.1, -0.75, -0.3), (0.7, -0.6, -0.2)])
    both = trimesh.util.concatenate([shape.to_trimesh(), bar])
    low, high = both.bounds
    return trimesh.Trimesh((both.vertices - (low + high) / 2) / (high - low).max(), both.faces, process=False)


def in_file(truth: trimesh.Trimesh, up: str, front: str) -> trimesh.Trimesh:
    """The chair as a file with such axes would hold it."""
    scale, place = AWAY
    return trimesh.Trimesh(scale * truth.vertices @ turn(up, front) + place, truth.faces, process=False)


def obj(mesh: trimesh.Trimesh) -> str:
    """OBJ text of two groups, with a vertex that no face uses and a material file that is not there."""
    lines = ["mtllib gone.mtl", "v 900 900 900", *(f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in mesh.vertices)]
    for i, face in enumerate(mesh.faces + 2):
        lines += [f"g part{i}", "usemtl none"] if i in (0, len(mesh.faces) - 12) else []
        lines.append("f " + " ".join(map(str, face)))
    return "\n".join(lines) + "\n"


def write(file: Path, mesh: trimesh.Trimesh) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(obj(mesh)) if file.suffix == ".obj" else mesh.export(file)
    return file


def assert_is(loaded: trimesh.Trimesh, truth: trimesh.Trimesh, within: float = 1e-6) -> None:
    """The same triangles in the same places, in whatever order the file's reader gives them."""
    low, high = loaded.bounds
    np.testing.assert_allclose(low + high, 0, atol=1e-9)
    assert (high - low).max() == pytest.approx(1)
    assert len(loaded.faces) == len(truth.faces)
    np.testing.assert_allclose(loaded.area, truth.area, rtol=10 * within)
    np.testing.assert_allclose(loaded.bounds, truth.bounds, atol=within)
    for a, b in ((loaded, truth), (truth, loaded)):
        nearest = np.linalg.norm(a.vertices[:, None] - b.vertices[None], axis=2).min(1)
        assert nearest.max() < within


@pytest.mark.parametrize(("suffix", "up", "front"), [(s, "y", "-z") for s in ("obj", "ply", "glb", "off")])
def test_mesh_folders_face_minus_z(tmp_path: Path, truth: trimesh.Trimesh, suffix: str, up: str, front: str) -> None:
    write(tmp_path / "mine" / "chair" / f"a.{suffix}", in_file(truth, up, front))
    (item,) = objects(tmp_path / "mine")
    assert (item.data, item.class_name, item.name, item.mask) == ("mine", "chair", "a", None)
    # PLY, GLB and STL keep single precision.
    assert_is(item.load(), truth, 1e-6 if suffix in ("obj", "off") else 3e-6)


def test_stl_is_z_up(tmp_path: Path, truth: trimesh.Trimesh) -> None:
    write(tmp_path / "things" / "a.stl", in_file(truth, "z", "-y"))
    (item,) = objects(tmp_path / "things", "sofa")
    assert item.class_name == "sofa"
    assert_is(item.load(), truth, 3e-6)


def test_axes_of_a_folder_and_of_single_files(tmp_path: Path, truth: trimesh.Trimesh) -> None:
    write(tmp_path / "chairs" / "a.obj", in_file(truth, "z", "x"))
    write(tmp_path / "chairs" / "b.obj", in_file(truth, "-x", "z"))
    write(tmp_path / "desk" / "a.obj", in_file(truth, "z", "x"))
    write(tmp_path / "table" / "a.obj", in_file(truth, "z", "x"))
    cv2.imwrite(str(tmp_path / "chairs" / "b.png"), np.zeros((4, 4), np.uint8))
    table = {"up": "z", "front": "x", "files": {"chairs/b.obj": {"up": "-x", "front": "z", "note": "lies"}}}
    (tmp_path / "axes.json").write_text(json.dumps(table))
    a, b, *tables = objects(tmp_path)
    assert (a.mask, b.mask) == (None, tmp_path / "chairs" / "b.png")
    assert [(t.class_name, t.name) for t in tables] == [("table", "a"), ("table", "a-2")]
    for item in (a, b, *tables, *objects(tmp_path / "chairs")):
        assert_is(item.load(), truth)


def test_axes_that_cannot_be_are_refused(tmp_path: Path, truth: trimesh.Trimesh) -> None:
    write(tmp_path / "chair" / "a.obj", truth)
    for text, message in (
        ("{", "JSON"),
        ("[]", "expected"),
        ('{"files": {"chair/a.obj": "x"}}', "expected"),
        ('{"up": "up"}', "axes such as"),
        ('{"up": "y", "files": {"chair/a.obj": {"front": "-y"}}}', r"chair/a\.obj: up .* one axis"),
    ):
        (tmp_path / "axes.json").write_text(text)
        with pytest.raises(DataError, match=message):
            objects(tmp_path)


def test_the_shipped_axes_are_well_formed() -> None:
    files = sorted((Path(axes.__file__).parents[2] / "datasets" / "axes").glob("*.json"))
    assert files
    for file in files:
        table = json.loads(file.read_text())
        for entry in (table, *table["files"].values()):
            turn(entry.get("up", "y"), entry.get("front", "-z"))


@pytest.mark.parametrize(
    ("member", "front", "data"),
    [("model.obj", "x", "ShapeNetCore.v1"), ("models/model_normalized.obj", "-z", "ShapeNetCore.v2")],
)
def test_shapenet(tmp_path: Path, truth: trimesh.Trimesh, member: str, front: str, data: str) -> None:
    write(tmp_path / "03001627" / "1a6f615e8b1b5ae4dbbc9440457e303e" / member, in_file(truth, "y", front))
    write(tmp_path / "02691156" / "1a04e3eab45ca15dd86060f189eb133" / member, truth)  # aeroplanes
    (tmp_path / "03001627" / "2acc2a87aef7cc559ca96b2737246fca").mkdir()
    (tmp_path / "taxonomy.json").write_text("[]")
    for path in (tmp_path, tmp_path / "03001627"):
        good, lost = objects(path, "chair")
        assert (good.data, good.class_name, good.name) == (data, "chair", "1a6f615e8b1b5ae4dbbc9440457e303e")
        assert_is(good.load(), truth)
        with pytest.raises(DataError, match=f"2acc2a87aef7cc559ca96b2737246fca/{member}"):
            lost.load()
    with pytest.raises(DataError, match="03001627 \\(chair\\)"):
        objects(tmp_path / "02691156")


def records(*rows: tuple[str, str, str]) -> str:
    keys = {"rot_mat": np.eye(3).tolist(), "trans_mat": [0, 0, 2], "focal_length": 35.0}
    return json.dumps(
        [{"img": f"img/{n}.png", "mask": f"mask/{n}.png", "model": m, "category": c, **keys} for n, c, m in rows]
    )


def test_pix3d(tmp_path: Path, truth: trimesh.Trimesh) -> None:
    stefan, ivar = "model/chair/IKEA_STEFAN/model.obj", "model/bookcase/IKEA_IVAR/model_{}.obj"
    for model in (stefan, ivar.format(1), ivar.format(2)):
        write(tmp_path / model, in_file(truth, "y", "-z"))
    (tmp_path / "mask" / "chair").mkdir(parents=True)
    (tmp_path / "mask" / "chair" / "0002.png").write_bytes(b"")
    text = records(
        ("chair/0001", "chair", stefan),
        ("chair/0002", "chair", stefan),
        ("bookcase/0001", "bookcase", ivar.format(1)),
        ("bookcase/0002", "bookcase", ivar.format(2)),
        ("tool/0001", "tool", "model/tool/HAMMER/model.obj"),
    )
    (tmp_path / "pix3d.json").write_text(text)
    found = objects(tmp_path)
    assert [(o.data, o.class_name, o.name) for o in found] == [
        ("pix3d", "chair", "IKEA_STEFAN"),
        ("pix3d", "shelf", "IKEA_IVAR_model_1"),
        ("pix3d", "shelf", "IKEA_IVAR_model_2"),
    ]
    assert found[0].mask == tmp_path / "mask/chair/0002.png"
    assert len(pix3d.pictures(tmp_path)[found[0].source]) == 2
    for item in found:
        assert_is(item.load(), truth)
    (tmp_path / stefan).unlink()
    with pytest.raises(DataError, match=r"IKEA_STEFAN.model\.obj"):
        found[0].load()
    for broken, message in (("{", "records"), ("{}", "list"), ('[{"img": "a"}]', "record 0 has no mask, model")):
        (tmp_path / "pix3d.json").write_text(broken)
        with pytest.raises(DataError, match=message):
            objects(tmp_path)
    (tmp_path / "pix3d.json").write_text(records(("chair/0001", "chair", "../../secret.obj")))
    with pytest.raises(DataError, match="outside"):
        objects(tmp_path)


def catalogue(file: Path, titles: dict[str, str], mesh: trimesh.Trimesh, rotation: np.ndarray | None = None) -> Path:
    lines = []
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for i, (name, title) in enumerate(titles.items(), 1):
            lines += [f"name#{i}={title}", f"model#{i}=/m/{name}/{name}.obj"]
            if rotation is not None:
                lines.append(f"modelRotation#{i}={' '.join(f'{v:g}' for v in rotation.ravel())}")
            archive.writestr(f"m/{name}/{name}.obj", obj(mesh))
        archive.writestr("PluginFurnitureCatalog.properties", "\n".join(lines))
    return file


def test_sweet_home(tmp_path: Path, truth: trimesh.Trimesh) -> None:
    upright = in_file(truth, "y", "z")
    lying = np.array([(0, 0, 1), (1, 0, 0), (0, 1, 0)], float)  # what the catalogue wants done to the file
    turned = trimesh.Trimesh(upright.vertices @ lying, upright.faces, process=False)
    catalogue(tmp_path / "A.sh3f", {"one": "Kitchen chair", "lamp": "Table lamp"}, upright)
    catalogue(tmp_path / "B.sh3f", {"two": "Chairs", "three": "Corner sofa"}, turned, lying)
    one, two, three = objects(tmp_path)
    assert [(o.data, o.class_name, o.name) for o in (one, two, three)] == [
        ("A", "chair", "one"),
        ("B", "chair", "two"),
        ("B", "sofa", "three"),
    ]
    assert [o.name for o in objects(tmp_path / "B.sh3f", "sofa")] == ["three"]
    for item in (one, two, three):
        assert_is(item.load(), truth)


@pytest.mark.parametrize(
    ("title", "class_name"),
    [
        *(("Wooden teak table", "table"), ("Coffee table", "table"), ("Desk", "table"), ("Desk chair", "chair")),
        *(("Armchair", "chair"), ("Burlap sofa", "sofa"), ("Futon couch", "sofa"), ("Captain's bed", "bed")),
        *(("Vertical shelves", "shelf"), ("Full bookcase", "shelf"), ("Sofa 2 seats", "sofa")),
        *((t, None) for t in ("Pool table", "Football table", "Table lamp", "Table fan", "Towel rack", "Desk lamp")),
        *((t, None) for t in ("Bedside table", "Dressing table", "Table tennis bat", "Armchair ottoman", "Bunk bed")),
        *((t, None) for t in ("Upper shelves cabinet", "Opened convertible sofa BZ", "Baby high chair", "Tablet")),
    ],
)
def test_classes_from_titles(title: str, class_name: str | None) -> None:
    assert sweethome3d_objects.class_of(title) == class_name


def test_damaged_catalogues(tmp_path: Path, truth: trimesh.Trimesh) -> None:
    file = catalogue(tmp_path / "c.sh3f", {"chair": "Chair"}, truth)
    (item,) = objects(file)
    whole = file.read_bytes()
    start = whole.index(b"m/chair/chair.obj") + 40
    file.write_bytes(whole[:start] + bytes(b ^ 255 for b in whole[start : start + 60]) + whole[start + 60 :])
    with pytest.raises(CatalogueError, match=r"chair\.obj is damaged"):
        item.load()
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"not a \.sh3f"):
        item.load()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("readme.txt", "no catalogue")
    with pytest.raises(DataError, match="PluginFurnitureCatalog"):
        objects(file)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.ply", b"ply\nformat ascii 1.0\nelement vert", "damaged"),
        ("a.glb", b"glTF junk", "damaged"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "faces|damaged"),
        ("a.obj", b"", "faces|damaged"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 1 0 1\nf 1 2 3\n", "flat"),
        ("a.obj", b"v nan 0 0\nv 1 0 0\nv 1 0 1\nf 1 2 3\n", "not numbers"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", "damaged"),
    ],
)
def test_damaged_meshes_are_named(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / "chair").mkdir()
    (tmp_path / "chair" / name).write_bytes(content)
    (item,) = objects(tmp_path)
    with pytest.raises(DataError, match=rf"chair.{name}.*({message})"):
        item.load()


def test_wrong_layouts_are_told_what_was_looked_for(tmp_path: Path, truth: trimesh.Trimesh) -> None:
    with pytest.raises(DataError, match="no such"):
        objects(tmp_path / "none")
    with pytest.raises(DataError, match=r"pix3d\.json.*03001627.*sub-folders bed, chair"):
        objects(tmp_path)
    write(tmp_path / "things" / "a.obj", truth)
    with pytest.raises(DataError, match="of which class"):
        objects(tmp_path / "things")
    with pytest.raises(DataError, match="not 'lamp'"):
        objects(tmp_path / "things", "lamp")
    write(tmp_path / "mine" / "chair" / "a.obj", truth)
    with pytest.raises(DataError, match="no bed in it; there is chair"):
        objects(tmp_path / "mine", "bed")


def test_other_folders_are_left_out_with_a_note(
    tmp_path: Path, truth: trimesh.Trimesh, caplog: pytest.LogCaptureFixture
) -> None:
    for folder in ("bench", "bookcase", "Sofas"):
        write(tmp_path / folder / "a.obj", truth)
    with caplog.at_level(logging.INFO, "datasets"):
        assert [o.class_name for o in objects(tmp_path)] == ["shelf", "sofa"]
    assert "bench is left out" in caplog.text
    assert set(CLASSES) == {"bed", "chair", "shelf", "sofa", "table"}


def test_the_contact_sheet(tmp_path: Path, truth: trimesh.Trimesh, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "mine" / "chair" / "a.obj", in_file(truth, "y", "-z"))
    (tmp_path / "mine" / "chair" / "broken.obj").write_text("")
    assert axes.main([str(tmp_path / "mine"), "--picture", str(tmp_path / "out" / "sheet.jpg")]) == 0
    sheet = cv2.imread(str(tmp_path / "out" / "sheet.jpg")).astype(int)
    assert sheet.shape == (40 + axes.CELL + axes.CAPTION, axes.COLUMNS * axes.CELL, 3)
    red = (sheet[..., 2] > 180) & (sheet[..., :2].max(2) < 90)
    rows, columns = np.nonzero(red)
    assert 50 < len(rows) < 2000  # one arrow, low and on the left of the first picture
    assert columns.max() < axes.CELL / 2
    assert rows.min() > 40 + axes.CELL / 2
    assert axes.main([str(tmp_path / "mine")]) == 0
    assert "mine\tchair\ta\t" in capsys.readouterr().out
    assert axes.main([str(tmp_path / "none")]) == 2
    assert "does not exist" in capsys.readouterr().err
