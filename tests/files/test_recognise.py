"""What an input is, is told from its content; what cannot be used is refused with a reason."""

import io
import json
import struct
import zipfile

import cv2
import numpy as np
import pytest

from recon.files.recognise import Kind, recognise
from recon.files.shape_files import read_cloud, read_mesh, read_splat, read_voxels
from recon.scene import InputError

TETRAHEDRON = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)
FACES = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])


def ply(path, points, faces=(), extra=(), form="ascii"):
    """A PLY file; `extra` are (name, (n,) values)."""
    names = ["x", "y", "z", *(n for n, _ in extra)]
    table = np.column_stack([points, *(v for _, v in extra)]).astype("<f4")
    head = ["ply", f"format {form} 1.0", f"element vertex {len(points)}", *(f"property float {n}" for n in names)]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices"] if len(faces) else []
    text = "\n".join([*head, "end_header", ""]).encode()
    if form == "ascii":
        rows = [" ".join(map(str, r)) for r in table] + [" ".join(map(str, (3, *f))) for f in faces]
        path.write_bytes(text + "\n".join(rows).encode() + b"\n")
    else:
        path.write_bytes(text + table.tobytes() + b"".join(struct.pack("<B3i", 3, *f) for f in faces))
    return path


def obj(path, points, faces):
    lines = [f"v {x} {y} {z}" for x, y, z in points] + ["f " + " ".join(str(i + 1) for i in f) for f in faces]
    path.write_text("\n".join(lines))
    return path


def stl(path, points, faces):
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *points[list(f)].ravel(), 0) for f in faces)
    path.write_bytes(b"solid but binary".ljust(80) + struct.pack("<I", len(faces)) + body)
    return path


def off(path, points, faces):
    rows = [" ".join(map(str, p)) for p in points] + [" ".join(map(str, (3, *f))) for f in faces]
    path.write_text(f"OFF\n{len(points)} {len(faces)} 0\n" + "\n".join(rows))
    return path


def glb(path, points, faces):
    import trimesh

    trimesh.Trimesh(points, faces, process=False).export(path, file_type="glb")
    return path


def binvox(path, grid):
    flat = grid.transpose(0, 2, 1).ravel()
    runs = b"".join(struct.pack("BB", int(v), 1) for v in flat)
    path.write_bytes(b"#binvox 1\ndim %d %d %d\ntranslate 0 0 0\nscale 1\ndata\n" % grid.shape + runs)
    return path


def pcd(path, points):
    head = (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\n"
    )
    rows = "\n".join(" ".join(map(str, p)) for p in points)
    path.write_text(f"{head}VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA ascii\n{rows}\n")
    return path


@pytest.mark.parametrize(
    ("name", "write"), [("a.obj", obj), ("a.ply", ply), ("a.stl", stl), ("a.off", off), ("a.glb", glb)]
)
def test_meshes_are_recognised_and_read_whatever_they_are_called(tmp_path, name, write):
    path = write(tmp_path / "some.thing", TETRAHEDRON, FACES)
    assert recognise(path).kind == Kind.MESH, name
    surface = read_mesh(path)
    corners = surface.vertices[surface.triangles]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert areas.sum() == pytest.approx(1.5 + np.sqrt(3) / 2, rel=1e-5)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_point_clouds_and_splats(tmp_path, rng, form):
    points = rng.random((60, 3))
    cloud = ply(tmp_path / "cloud.ply", points, form=form)
    assert recognise(cloud).kind == Kind.CLOUD
    assert "60 points" in recognise(cloud).what
    np.testing.assert_allclose(read_cloud(cloud), points, atol=1e-5)
    opacity = np.where(np.arange(60) < 20, 3.0, -3.0)
    splat = ply(
        tmp_path / "s.ply", points, (), [("opacity", opacity), ("scale_0", points[:, 0]), ("rot_0", opacity)], form
    )
    assert recognise(splat).kind == Kind.SPLAT
    np.testing.assert_allclose(read_splat(splat, 0.3), points[:20], atol=1e-5)


def test_clouds_of_other_formats(tmp_path, rng):
    points = rng.random((40, 3)).astype(np.float32)
    np.save(tmp_path / "c.npy", points)
    np.savez(tmp_path / "c.npz", points=points)
    np.savetxt(tmp_path / "c.xyz", np.hstack([points, points]), header="x y z r g b")
    (tmp_path / "c.csv").write_text("x,y,z\n" + "\n".join(",".join(map(str, p)) for p in points))
    for path in (*sorted(tmp_path.iterdir()), pcd(tmp_path / "c.pcd", points)):
        assert recognise(path).kind == Kind.CLOUD, path.name
        np.testing.assert_allclose(read_cloud(path), points, atol=1e-5, err_msg=path.name)


