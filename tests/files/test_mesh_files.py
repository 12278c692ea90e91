"""Meshes as programs write them: the same chair comes out of every dialect."""

import struct
import zipfile

import numpy as np
import pytest
import trimesh

from recon.files.recognise import Kind, recognise
from recon.files.shape_files import read_cloud, read_mesh, ups_of
from recon.scene import InputError
from tests.shape_makers import CHAIR, CHAIR_QUADS, VERTICES, assert_chair

CORNERS = VERTICES[CHAIR]


def vertex_lines(form="v {} {} {}"):
    return [form.format(*row) for row in VERTICES.round(4)]


def face_lines(form="{}"):
    return ["f " + " ".join(form.format(i + 1) for i in face) for face in CHAIR]


def joined(*lines, end="\n"):
    return end.join([*lines, ""])


def box_lines(i):
    """One box's corners, then its faces, which count back from the last corner."""
    faces = ["f " + " ".join(str(c - 8 * i - 8) for c in f) for f in CHAIR[12 * i : 12 * i + 12]]
    return [*vertex_lines()[8 * i : 8 * i + 8], *faces]


PLAIN = joined(*vertex_lines(), *face_lines())
OBJ = {
    "plain": PLAIN,
    "mark": "\ufeff# made by an editor\n" + PLAIN,
    "carriage returns": PLAIN.replace("\n", "\r"),
    "both line ends": PLAIN.replace("\n", "\r\n"),
    "indented, tabs": joined(*(f"  \t{line}" for line in PLAIN.splitlines())).replace("v ", "v\t"),
    "continued": joined(*vertex_lines("v {} \\\n {} \\\n{}"), *(f.replace(" ", " \\\n", 2) for f in face_lines())),
    "long comments": "# licence text that says very little, but is long\n" * 3000 + PLAIN,
    "unknown words": joined("newthing 1 2", "call x.mod", *vertex_lines(), "shadow_obj a", *face_lines(), "end of it"),
    "counted back": joined(*(line for i in range(6) for line in box_lines(i))),
    "colours": joined(*vertex_lines("v {} {} {} 0.1 0.2 0.3"), *face_lines()),
    "weights": joined(*vertex_lines("v {} {} {} 1.0"), *face_lines()),
    "slashes": joined(
        *vertex_lines(),
        "vt 0 0",
        "vn 0 0 1",
        *face_lines("{}/1/1")[:30],
        *face_lines("{}//1")[30:50],
        *face_lines("{}/1")[50:],
    ),
    "quads": joined(*vertex_lines(), *("f " + " ".join(str(i + 1) for i in q) for q in CHAIR_QUADS)),
    "names with spaces": joined(
        "mtllib my file.mtl", "o the chair", "g a b c", *vertex_lines(), "usemtl old oak", *face_lines()
    ),
    "decimal commas": joined(*vertex_lines()).replace(".", ",") + joined(*face_lines()),
    "commas between": joined(*vertex_lines("v {}, {}, {}"), *face_lines()),
    "comments behind": joined(*vertex_lines("v {} {} {} # a corner"), *(f + " # a face" for f in face_lines())),
    "faces first": joined(*face_lines(), *vertex_lines()),
    "lines and points too": joined(*vertex_lines(), "l 1 2 3", "p 4", *face_lines()),
}


@pytest.mark.parametrize("name", OBJ)
def test_obj(tmp_path, name):
    path = tmp_path / "chair.dat"
    path.write_bytes(OBJ[name].encode())
    seen = recognise(path)
    assert seen.kind == Kind.MESH
    assert f"a mesh of {36 if name == 'quads' else 72} faces" in seen.what
    assert_chair(read_mesh(path))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "latin-1"])
def test_obj_in_other_encodings(tmp_path, encoding):
    path = tmp_path / "chair.obj"
    text = ("\ufeff" if encoding == "utf-16-be" else "") + "# Stühle\no Stühlchen\n" + PLAIN
    path.write_bytes(text.encode(encoding))
    assert_chair(read_mesh(path))


def test_an_obj_larger_than_a_portion(tmp_path, monkeypatch):
    """Counted back faces and continued lines at every place where the file may be cut."""
    for portion in (997, 1024, 1500):
        monkeypatch.setattr("recon.files.obj._PORTION", portion)
        for name in ("counted back", "continued", "both line ends", "carriage returns"):
            path = tmp_path / "chair.obj"
            path.write_bytes(OBJ[name].encode())
            assert_chair(read_mesh(path))


