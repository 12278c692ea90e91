"""Point clouds as scanners, spreadsheets and numpy write them: the right three columns come out, or a reason."""

import io
import struct
import zipfile

import numpy as np
import pytest

from recon.files.recognise import Kind, recognise
from recon.files.shape_files import read_cloud, read_mesh, read_voxels
from recon.scene import InputError
from recon.system import limits
from tests.shape_makers import CHAIR, VERTICES, assert_chair, surface_points


@pytest.fixture
def points(rng):
    return surface_points(rng, 600).round(4)


def rows(table, separator=" ", form="{}"):
    return "".join(separator.join(form.format(v) for v in row) + "\n" for row in table)


def with_commas(text):
    return text.replace(".", ",")


def said_of(path, content):
    """What is said of a file with this content; its points."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    seen = recognise(path)
    assert seen.kind == Kind.CLOUD
    return seen.what, read_cloud(path)


PTX = "30\n20\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"


def text_tables(p):
    """(name, text, what is said) of points p."""
    n = len(p)
    ids, colours = np.arange(1, n + 1), np.random.default_rng(1).integers(0, 256, (n, 3))
    intensity = np.linspace(0, 1, n).round(3)
    yield "spaces", rows(p), ""
    yield "commas", rows(p, ","), ""
    yield "commas and spaces", rows(p, ", "), ""
    yield "tabs", rows(p, "\t"), ""
    yield "decimal commas, semicolons", with_commas(rows(p, ";")), ""
    yield "decimal commas, tabs", with_commas(rows(p, "\t")), ""
    yield "decimal commas, spaces", with_commas(rows(p, "  ")), ""
    yield "a heading", "X;Y;Z\n" + with_commas(rows(p, ";")), ""
    yield "a heading and units", "x [mm],y [mm],z [mm]\n" + rows(p, ","), ""
    yield "ids with names", "id,x,y,z\n" + rows(np.column_stack([ids, p]), ","), "columns 2, 3, 4"
    yield "ids without names", rows([[i, *r] for i, r in zip(ids, p, strict=True)]), "the first counts the rows"
    yield "colours first", rows([[*c, *r] for c, r in zip(colours, p, strict=True)]), "colours come first"
    yield "colours behind", rows([[*r, *c] for c, r in zip(colours, p, strict=True)]), "columns 1, 2, 3"
    named = "//R G B X Y Z\n" + rows([[*c, *r] for c, r in zip(colours, p, strict=True)])
    yield "colours first with names", named, "columns 4, 5, 6 are taken as x, y, z: as its heading names them"
    yield "other order", "z,x,y\n" + rows(p[:, [2, 0, 1]], ","), "columns 2, 3, 1"
    yield "quoted names", '"Points:0","Points:1","Points:2","i"\n' + rows(np.column_stack([p, intensity]), ","), ""
    yield "a count first", f"{n}\n" + rows([[*r, 7, *c] for c, r in zip(colours, p, strict=True)]), "columns 1, 2, 3"
    yield "a scanner's header", PTX + rows(np.column_stack([p, intensity])), "columns 1, 2, 3"
    yield "many comments", "# made\n" * 400 + "; not a row\n\n" + rows(p), ""
    yield "labels behind", rows([[*r, "seat"] for r in p]), "columns 1, 2, 3"
    yield "a mark and carriage returns", "\ufeff" + rows(p).replace("\n", "\r\n"), ""
    yield "exponents", rows(p, " ", "{:.6e}"), ""


@pytest.mark.parametrize("name", [name for name, _, _ in text_tables(np.zeros((9, 3)))])
def test_text(tmp_path, points, name):
    text, words = next((text, words) for n, text, words in text_tables(points) if n == name)
    what, found = said_of(tmp_path / "cloud.dat", text)
    np.testing.assert_allclose(found, points, atol=1e-6)
    assert words in what


def test_text_in_utf_16(tmp_path, points):
    _, found = said_of(tmp_path / "cloud.txt", ("x\ty\tz\n" + with_commas(rows(points, "\t"))).encode("utf-16"))
    np.testing.assert_allclose(found, points)


def test_commas_that_are_both_are_refused(tmp_path, points):
    path = tmp_path / "cloud.csv"
    path.write_text(with_commas(rows(points, ",", "{:.4f}")))
    with pytest.raises(InputError, match="commas both separate its columns and stand in its numbers"):
        recognise(path)


@pytest.mark.parametrize(
    "text",
    [
        "Dear all,\nthis is not a chair.\n" * 9,
        '{"a": [1, 2, 3, 4, 5]}',
        "<a>1 2 3</a>\n" * 9,
        "1 2\n" * 99,
        "a b c 1 2 3 d\n" * 9,
    ],
)
def test_text_that_is_no_cloud(tmp_path, text):
    path = tmp_path / "cloud.txt"
    path.write_text(text)
    with pytest.raises(InputError, match="nothing that can be read"):
        recognise(path)


def test_a_large_text_is_drawn_from_while_it_is_read(tmp_path, points, monkeypatch):
    monkeypatch.setattr(limits, "POINTS", 100)
    monkeypatch.setattr("recon.files.table._PORTION", 5000)
    _, found = said_of(tmp_path / "cloud.txt", "x y z\n" + rows(points))
    assert 98 <= len(found) <= 110
    assert {tuple(r) for r in found} <= {tuple(r) for r in points}


def pcd(
    points, data="ascii", fields="x y z", size="4 4 4", kind="F F F", count="1 1 1", body=None, first="# .PCD v0.7\n"
):
    n = len(points)
    head = f"{first}VERSION 0.7\nFIELDS {fields}\nSIZE {size}\nTYPE {kind}\nCOUNT {count}\nWIDTH {n}\nHEIGHT 1\n"
    head += f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {data}\n"
    return head.encode() + body


def test_pcd(tmp_path, points):
    path = tmp_path / "cloud.dat"
    text = rows(points).encode()
    for first in ("# .PCD v0.7\n", "", "# made\n# by hand\n"):
        np.testing.assert_allclose(said_of(path, pcd(points, body=text, first=first))[1], points)
    for kind in ("f4", "f8"):
        body = points.astype(kind).tobytes()
        found = said_of(path, pcd(points, "binary", size=" ".join([kind[1]] * 3), body=body))[1]
        np.testing.assert_allclose(found, points, atol=1e-6)
    whole = np.rint(points * 10000)
    found = said_of(path, pcd(points, "binary", size="2 4 8", kind="I I I", body=_mixed(whole, ("i2", "i4", "i8"))))[1]
    np.testing.assert_allclose(found, whole)


def _mixed(points, kinds):
    table = np.zeros(len(points), [(a, k) for a, k in zip("xyz", kinds, strict=True)])
    for i, a in enumerate("xyz"):
        table[a] = points[:, i]
    return table.tobytes()


def test_pcd_with_other_fields(tmp_path, points):
    """Colours before, and a histogram of 33 numbers between, in text and binary."""
    path = tmp_path / "cloud.pcd"
    table = np.zeros(len(points), [("rgb", "u4"), ("x", "f4"), ("h", "f4", 33), ("y", "f4"), ("z", "f8")])
    for i, a in enumerate("xyz"):
        table[a] = points[:, i]
    said = {"fields": "rgb x histogram y z", "size": "4 4 4 4 8", "kind": "U F F F F", "count": "1 1 33 1 1"}
    np.testing.assert_allclose(said_of(path, pcd(points, "binary", body=table.tobytes(), **said))[1], points, atol=1e-6)
    text = rows([[7, x, *[0] * 33, y, z] for x, y, z in points]).encode()
    np.testing.assert_allclose(said_of(path, pcd(points, body=text, **said))[1], points)


def lzf(data):
    """Packed as LZF: literal runs, and copies of what came 12 bytes before wherever three bytes agree."""
    out, literal, at = bytearray(), bytearray(), 0

    def flush():
        for i in range(0, len(literal), 32):
            out.extend(bytes([len(literal[i : i + 32]) - 1]) + literal[i : i + 32])
        literal.clear()

    while at < len(data):
        length = 0
        while at >= 12 and length < 264 and at + length < len(data) and data[at + length] == data[at + length - 12]:
            length += 1
        if length >= 3:
            flush()
            code = length - 2
            out.extend(bytes([(min(code, 7) << 5), *([code - 7] if code >= 7 else []), 11]))
            at += length
        else:
            literal.append(data[at])
            at += 1
    flush()
    return bytes(out)


def test_packed_pcd(tmp_path, points):
    """With many equal points, so that copies reach over themselves."""
    path = tmp_path / "cloud.pcd"
    points = np.concatenate([points, np.repeat(points[-1:], 200, 0)])
    data = b"".join(points[:, i].astype("f4").tobytes() for i in range(3))
    small = lzf(data)
    assert len(small) < len(data)
    body = struct.pack("<II", len(small), len(data)) + small
    np.testing.assert_allclose(said_of(path, pcd(points, "binary_compressed", body=body))[1], points, atol=1e-6)
    for harm in (body[:-40], struct.pack("<II", len(small), 1 << 31) + small, body[:8] + b"\xff" * 40):
        path.write_bytes(pcd(points, "binary_compressed", body=harm))
        with pytest.raises(InputError, match=r"cloud\.pcd is a damaged PCD file"):
            read_cloud(path)


def test_pcd_that_claims_too_much(tmp_path, points):
    path = tmp_path / "cloud.pcd"
    for data in ("ascii", "binary", "binary_compressed"):
        content = pcd(points, data, body=rows(points).encode())
        path.write_bytes(content.replace(f"POINTS {len(points)}".encode(), b"POINTS 10000000000"))
        with pytest.raises(InputError, match=r"cloud\.pcd is a damaged PCD file"):
            read_cloud(path)
    path.write_bytes(pcd(points, fields="a b c", body=rows(points).encode()))
    with pytest.raises(InputError, match="without x, y and z, but a, b, c"):
        read_cloud(path)


def saved(path, *arrays, **named):
    """A .npy file of one array, or an .npz file."""
    if arrays:
        with path.open("wb") as file:
            np.save(file, arrays[0], allow_pickle=True)
    else:
        with path.open("wb") as file:
            np.savez_compressed(file, **named)
    return path


def test_arrays_of_points_however_they_lie(tmp_path, points):
    p, ones = points.astype("f4"), np.ones((len(points), 5), "f4")
    fields = np.zeros(len(p), [("intensity", "u1"), ("z", "f4"), ("x", "f8"), ("y", "f4")])
    for i, a in enumerate("xyz"):
        fields[a] = points[:, i]
    path = tmp_path / "cloud.dat"
    arrays = [
        p,
        p.T,
        p[None],
        p.T[None],
        np.asfortranarray(p),
        np.asfortranarray(p.T),
        np.hstack([p, ones]),
        p.astype(">f8"),
    ]
    for array in [*arrays, np.hstack([p, ones]).T, fields, fields[None]]:
        assert recognise(saved(path, array)).kind == Kind.CLOUD, array.shape
        np.testing.assert_allclose(read_cloud(path), points, atol=1e-6, err_msg=str(array.shape))


def test_archives_of_arrays(tmp_path, points, rng):
    path, colours = tmp_path / "cloud.dat", rng.random(points.shape)
    for named in (
        {"colors": colours, "points": points},
        {"normals": colours, "data": points},
        {"label": np.arange(len(points)), "pc": points},
        {"name": np.array("chair"), "rgb": colours, "anything": points[None]},
        {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2], "i": colours[:, 0]},
        {"note": np.array([{}], object), "xyz": points.T},
    ):
        assert recognise(saved(path, **named)).kind == Kind.CLOUD, list(named)
        np.testing.assert_allclose(read_cloud(path), points, err_msg=str(list(named)))
    assert "array 'points'" in recognise(saved(path, colors=colours, points=points)).what
    assert recognise(saved(path, vertices=VERTICES, faces=CHAIR)).what == "a mesh of 72 faces (numpy)"
    assert_chair(read_mesh(path))


@pytest.mark.parametrize(
    ("array", "reason"),
    [
        (np.array(["a", "b"]), "no 3-d voxel grid and no"),
        (np.arange(99.0), "no 3-d voxel grid and no"),
        (np.float64(3), "no 3-d voxel grid and no"),
        (np.array([{}, None], object), "Python objects, which are not read"),
        (np.zeros((5, 700, 3)), "5 sets of 700 points; save one of them"),
        (np.zeros((40, 50, 3), "u1"), "no 3-d voxel grid and no"),
        (np.zeros(9, [("a", "f4"), ("b", "f4")]), "no 3-d voxel grid and no"),
        (np.zeros((300, 300)), "no 3-d voxel grid and no"),
        (np.zeros((9, 9), complex), "no 3-d voxel grid and no"),
    ],
)
def test_arrays_that_are_no_shape(tmp_path, array, reason):
    with pytest.raises(InputError, match=reason):
        recognise(saved(tmp_path / "a.npy", array))


def test_headers_that_claim_too_much(tmp_path):
    path = tmp_path / "a.npy"
    for shape in ((10**10, 3), (3, 10**10), (10**18, 3)):
        head = io.BytesIO()
        np.lib.format.write_array_header_1_0(head, {"descr": "<f4", "fortran_order": False, "shape": shape})
        path.write_bytes(head.getvalue() + bytes(600))
        with pytest.raises(InputError, match="cut short"):
            read_cloud(path)
    path.write_bytes(path.read_bytes().replace(b"(1000000000000000000, 3)", b"(99999, 99999, 9999)    "))
    with pytest.raises(InputError, match="too large"):
        recognise(path)


def test_bits_flipped_in_an_archive(tmp_path, points, rng):
    """Every one is read as before or refused by name."""
    whole = saved(tmp_path / "whole.npz", points=points).read_bytes()
    path, refused, same = tmp_path / "a.npz", 0, 0
    for _ in range(60):
        data = bytearray(whole)
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        path.write_bytes(data)
        try:
            found = read_cloud(path if recognise(path).kind == Kind.CLOUD else tmp_path)
        except InputError as error:
            refused += "a.npz" in str(error)
        else:
            np.testing.assert_array_equal(found, points)
            same += 1
    assert refused + same == 60
    assert refused > 30


def test_a_large_grid_in_a_small_archive_is_made_coarser(tmp_path):
    """1024^3 voxels as 1 MB of zeros and one filled box."""
    path = tmp_path / "a.npz"
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "|u1", "fortran_order": True, "shape": (1024, 1000, 512)})
    layer, box = bytes(1024 * 1000), np.zeros((1000, 1024), np.uint8)
    box[100:200, 512:1024] = 1
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("v.npy", "w") as file,
    ):
        file.write(head.getvalue())
        for z in range(512):
            file.write(box.tobytes() if z >= 256 else layer)
    assert recognise(path).what == "a voxel grid of 1024 x 1000 x 512"
    grid = read_voxels(path)
    expected = np.zeros((256, 250, 128), bool)
    expected[128:, 25:50, 64:] = True
    np.testing.assert_array_equal(grid, expected)


def test_las_and_e57(tmp_path, points):
    laspy, pye57 = pytest.importorskip("laspy"), pytest.importorskip("pye57")
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = points.min(0), [1e-4] * 3
    scan = laspy.LasData(header)
    scan.x, scan.y, scan.z = points.T
    for name in ("a.las", "a.laz"):
        scan.write(str(tmp_path / name))
        assert recognise(tmp_path / name).what == "a point cloud of 600 points (LAS)"
        np.testing.assert_allclose(read_cloud(tmp_path / name), points, atol=1e-4)
    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    for half in (points[:250], points[250:]):
        columns = {f"cartesian{a}": half[:, i] for i, a in enumerate("XYZ")}
        file.write_scan_raw(columns, rotation=np.array([1.0, 0, 0, 0]), translation=np.array([0, 0, 2.0]))
    file.close()
    assert recognise(tmp_path / "a.e57").what == "a point cloud (E57)"
    np.testing.assert_allclose(read_cloud(tmp_path / "a.e57"), points + np.array((0, 0, 2)), atol=1e-5)


@pytest.mark.parametrize("at", [96, 100])
def test_a_las_header_that_claims_much(tmp_path, points, at):
    """Where the points begin, and how many records lie before them: hundreds of millions take minutes to read."""
    laspy = pytest.importorskip("laspy")
    scan = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    scan.x, scan.y, scan.z = points.T
    scan.write(str(tmp_path / "a.las"))
    data = bytearray((tmp_path / "a.las").read_bytes())
    data[at : at + 4] = (800_000_000).to_bytes(4, "little")
    (tmp_path / "a.las").write_bytes(data)
    with pytest.raises(InputError, match=r"a\.las is a damaged LAS file, or cut short; save it again"):
        recognise(tmp_path / "a.las")


def test_scans_without_their_packages(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    path = tmp_path / "a.las"
    path.write_bytes(b"LASF" + bytes(400))
    with pytest.raises(InputError, match=r"needs laspy: pip install \"nnproc-recon\[scans\]\""):
        recognise(path)


def test_extreme_coordinates(tmp_path, points):
    from recon.shapes import shape_target

    path = tmp_path / "a.npy"
    for factor in (1e-12, 1e12):
        np.save(path, points * factor + factor)
        assert np.isfinite(shape_target.run(path, Kind.CLOUD, "points").points).all()
    some = points.copy()
    some[:20] = 1e308
    np.save(path, some)
    assert "20 points that are not numbers" in shape_target.run(path, Kind.CLOUD, "points").warnings[0]
    for wrong, reason in (
        (points * 1e306, "600 of 600 points are not numbers"),
        (points * 0 + 5, "all points lie in one place"),
    ):
        np.save(path, wrong)
        with pytest.raises(InputError, match=reason):
            shape_target.run(path, Kind.CLOUD, "points")


def test_what_a_scanner_writes_where_it_sees_nothing(tmp_path, points):
    """Most of an organised scan may be zeros or no numbers; the rest is the object."""
    from recon.shapes import shape_target

    path = tmp_path / "a.npy"
    for nothing in (0.0, np.nan):
        np.save(path, np.concatenate([points + np.array((0, 0, 1)), np.full((3000, 3), nothing)]))
        target = shape_target.run(path, Kind.CLOUD, "points")
        assert "3,000 points" in target.warnings[0]
        np.testing.assert_allclose(np.ptp(target.points, axis=0), np.ptp(points, axis=0), atol=0.05)
    np.save(path, np.concatenate([points, np.repeat(points[:1], 3000, 0)]))
    target = shape_target.run(path, Kind.CLOUD, "points")
    np.testing.assert_allclose(np.ptp(target.points, axis=0), np.ptp(points, axis=0), atol=0.05)