def test_voxel_grids(tmp_path, rng):
    grid = rng.random((6, 6, 6)) < 0.4
    np.savez_compressed(tmp_path / "v.npz", voxels=grid)
    for path in (tmp_path / "v.npz", binvox(tmp_path / "v.binvox", grid)):
        assert recognise(path).kind == Kind.VOXELS
        np.testing.assert_array_equal(read_voxels(path), grid)


def test_pictures_videos_and_folders(tmp_path, rng):
    photo, mask = tmp_path / "p.png", tmp_path / "m.png"
    cv2.imwrite(str(photo), rng.integers(0, 255, (40, 40, 3)).astype(np.uint8))
    cv2.imwrite(str(mask), np.kron(np.eye(2), np.full((20, 20), 255)).astype(np.uint8))
    (tmp_path / "v.bin").write_bytes(b"\0\0\0\x20ftypisom" + bytes(64))
    assert recognise(photo).kind == Kind.IMAGE
    assert recognise(mask).kind == Kind.MASKS
    assert recognise(tmp_path / "v.bin").kind == Kind.VIDEO
    assert recognise(tmp_path).kind == Kind.PHOTOS
    photo.unlink()
    assert recognise(tmp_path).kind == Kind.MASKS
    (tmp_path / "sparse" / "0").mkdir(parents=True)
    for name in ("cameras.txt", "images.txt"):
        (tmp_path / "sparse" / "0" / name).write_text("")
    assert recognise(tmp_path).kind == Kind.CAMERAS
    (tmp_path / "t.json").write_text(json.dumps({"frames": []}))
    assert recognise(tmp_path / "t.json").kind == Kind.CAMERAS


def test_input_wins_over_what_it_looks_like(tmp_path, caplog):
    path = ply(tmp_path / "a.ply", TETRAHEDRON, FACES)
    with caplog.at_level("INFO", "recon"):
        assert recognise(path, "cloud").kind == Kind.CLOUD
    assert "looks like a mesh of 4 faces" in caplog.text
    assert "--input" in caplog.text
    assert len(read_cloud(path)) == 4
    with pytest.raises(InputError, match="kinds: photos, video"):
        recognise(path, "hologram")


def _damaged(tmp_path):
    whole = ply(tmp_path / "whole.ply", np.random.default_rng(0).random((50, 3)), form="binary_little_endian")
    grid = binvox(tmp_path / "whole.binvox", np.ones((4, 4, 4), bool))
    objects = io.BytesIO()
    np.save(objects, np.array([{}, None]), allow_pickle=True)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("chair.blend", "x")
    return {
        "cut.ply": (whole.read_bytes()[:-100], "cut short"),
        "headless.ply": (b"ply\nformat ascii 1.0\n", "header has no end"),
        "cut.binvox": (grid.read_bytes()[:-30], "cut short"),
        "objects.npy": (objects.getvalue(), "Python objects"),
        "cut.npy": (b"\x93NUMPY\x01\x00", "damaged"),
        "catalogue.npz": (archive.getvalue(), "unpack it"),
        "cut.npz": (archive.getvalue()[:20], "a zip file that is damaged or cut short"),
        "empty.obj": (b"", "is empty"),
        "notes.obj": (b"Dear all, this is not a chair.", "nothing that can be read"),
        "pointless.obj": (b"v 0 0 0\nv 1 0 0\nf 1 2 9\n", "damaged"),
        "fake.glb": (b"glTF\x02\0\0\0\xff\xff\xff\xff", "damaged"),
    }


def test_damaged_files_are_refused_with_a_reason(tmp_path):
    readers = {Kind.MESH: read_mesh, Kind.CLOUD: read_cloud, Kind.VOXELS: read_voxels}
    for name, (content, reason) in _damaged(tmp_path).items():
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(InputError, match=reason) as caught:
            readers[recognise(path).kind](path)
        assert name in str(caught.value)


def test_meshes_without_faces_and_splats_without_opacity(tmp_path, rng):
    points = rng.random((30, 3))
    bare = ply(tmp_path / "bare.ply", points)
    with pytest.raises(InputError, match="without faces"):
        read_mesh(bare)  # forced by --input mesh
    splat = ply(tmp_path / "s.ply", points, (), [("scale_0", points[:, 0]), ("rot_0", points[:, 1])])
    assert recognise(splat).kind == Kind.SPLAT
    with pytest.raises(InputError, match="without opacity"):
        read_splat(splat, 0.3)


def test_nothing_there():
    from pathlib import Path

    with pytest.raises(InputError, match="does not exist"):
        recognise(Path("/nowhere/chair.obj"))
