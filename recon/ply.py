"""PLY files: the header, and every property of the vertices (a splat's opacities are some).

trimesh and open3d read positions and colours alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.scene import InputError

_PLY_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"},
    **{"double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float32": "f4", "float64": "f8"},
}


@dataclass(frozen=True)
class PlyHeader:
    """A PLY file's header: numbers of vertices and faces, the vertices' (name, numpy type), format, where data begin.

    plain is False when the vertices do not come first or hold lists; they are then left to the mesh reader.
    """

    vertices: int
    faces: int
    properties: tuple[tuple[str, str], ...]
    form: str
    offset: int
    plain: bool


def ply_header(path: Path) -> PlyHeader:
    """The header. Raises InputError when it is damaged."""
    with path.open("rb") as file:
        head = file.read(1 << 16)
    end = head.find(b"end_header")
    if end < 0:
        raise InputError(f"{path} is a damaged PLY file: its header has no end")
    offset = head.find(b"\n", end) + 1
    counts: dict[str, int] = {}
    properties: list[tuple[str, str]] = []
    form, plain, order = "", True, []
    try:
        for line in head[:end].decode("ascii", "replace").splitlines():
            words = line.split()
            if words[:1] == ["format"]:
                form = words[1]
            elif words[:1] == ["element"]:
                order.append(words[1])
                counts[words[1]] = int(words[2])
            elif words[:1] == ["property"] and order == ["vertex"]:
                plain = plain and words[1] != "list"
                properties.append((words[-1], _PLY_TYPES.get(words[1], "f4")))
    except (IndexError, ValueError) as error:
        raise InputError(f"{path} is a damaged PLY file ({error})") from error
    if form not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise InputError(f"{path} is a PLY file of unknown format {form!r}; save it as binary or ascii")
    faces = counts.get("face", 0) + counts.get("tristrips", 0)
    plain = plain and order[:1] == ["vertex"] and len({n for n, _ in properties}) == len(properties)
    return PlyHeader(counts.get("vertex", 0), faces, tuple(properties), form, offset, plain)


def ply_vertices(path: Path) -> dict[str, np.ndarray]:
    """Every vertex property as (n,) float. Raises InputError when the file is cut short or has no x, y, z."""
    header = ply_header(path)
    names = [n for n, _ in header.properties]
    if not header.plain or not {"x", "y", "z"} <= set(names):
        raise InputError(f"{path}: its vertices have no plain x, y and z; save the points again as PLY")
    try:
        if header.form == "ascii":
            with path.open("rb") as file:
                file.seek(header.offset)
                table = np.loadtxt(file, max_rows=header.vertices, ndmin=2) if header.vertices else np.zeros((0, 3))
            columns = {n: table[:, i].astype(float) for i, n in enumerate(names)} if len(table) else {}
        else:
            order = "<" if "little" in header.form else ">"
            kind = np.dtype([(n, order + t) for n, t in header.properties])
            if path.stat().st_size - header.offset < header.vertices * kind.itemsize:
                raise ValueError("fewer points than its header promises")
            records: np.ndarray = np.fromfile(path, kind, header.vertices, offset=header.offset)
            columns = {n: np.asarray(records[n], float) for n in names}
    except (ValueError, IndexError) as error:
        raise InputError(f"{path} is damaged or cut short ({error}); export it again") from error
    if len(next(iter(columns.values()), ())) < header.vertices:
        raise InputError(f"{path} is cut short: fewer points than the {header.vertices:,} its header promises")
    return columns or {n: np.zeros(0) for n in names}
