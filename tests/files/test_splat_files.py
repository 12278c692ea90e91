"""Gaussian splats of every format: the same Gaussians come out, to what the format's packing leaves."""

import gzip
import io
import json
import struct
import zipfile

import numpy as np
import pytest
import zstandard
from PIL import Image
from scipy.spatial.transform import Rotation

from recon.files.recognise import Kind, recognise
from recon.files.shape_files import read_cloud, read_gaussians, read_splat
from recon.scene import InputError
from recon.shapes import splat_rendering
from recon.system import limits
from tests.shape_makers import surface_points

COUNT = 600


class Made:
    """Gaussians on a chair."""

    def __init__(self, rng):
        self.centres = surface_points(rng, COUNT).astype("f4").astype(float)
        self.opacity = rng.integers(5, 251, COUNT) / 255
        self.logs = rng.uniform(-6, -3, (COUNT, 3))
        turns = rng.normal(size=(COUNT, 4))
        self.turns = turns / np.linalg.norm(turns, axis=1, keepdims=True)  # w x y z

    @property
    def logits(self):
        return np.log(self.opacity / (1 - self.opacity))


def covariances(sigma, turns):
    R = Rotation.from_quat(turns[:, [1, 2, 3, 0]]).as_matrix() * sigma[:, None]
    return R @ R.transpose(0, 2, 1)


def ply(made):
    names = ["x", "y", "z", "f_dc_0", "opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
    table = np.column_stack([made.centres, np.zeros(COUNT), made.logits, made.logs, made.turns]).astype("<f4")
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {COUNT}",
        *(f"property float {n}" for n in names),
    ]
    return "\n".join([*head, "end_header", ""]).encode() + table.tobytes()


def splat(made):
    rows = np.zeros(COUNT, [("at", "<f4", 3), ("sigma", "<f4", 3), ("colour", "u1", 4), ("turn", "u1", 4)])
    rows["at"], rows["sigma"], rows["colour"][:, 3] = made.centres, np.exp(made.logs), np.rint(made.opacity * 255)
    rows["turn"] = np.clip(np.rint(made.turns * 128 + 128), 0, 255)
    return rows.tobytes()


