"""Catalogues: what is listed, what is written, and what a hostile or broken archive cannot do."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from datasets import sweethome3d
from datasets.sweethome3d import CatalogueError

PROPERTIES = """# a comment
id=Test
license=CC0
name#1=Plain chair
model#1=/models/chair/chair.obj
width#1=44.1
depth#1=45
height#1=94.8
creator#1=Somebody
name#7=Turned stool
model#7=/models/stool.obj
modelRotation#7=1 0 0 0 0 1 0 -1 0
"""
OBJ = b"mtllib chair.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"
MTL = b"newmtl a\nmap_Kd -s 1 1 1 wood.jpg\nnewmtl b\r\nmap_Kd my cloth.jpg\r\nbump deep/bump.png\nmap_Ks gone.jpg\n"


def write_catalogue(path: Path, files: dict[str, bytes] | None = None, properties: str = PROPERTIES) -> Path:
    members = {
        "PluginFurnitureCatalog.properties": properties.encode("latin-1"),
        "models/chair/chair.obj": OBJ,
        "models/chair/chair.mtl": MTL,
        "models/chair/wood.jpg": b"wood",
        "models/chair/my cloth.jpg": b"cloth",
        "models/chair/deep/bump.png": b"bump",
        "models/chair/unused.bin": b"unused",
        "models/stool.obj": b"v 0 0 0\n",
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in {**members, **(files or {})}.items():
            archive.writestr(name, data)
    return path


def test_lists_the_models_in_order(tmp_path: Path) -> None:
    chair, stool = sweethome3d.read_catalogue(write_catalogue(tmp_path / "c.sh3f"))
    assert (chair.name, chair.title, chair.creator, chair.licence) == ("chair", "Plain chair", "Somebody", "CC0")
    assert chair.size == (44.1, 45.0, 94.8)
    assert chair.rotation == (1, 0, 0, 0, 1, 0, 0, 0, 1)
    assert stool.rotation == (1, 0, 0, 0, 0, 1, 0, -1, 0)


def test_extracts_what_the_model_refers_to(tmp_path: Path) -> None:
    path = write_catalogue(tmp_path / "c.sh3f")
    obj = sweethome3d.extract_model(path, sweethome3d.find_model(path, "chair"), tmp_path / "out")
    assert obj == tmp_path / "out" / "chair.obj"
    assert obj.read_bytes() == OBJ
    written = {p.relative_to(tmp_path / "out").as_posix() for p in (tmp_path / "out").rglob("*") if p.is_file()}
    assert written == {"chair.obj", "chair.mtl", "wood.jpg", "my cloth.jpg", "deep/bump.png"}


@pytest.mark.parametrize("reference", ["../../../evil.txt", "/evil.txt", "..\\..\\..\\evil.txt"])
def test_a_reference_cannot_climb_out(tmp_path: Path, reference: str) -> None:
    mtl = f"newmtl a\nmap_Kd {reference}\n".encode()
    evil = {"../evil.txt": b"evil", "/evil.txt": b"evil", "evil.txt": b"evil", "models/chair/chair.mtl": mtl}
    path = write_catalogue(tmp_path / "c.sh3f", evil)
    out = tmp_path / "a" / "b" / "out"
    sweethome3d.extract_model(path, sweethome3d.find_model(path, "chair"), out)
    assert {p.name for p in tmp_path.rglob("*") if p.is_file()} == {"c.sh3f", "chair.obj", "chair.mtl"}


def test_a_model_path_cannot_climb_out(tmp_path: Path) -> None:
    properties = "model#1=/../../evil.obj\nname#1=x\n"
    path = write_catalogue(tmp_path / "c.sh3f", {"../../evil.obj": b"v 0 0 0\n"}, properties)
    out = tmp_path / "a" / "b"
    sweethome3d.extract_model(path, sweethome3d.find_model(path, "evil"), out)
    assert [p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("evil*")] == ["a/b/evil.obj"]


def test_absurd_sizes_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_catalogue(tmp_path / "c.sh3f", {"models/chair/wood.jpg": b"\0" * 5000})
    model = sweethome3d.find_model(path, "chair")
    monkeypatch.setattr(sweethome3d, "MAX_FILE", 4000)
    with pytest.raises(CatalogueError, match=r"wood\.jpg"):
        sweethome3d.extract_model(path, model, tmp_path / "out")
    monkeypatch.setattr(sweethome3d, "MAX_FILE", 6000)
    monkeypatch.setattr(sweethome3d, "MAX_MODEL", 5000)
    with pytest.raises(CatalogueError, match=r"wood\.jpg: more than 0 MB of files"):
        sweethome3d.extract_model(path, model, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_unknown_name_is_answered_with_near_ones(tmp_path: Path) -> None:
    path = write_catalogue(tmp_path / "c.sh3f")
    with pytest.raises(CatalogueError, match=r"no model 'chai'; there are chair$"):
        sweethome3d.find_model(path, "chai")
    with pytest.raises(CatalogueError, match="chair, stool"):
        sweethome3d.find_model(path, "zebra")


def test_broken_catalogues_are_named(tmp_path: Path) -> None:
    with pytest.raises(CatalogueError, match="no such file"):
        sweethome3d.read_catalogue(tmp_path / "none.sh3f")
    (tmp_path / "text.sh3f").write_text("not a zip")
    with pytest.raises(CatalogueError, match=r"not a \.sh3f"):
        sweethome3d.read_catalogue(tmp_path / "text.sh3f")
    with zipfile.ZipFile(tmp_path / "empty.sh3f", "w"):
        pass
    with pytest.raises(CatalogueError, match="PluginFurnitureCatalog"):
        sweethome3d.read_catalogue(tmp_path / "empty.sh3f")
    path = write_catalogue(tmp_path / "turn.sh3f", properties="model#1=/a.obj\nmodelRotation#1=1 0\n")
    with pytest.raises(CatalogueError, match="nine numbers"):
        sweethome3d.read_catalogue(path)
    path = write_catalogue(tmp_path / "lost.sh3f", properties="model#1=/lost.obj\n")
    with pytest.raises(CatalogueError, match=r"lost\.obj"):
        sweethome3d.extract_model(path, sweethome3d.find_model(path, "lost"), tmp_path / "out")


def test_a_damaged_member_is_named(tmp_path: Path) -> None:
    long = OBJ + b"".join(b"v %d 0 %d\n" % (i, i * i) for i in range(200))
    path = write_catalogue(tmp_path / "c.sh3f", {"models/chair/chair.obj": long})
    model = sweethome3d.find_model(path, "chair")
    assert sweethome3d.read_obj(path, model) == long
    with zipfile.ZipFile(path) as archive:
        start = archive.getinfo(model.member).header_offset + 30 + len(model.member)
    whole = path.read_bytes()
    for damage in (b"\xff" * 40, b"\0" * 40):  # no deflate stream at all, and one that gives other bytes
        path.write_bytes(whole[:start] + damage + whole[start + 40 :])
        with pytest.raises(CatalogueError, match=r"chair\.obj is damaged"):
            sweethome3d.read_obj(path, model)


def test_a_bomb_is_refused_whatever_size_it_declares(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bomb = b"v 0 0 0\n" * 100_000
    path = write_catalogue(tmp_path / "c.sh3f", {"models/stool.obj": bomb})
    model = sweethome3d.find_model(path, "stool")
    assert path.stat().st_size < len(bomb) / 50
    monkeypatch.setattr(sweethome3d, "MAX_FILE", len(bomb) // 2)
    with pytest.raises(CatalogueError, match=r"stool\.obj: .* MB unpacked"):
        sweethome3d.read_obj(path, model)
    declared = len(bomb).to_bytes(4, "little")
    path.write_bytes(path.read_bytes().replace(declared, (100).to_bytes(4, "little")))
    with pytest.raises(CatalogueError, match=r"stool\.obj is damaged"):
        sweethome3d.read_obj(path, model)