def test_parts_of_an_obj_are_counted_and_points_are_a_cloud(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("o a\n" + PLAIN + "o b\n")
    assert recognise(path).what == "a mesh of 72 faces in 2 parts (OBJ)"
    path.write_text(joined(*vertex_lines()))
    assert recognise(path).kind == Kind.CLOUD
    np.testing.assert_allclose(read_cloud(path), VERTICES, atol=1e-4)
    path.write_text("v 1 2\nv 3 4\nf 1 2 1\n")
    with pytest.raises(InputError, match="a vertex has fewer than three numbers"):
        read_mesh(path)


def stl_text(before="solid chair", after="endsolid chair"):
    rows = []
    for triangle in CORNERS:
        rows += [" facet normal 0 0 0", "  outer loop"]
        rows += ["   vertex " + " ".join(f"{x:.6e}" for x in corner) for corner in triangle]
        rows += ["  endloop", " endfacet"]
    return joined(before, *rows, after)


STL = {
    "plain": stl_text(),
    "capitals": stl_text().upper(),
    "end solid": stl_text(after="end solid chair"),
    "no end": stl_text(after=""),
    "no name": stl_text("solid", "endsolid"),
    "a long name": stl_text("solid " + "x" * 5000),
    "carriage returns": stl_text().replace("\n", "\r\n"),
    "indented": "\n  " + stl_text(),
    "decimal commas": stl_text().replace(".", ","),
    "two solids": stl_text(after="endsolid a\nsolid b\nendsolid b"),
}


@pytest.mark.parametrize("name", STL)
def test_stl_in_text(tmp_path, name):
    path = tmp_path / "chair.dat"
    path.write_text(STL[name])
    assert recognise(path).what == "a mesh of 72 faces (STL, text)"
    assert_chair(read_mesh(path))
    assert ups_of(path)[0] == "z"


def stl_binary(head=b"made here", count=72, after=b""):
    normals = np.cross(CORNERS[:, 1] - CORNERS[:, 0], CORNERS[:, 2] - CORNERS[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rows = b"".join(struct.pack("<12fH", *n, *t.ravel(), 7) for n, t in zip(normals, CORNERS, strict=True))
    return head.ljust(80, b" ")[:80] + struct.pack("<I", count) + rows + after


@pytest.mark.parametrize(
    "content",
    [
        stl_binary(),
        stl_binary(b"solid exported binary"),
        stl_binary(after=b"\0" * 17),
        stl_binary(after=b"a footer of more bytes than a triangle has, and no triangle at all" * 2),
        stl_binary(count=0),
        stl_binary(count=71),
        stl_binary(count=1000),
        stl_binary(count=2**32 - 1),
    ],
    ids=["plain", "solid", "trailing", "footer", "count 0", "count low", "count high", "count unknown"],
)
def test_stl_in_binary(tmp_path, content):
    path = tmp_path / "chair.dat"
    path.write_bytes(content)
    assert recognise(path).what == "a mesh of 72 faces (STL)"
    assert_chair(read_mesh(path))


def test_a_binary_stl_cut_inside_a_triangle(tmp_path):
    path = tmp_path / "chair.stl"
    path.write_bytes(stl_binary()[:-70])
    with pytest.raises(InputError, match="70 faces, its header promises 72"):
        recognise(path)


def ply(form="ascii", order="", place=("x", "y", "z"), kind="float", comments=(), faces="quads", extra=()):
    """A PLY file's bytes. faces: quads, mixed, strips; extra: an element before the vertices, in (name, rows)."""
    np_kind = {"float": "f4", "double": "f8"}[kind]
    sign = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    polygons = {"quads": list(CHAIR_QUADS), "mixed": [*CHAIR_QUADS[:20], *CHAIR[40:]]}.get(faces, [])
    head = ["ply", f"format {form} 1.0", *comments[:1]]
    head += ["element note 1", "property list uchar int numbers"] if extra else []
    head += [f"element vertex {len(VERTICES)}", *(f"property {kind} {p}" for p in place), "property uchar red"]
    if faces == "strips":
        head += ["element tristrips 1", "property list int int vertex_indices"]
    else:
        head += [
            f"element face {len(polygons)}",
            "property list uchar int vertex_indices",
            "property list uchar float uv",
        ]
    text = joined(*head, *comments[1:], "end_header")
    strip = [i for t in CHAIR for i in (*t, -1)]
    if form == "ascii":
        rows = ["2 7 8"] if extra else []
        rows += [f"{x:.5f} {y:.5f} {z:.5f} 255" for x, y, z in VERTICES]
        rows += [f"{len(strip)} " + " ".join(map(str, strip))] if faces == "strips" else []
        rows += [f"{len(p)} " + " ".join(map(str, p)) + " 2 0.5 0.5" for p in polygons]
        return (text + joined(*rows)).encode()
    out = struct.pack(f"{sign}B2i", 2, 7, 8) if extra else b""
    table = np.zeros(len(VERTICES), [("at", sign + np_kind, 3), ("red", "u1")])
    table["at"] = VERTICES
    out += table.tobytes()
    if faces == "strips":
        out += struct.pack(f"{sign}{len(strip) + 1}i", len(strip), *strip)
    for p in polygons:
        out += struct.pack(f"{sign}B{len(p)}iB2f", len(p), *map(int, p), 2, 0.5, 0.5)
    return text.encode() + out


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"place": ("X", "Y", "Z"), "comments": ("comment one", "comment the last", "obj_info num 3")},
        {"faces": "mixed"},
        {"faces": "strips"},
        {"extra": True},
        {"kind": "double"},
    ],
    ids=["plain", "capitals and comments", "mixed", "strips", "lists before", "doubles"],
)
def test_ply(tmp_path, form, options):
    path = tmp_path / "chair.dat"
    path.write_bytes(ply(form, **options))
    assert recognise(path).kind == Kind.MESH
    assert_chair(read_mesh(path))