def ksplat(made, grade, degree=1):
    """Two sections; packed places count from the middles of their buckets of 64."""
    kinds = [("<f4", "<f4"), ("<u2", "<f2"), ("<u2", "<f2")][grade]
    shading = (0, 9, 24)[degree] * (4, 2, 1)[grade]
    row = [
        ("at", kinds[0], 3),
        ("sigma", kinds[1], 3),
        ("turn", kinds[1], 4),
        ("colour", "u1", 4),
        ("more", "u1", shading),
    ]
    heads, bodies, side, bucket = b"", b"", 4.0, 64
    for part in np.array_split(np.arange(COUNT), 2):
        rows, n = np.zeros(len(part), row), len(part)
        full, rest = divmod(n, bucket)
        middles = np.array([made.centres[part[i : i + bucket]].mean(0) for i in range(0, n, bucket)], "<f4")
        mine = middles[np.arange(n) // bucket]
        rows["at"] = (
            made.centres[part] if grade == 0 else np.rint((made.centres[part] - mine) * 32767 / (side / 2) + 32767)
        )
        rows["sigma"], rows["turn"] = np.exp(made.logs[part]), made.turns[part]
        rows["colour"][:, 3] = np.rint(made.opacity[part] * 255)
        head = bytearray(1024)
        struct.pack_into("<4IfH2xI4x2IH", head, 0, n, n, bucket, full + 1, side, 12, 32767, full, 1, degree)
        heads += (
            bytes(head)
            if grade
            else struct.pack("<2I", n, n).ljust(40, b"\0") + struct.pack("<H", degree).ljust(984, b"\0")
        )
        bodies += (struct.pack("<I", rest) + middles.tobytes() if grade else b"") + rows.tobytes()
    start = bytearray(4096)
    struct.pack_into("<4B4IH", start, 0, 0, 1, 0, 0, 2, 2, COUNT, COUNT, grade)
    return bytes(start) + heads + bodies


def smallest_three(turns):
    """The largest part's number, and the others (n, 3) with its sign made positive."""
    largest = np.abs(turns).argmax(1)
    rest = np.array([np.delete(q, i) * np.sign(q[i]) for q, i in zip(turns, largest, strict=True)])
    return largest, rest


def spz(made, version):
    fixed = np.rint(made.centres * 4096).astype(int)
    columns = [np.stack([fixed & 255, fixed >> 8 & 255, fixed >> 16 & 255], 2).astype("u1").tobytes()]
    if version == 1:
        columns = [made.centres.astype("<f2").tobytes()]
    columns += [np.rint(made.opacity * 255).astype("u1").tobytes(), bytes(3 * COUNT)]
    columns.append(np.rint((made.logs + 10) * 16).astype("u1").tobytes())
    xyzw = made.turns[:, [1, 2, 3, 0]]
    if version < 3:
        columns.append(np.rint(xyzw[:, :3] * np.sign(xyzw[:, 3:]) * 127.5 + 127.5).clip(0, 255).astype("u1").tobytes())
    else:
        largest, rest = smallest_three(xyzw)
        words = largest.astype("<u4")
        for part in rest.T:
            words = words << 10 | ((part < 0) << 9) | np.rint(np.abs(part) / np.sqrt(0.5) * 511).astype("<u4")
        columns.append(words.astype("<u4").tobytes())
    columns.append(bytes(9 * COUNT))
    if version < 4:
        return gzip.compress(struct.pack("<4s2I4B", b"NGSP", version, COUNT, 1, 12, 0, 0) + b"".join(columns))
    packed = [zstandard.compress(c) for c in columns]
    table = b"".join(struct.pack("<2Q", len(p), len(c)) for p, c in zip(packed, columns, strict=True))
    return struct.pack("<4s2I4BI12x", b"NGSP", 4, COUNT, 1, 12, 0, len(columns), 32) + table + b"".join(packed)


def compressed_ply(made):
    chunks, words = [], np.zeros((COUNT, 4), "<u4")
    for i in range(0, COUNT, 256):
        part = slice(i, i + 256)
        ends = [(v[part].min(0), v[part].max(0)) for v in (made.centres, made.logs)]
        chunks.append(np.concatenate([ends[0][0], ends[0][1], ends[1][0], ends[1][1]]))
        for column, values, (low, high) in ((0, made.centres, ends[0]), (2, made.logs, ends[1])):
            x, y, z = (np.rint((values[part] - low) / (high - low) * (2047, 1023, 2047))).astype("u4").T
            words[part, column] = x << 21 | y << 11 | z
    largest, rest = smallest_three(made.turns)
    a, b, c = np.rint((rest / np.sqrt(2) + 0.5) * 1023).astype("u4").T
    words[:, 1] = largest.astype("u4") << 30 | a << 20 | b << 10 | c
    words[:, 3] = np.rint(made.opacity * 255).astype("u4")
    ends = [f"property float {end}_{s}{a}" for s in ("", "scale_") for end in ("min", "max") for a in "xyz"]
    head = ["ply", "format binary_little_endian 1.0", f"element chunk {len(chunks)}", *ends, f"element vertex {COUNT}"]
    head += [f"property uint packed_{n}" for n in ("position", "rotation", "scale", "color")]
    return "\n".join([*head, "end_header", ""]).encode() + np.array(chunks, "<f4").tobytes() + words.tobytes()


def sog(made, version):
    def picture(rgba):
        square = np.zeros((25, 24, 4), np.uint8)
        square.reshape(-1, 4)[:COUNT] = rgba
        out = io.BytesIO()
        Image.fromarray(square).save(out, "WEBP", lossless=True, exact=True)
        return out.getvalue()

    logs = np.sign(made.centres) * np.log1p(np.abs(made.centres))
    low, high = logs.min(0), logs.max(0)
    whole = np.rint((logs - low) / (high - low) * 65535).astype(int)
    largest, rest = smallest_three(made.turns)
    opaque = np.full((COUNT, 1), 255)
    book = np.linspace(-6, -3, 256)
    scales = np.rint((made.logs + 6) / 3 * 255).astype(int)
    alpha = made.opacity * 255 if version == 2 else (made.logits + 6) / 12 * 255
    files = {
        "means_l.webp": picture(np.hstack([whole & 255, opaque])),
        "means_u.webp": picture(np.hstack([whole >> 8, opaque])),
        "quats.webp": picture(np.column_stack([np.rint((rest * np.sqrt(2) + 1) * 127.5), 252 + largest])),
        "scales.webp": picture(np.hstack([scales, opaque])),
        "sh0.webp": picture(np.column_stack([np.zeros((COUNT, 3)), np.rint(alpha)])),
    }
    means = {"mins": low.tolist(), "maxs": high.tolist(), "files": ["means_l.webp", "means_u.webp"]}
    meta = {"means": means, "quats": {"files": ["quats.webp"]}}
    if version == 2:
        meta.update(version=2, count=COUNT, scales={"codebook": book.tolist(), "files": ["scales.webp"]})
        meta["sh0"] = {"codebook": [0] * 256, "files": ["sh0.webp"]}
    else:
        means["shape"] = [COUNT, 3]
        meta["scales"] = {"mins": [-6] * 3, "maxs": [-3] * 3, "files": ["scales.webp"]}
        meta["sh0"] = {"mins": [0, 0, 0, -6], "maxs": [1, 1, 1, 6], "files": ["sh0.webp"]}
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in {"meta.json": json.dumps(meta), **files}.items():
            archive.writestr(name, content)
    return out.getvalue()


# What packing leaves of places (of a chair of 0.9), and of covariances (relative).
FORMATS = {
    "ply": (ply, 1e-6, 1e-4),
    "splat": (splat, 1e-6, 0.03),
    "ksplat 0": (lambda made: ksplat(made, 0), 1e-6, 1e-4),
    "ksplat 1": (lambda made: ksplat(made, 1), 1e-4, 0.01),
    "ksplat 2": (lambda made: ksplat(made, 2, 2), 1e-4, 0.01),
    "spz 1": (lambda made: spz(made, 1), 1e-3, 0.2),
    "spz 2": (lambda made: spz(made, 2), 2e-4, 0.2),
    "spz 3": (lambda made: spz(made, 3), 2e-4, 0.1),
    "spz 4": (lambda made: spz(made, 4), 2e-4, 0.1),
    "packed ply": (compressed_ply, 1e-3, 0.02),
    "sog 1": (lambda made: sog(made, 1), 1e-4, 0.05),
    "sog 2": (lambda made: sog(made, 2), 1e-4, 0.05),
}


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_gaussians(tmp_path, rng, name):
    made, (write, far, off) = Made(rng), FORMATS[name]
    path = tmp_path / "splat.dat"
    path.write_bytes(write(made))
    seen = recognise(path)
    assert seen.kind == Kind.SPLAT
    assert "600 Gaussians" in seen.what
    found = read_gaussians(path)
    np.testing.assert_allclose(found.centres, made.centres, atol=far)
    np.testing.assert_allclose(found.opacity, made.opacity, atol=0.03 if name == "sog 1" else 0.003)
    true = covariances(np.exp(made.logs), made.turns)
    wrong = np.linalg.norm(covariances(found.sigma, found.turns) - true, axis=(1, 2)) / np.linalg.norm(
        true, axis=(1, 2)
    )
    assert np.median(wrong) < off
    assert len(splat_rendering.read(path)) == (made.opacity > 1 / 255).sum()
    seen_points = read_splat(path, 0.3)
    assert abs(len(seen_points) - (made.opacity >= 0.3).sum()) < 12
    np.testing.assert_array_equal(read_cloud(path), found.centres)


@pytest.mark.parametrize("name", [n for n in FORMATS if n != "splat"])
def test_splats_that_are_cut_are_refused(tmp_path, rng, name):
    whole = FORMATS[name][0](Made(rng))
    path = tmp_path / "splat.dat"
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(InputError, match=r"splat\.dat"):
        read_splat(path, 0.3)


def test_headers_that_claim_too_much(tmp_path, rng):
    path, made = tmp_path / "splat.dat", Made(rng)
    claims = gzip.decompress(spz(made, 3))
    path.write_bytes(gzip.compress(claims[:8] + struct.pack("<I", 2**31) + claims[12:]))
    with pytest.raises(InputError, match="claims 2,147,483,648 Gaussians"):
        recognise(path)
    path.write_bytes(gzip.compress(claims[:4] + struct.pack("<I", 9) + claims[8:]))
    with pytest.raises(InputError, match="version 9, which is not read here; save it as PLY"):
        recognise(path)
    start = bytearray(ksplat(made, 0))
    start[16:20] = struct.pack("<I", 10**9)
    path.write_bytes(start)
    with pytest.raises(InputError, match=r"promises 1,000,000,000 Gaussians .* save it as PLY"):
        recognise(path)
    path.write_bytes(sog(made, 2).replace(b'"count": 600', b'"count": 9e9'))
    with pytest.raises(InputError, match=r"splat\.dat"):
        recognise(path)


def test_a_large_splat_is_drawn_from(tmp_path, rng, monkeypatch):
    monkeypatch.setattr(limits, "GAUSSIANS", 100)
    path = tmp_path / "splat.dat"
    for write in (ply, splat):
        path.write_bytes(write(Made(rng)))
        assert recognise(path).what.startswith("a Gaussian splat of 600 Gaussians, 100 of them used")
        assert len(read_cloud(path)) == 100
