"""Small files that claim to hold much, written by hand: a header's number is checked before memory is taken."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable

from PIL import Image


def png(width: int, height: int, kind: int = 2, bits: int = 8) -> bytes:
    """Zeros as a PNG; kind 0 grey, 2 RGB, 3 palette, 6 RGBA."""
    channels = {0: 1, 2: 3, 3: 1, 6: 4}[kind]
    line = 1 + (width * channels * bits + 7) // 8
    packer, body = zlib.compressobj(1), []
    for start in range(0, height, 64):
        body.append(packer.compress(bytes(line * min(64, height - start))))
    parts = [(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0))]
    parts += [(b"PLTE", bytes(768))] if kind == 3 else []
    parts += [(b"IDAT", b"".join(body) + packer.flush()), (b"IEND", b"")]
    chunks = (struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d)) for n, d in parts)
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def bmp(width: int, height: int) -> bytes:
    head = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, 0, 0, 0, 0, 0)
    return b"BM" + struct.pack("<IHHI", 54, 0, 0, 54) + head + bytes(600)


def tiff(width: int, height: int) -> bytes:
    tags = [(256, 4, width), (257, 4, height), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8)]
    tags += [(277, 3, 1), (278, 4, height), (279, 4, min(width * height, 2**32 - 1))]
    body = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + body + struct.pack("<I", 0) + bytes(400)


def jpeg(width: int, height: int) -> bytes:
    """A real small JPEG whose frame header says another size."""
    out = io.BytesIO()
    Image.new("RGB", (64, 64)).save(out, "JPEG")
    data = bytearray(out.getvalue())
    at = data.index(b"\xff\xc0")
    data[at + 5 : at + 9] = struct.pack(">HH", height, width)
    return bytes(data)


def webp(width: int, height: int) -> bytes:
    """An extended header alone."""
    body = b"VP8X" + struct.pack("<I", 10) + bytes(4)
    body += (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little") + b"VP8L" + struct.pack("<I", 0)
    return b"RIFF" + struct.pack("<I", 4 + len(body)) + b"WEBP" + body


def grey16(side: int) -> bytes:
    return png(side, side, 0, 16)


def npy(shape: str, kind: str = "<f8", body: bytes = bytes(800)) -> bytes:
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(head)) + head + body


def zipped(members: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, data in members.items():
            with archive.open(name, "w", force_zip64=True) as file:
                for start in range(0, len(data), 1 << 24):
                    file.write(data[start : start + (1 << 24)])
    return out.getvalue()


def npz_bomb() -> bytes:
    """1024^3 voxels, none of them filled, in 1 MB."""
    return zipped({"grid.npy": npy("(1024, 1024, 1024)", "|u1", bytes(1 << 30))})


def catalogue_bomb() -> bytes:
    table = b"id#1=a\nname#1=Chair\ncategory#1=Seats\nmodel#1=/a.obj\nwidth#1=44\ndepth#1=45\nheight#1=94\n"
    return zipped({"PluginFurnitureCatalog.properties": table, "a.obj": b"v 0 0 0\n" * (200 << 17)})


def ply(kind: str) -> bytes:
    rows = "property float x\nproperty float y\nproperty float z\n"
    return f"ply\nformat {kind} 1.0\nelement vertex 10000000000\n{rows}end_header\n".encode() + b"1 2 3\n" * 100


def ply_faces() -> bytes:
    rows = "property float x\nproperty float y\nproperty float z\nelement face 9000000000\n"
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex 3\n{rows}property list uchar int vertex_indices\n"
    return head.encode() + b"end_header\n" + bytes(36) + struct.pack("<B3i", 3, 0, 1, 2)


def pcd(kind: str) -> bytes:
    head = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 10000000000\nHEIGHT 1\n"
    return f"{head}VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 10000000000\nDATA {kind}\n".encode() + b"1 2 3\n" * 100


def stl() -> bytes:
    return b"binary".ljust(80) + struct.pack("<I", 2**32 - 1) + bytes(5000)


def off() -> bytes:
    return b"OFF\n9999999999 9999999999 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


def glb() -> bytes:
    """An accessor of 10^10 points."""
    content = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 10**11}],
        "bufferViews": [{"buffer": 0, "byteLength": 10**11}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 10**10, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", 16, b"BIN\0") + bytes(16)
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def binvox() -> bytes:
    return b"#binvox 1\ndim 100000 100000 100000\ntranslate 0 0 0\nscale 1\ndata\n" + b"\0\xff" * 1000


def wide_json() -> bytes:
    """70 MB of nothing."""
    return b'{"frames": [' + b"{}," * (24 << 20) + b"{}]}"


def deep_json() -> bytes:
    return b'{"frames": ' + b"[" * 200_000 + b"]" * 200_000 + b"}"


PICTURES: dict[str, Callable[[], bytes]] = {
    "png of 32000 x 32000": lambda: png(32000, 32000, 0, 8),
    "png of 60000 x 60000 in one bit": lambda: png(60000, 60000, 0, 1),
    "png that claims 2^31 - 1": lambda: _claim_png(),
    "png of 14000 x 14000, four channels": lambda: png(14000, 14000, 6),
    "png of 14000 x 14000, palette": lambda: png(14000, 14000, 3),
    "png of 14000 x 14000, 16 bits of grey": lambda: grey16(14000),
    "png of one row of 60 million": lambda: png(60_000_000, 1, 0),
    "bmp that claims 60000 x 60000": lambda: bmp(60000, 60000),
    "bmp of a negative width": lambda: bmp(-4, 2**31 - 1),
    "tiff that claims 100000 x 100000": lambda: tiff(100_000, 100_000),
    "jpeg that claims 65500 x 65500": lambda: jpeg(65500, 65500),
    "webp that claims 16000 x 16000": lambda: webp(16000, 16000),
}


def _claim_png() -> bytes:
    head = struct.pack(">IIBBBBB", 2**31 - 1, 2**31 - 1, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + b"IHDR" + head + struct.pack(">I", zlib.crc32(b"IHDR" + head))
    return b"\x89PNG\r\n\x1a\n" + chunk + struct.pack(">I", 0) + b"IDAT" + struct.pack(">I", zlib.crc32(b"IDAT"))


SHAPES: dict[str, Callable[[], bytes]] = {
    "npy of 10^10 points": lambda: npy("(10000000000, 3)"),
    "npy of 10^5 cubed voxels": lambda: npy("(100000, 100000, 100000)", "|u1"),
    "npy of negative size": lambda: npy("(-5, 3)"),
    "npy of one number": lambda: npy("()"),
    "npy of one dimension": lambda: npy("(100,)"),
    "npy of text": lambda: npy("(10, 3)", "<U20", bytes(2400)),
    "npy of records": lambda: npy("(10,)").replace(b"'<f8'", b"[('x','<f8')]")[:800],
    "npy of nothing": lambda: npy("(0, 3)"),
    "npy of complex numbers": lambda: npy("(50, 3)", "<c16", bytes(2400)),
    "npy of objects": lambda: npy("(10, 3)", "|O"),
    "npz of 1024^3 voxels": npz_bomb,
    "ply of 10^10 points, binary": lambda: ply("binary_little_endian"),
    "ply of 10^10 points, text": lambda: ply("ascii"),
    "ply of 9 x 10^9 faces": ply_faces,
    "pcd of 10^10 points, text": lambda: pcd("ascii"),
    "pcd of 10^10 points, binary": lambda: pcd("binary"),
    "pcd of 10^10 points, compressed": lambda: pcd("binary_compressed"),
    "stl of 2^32 faces": stl,
    "off of 10^10 points": off,
    "glb of 10^10 points": glb,
    "binvox of 10^15 voxels": binvox,
}