def test_ply_with_other_line_ends(tmp_path):
    path = tmp_path / "chair.ply"
    for end in (b"\r\n", b"\r"):
        head, _, body = ply("binary_little_endian").partition(b"end_header\n")
        path.write_bytes(head.replace(b"\n", end) + b"end_header" + end + body)
        assert_chair(read_mesh(path))


def test_ply_cut_short_or_claiming_too_much(tmp_path):
    path = tmp_path / "chair.ply"
    for form in ("ascii", "binary_little_endian"):
        for faces in ("quads", "mixed"):
            path.write_bytes(ply(form, faces=faces)[:-90])
            with pytest.raises(InputError, match=r"chair\.ply is a damaged PLY file"):
                read_mesh(path)
    path.write_bytes(ply().replace(b"element face 36", b"element face 10000000000"))
    with pytest.raises(InputError, match=r"10,000,000,000 faces or vertices, more than the 20,000,000"):
        recognise(path)
    path.write_bytes(ply("binary_little_endian").replace(b"element vertex 48", b"element vertex 10000000"))
    with pytest.raises(InputError, match="cut short"):
        read_mesh(path)


@pytest.mark.parametrize("ending", ["3mf", "off", "glb"])
def test_what_trimesh_writes(tmp_path, ending):
    path = tmp_path / "chair.dat"
    trimesh.Trimesh(VERTICES, CHAIR, process=False).export(path, file_type=ending)
    assert recognise(path).kind == Kind.MESH
    assert_chair(read_mesh(path))


DAE = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="{count}">{places}</float_array><technique_common>
<accessor source="#pa" count="{rows}" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{faces}"><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node>
<translate>0 0 -0.5</translate><node><translate>0 0 1.5</translate><scale>2 2 2</scale><instance_geometry url="#g"/>
</node></node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def test_collada_with_nodes(tmp_path):
    path = tmp_path / "chair.xml"
    half = (VERTICES - (0, 0, 1)) / 2
    numbers = {"count": half.size, "rows": len(half), "faces": len(CHAIR)}
    path.write_text(
        DAE.format(places=" ".join(map(str, half.ravel())), corners=" ".join(map(str, CHAIR.ravel())), **numbers)
    )
    assert recognise(path).what == "a mesh (COLLADA)"
    assert_chair(read_mesh(path))


def test_a_zip_bomb_of_3mf(tmp_path):
    path = tmp_path / "chair.3mf"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("3D/3dmodel.model", "w") as file:
        for _ in range(400):
            file.write(bytes(1 << 20))
    with pytest.raises(InputError, match="larger than the 300 MB that are read of 3MF"):
        recognise(path)


BLENDER = """
import sys, bpy, numpy as np
sys.path.insert(0, sys.argv[1])
from tests.shape_makers import VERTICES, CHAIR
bpy.ops.wm.read_factory_settings(use_empty=True)
mesh = bpy.data.meshes.new("chair")
mesh.from_pydata((VERTICES + (1, 0, 0)).tolist(), [], CHAIR.tolist())
placed = bpy.data.objects.new("chair", mesh)
placed.location = (-1, 0, 0)
bpy.context.collection.objects.link(placed)
folder = sys.argv[2]
bpy.ops.wm.usd_export(filepath=folder + "/chair.usda")
bpy.ops.wm.usd_export(filepath=folder + "/chair.usdc")
bpy.ops.wm.usd_export(filepath=folder + "/chair.usdz")
bpy.ops.wm.alembic_export(filepath=folder + "/chair.abc", as_background_job=False)
bpy.ops.export_scene.fbx(filepath=folder + "/chair.fbx")
bpy.ops.wm.save_as_mainfile(filepath=folder + "/chair.blend", compress=True)
"""


@pytest.mark.slow
def test_what_blender_writes(tmp_path):
    """USD (three ways), Alembic, FBX and .blend: in metres, Z up."""
    import subprocess
    import sys
    from pathlib import Path

    here = str(Path(__file__).parents[2])
    subprocess.run([sys.executable, "-c", BLENDER, here, str(tmp_path)], check=True, capture_output=True, timeout=300)
    for ending in ("usda", "usdc", "usdz", "abc", "fbx", "blend"):
        path = tmp_path / f"chair.{ending}"
        if ending != "blend":
            path = path.rename(tmp_path / f"{ending}.dat")
        assert recognise(path).kind == Kind.MESH, ending
        assert_chair(read_mesh(path))
    cut = tmp_path / "cut.fbx"
    cut.write_bytes((tmp_path / "fbx.dat").read_bytes()[:2000])
    with pytest.raises(InputError, match=r"cut\.fbx .*; export the mesh as GLB or OBJ"):
        read_mesh(cut)


@pytest.mark.parametrize("link", ["../other.usda", "/tmp/other.usd", "https://example.org/other.usdz"])
def test_usd_that_draws_on_files_outside_its_folder(tmp_path, link):
    path = tmp_path / "chair.usda"
    path.write_text(f'#usda 1.0\ndef Xform "a" (references = @{link}@) {{}}\n')
    assert recognise(path).kind == Kind.MESH
    with pytest.raises(InputError, match="outside its folder and is not followed"):
        read_mesh(path)


@pytest.mark.parametrize(
    ("content", "advice"),
    [
        (b"ISO-10303-21;\nHEADER;\n", "a STEP file"),
        (b"#VRML V2.0 utf8\n", "a VRML or X3D file"),
        (b"\xff\xfe\xff\x0e" + "SketchUp Model".encode("utf-16-le"), "a SketchUp file"),
        (b"AC1032" + bytes(40), "a DWG drawing"),
        (b"7z\xbc\xaf\x27\x1c" + bytes(40), "unpack it"),
    ],
)
def test_formats_that_are_known_and_not_read(tmp_path, content, advice):
    path = tmp_path / "chair.dat"
    path.write_bytes(content)
    with pytest.raises(InputError, match=advice):
        recognise(path)


def test_a_mesh_of_too_many_vertices_is_not_thinned_but_refused(tmp_path, monkeypatch):
    """Faces would name other vertices."""
    monkeypatch.setattr("recon.system.limits.FACES", 40)
    path = tmp_path / "chair.dat"
    for content in (ply(), ply("binary_little_endian", faces="strips")):
        path.write_bytes(content)
        with pytest.raises(InputError, match="48 faces or vertices, more than the 40"):
            recognise(path)
    with path.open("wb") as file:
        np.savez(file, vertices=VERTICES, faces=CHAIR)
    with pytest.raises(InputError, match="72 faces or vertices, more than the 40"):
        recognise(path)
