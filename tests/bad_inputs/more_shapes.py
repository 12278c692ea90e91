"""Good inputs of formats that other programs write: packed splats, laser scans, scenes."""

from __future__ import annotations

import gzip
import struct
import zipfile
from pathlib import Path

import laspy
import numpy as np
import pye57
import trimesh

_DAE = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>
<up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a"
count="{numbers}">{corners}</float_array><technique_common><accessor source="#a" count="{count}" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>
</source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="{faces}">
<input semantic="VERTEX" source="#v" offset="0"/><p>{indices}</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
_USD = '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Z"\n)\ndef Mesh "chair"\n{{\n'
_USD += "    point3f[] points = [{points}]\n    int[] faceVertexCounts = [{counts}]\n"
_USD += "    int[] faceVertexIndices = [{indices}]\n}}\n"
_3MF = '<?xml version="1.0"?><model unit="meter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
_3MF += '<resources><object id="1" type="model"><mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles>'
_3MF += '</mesh></object></resources><build><item objectid="1"/></build></model>'
_TYPES = '<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types"/>'


def write(mesh: trimesh.Trimesh, points: np.ndarray, folder: Path) -> dict[str, tuple[str, bool]]:
    """Make a folder for each format; returns its file and whether that is text, by the folder's name."""
    texts = {"mesh-dae": ("a.dae", _dae(mesh)), "mesh-usda": ("a.usda", _usd(mesh))}
    data = {"splat-packed": ("a.splat", _splat(points)), "splat-spz": ("a.spz", _spz(points))}
    data |= {name: (file, text.encode()) for name, (file, text) in texts.items()}
    for name, (file, content) in data.items():
        (folder / name).mkdir()
        (folder / name / file).write_bytes(content)
    _write_3mf(mesh, folder / "mesh-3mf")
    _write_scans(points, folder)
    others = {"mesh-3mf": "a.3mf", "cloud-las": "a.las", "cloud-laz": "a.laz", "cloud-e57": "a.e57"}
    return {**{n: (f, n in texts) for n, (f, _) in data.items()}, **{n: (f, False) for n, f in others.items()}}


def _numbers(values: np.ndarray) -> str:
    return " ".join(map(str, values.ravel().tolist()))


def _dae(mesh: trimesh.Trimesh) -> str:
    corners, indices = _numbers(mesh.vertices), _numbers(mesh.faces)
    count, faces = len(mesh.vertices), len(mesh.faces)
    return _DAE.format(numbers=3 * count, corners=corners, count=count, faces=faces, indices=indices)


def _usd(mesh: trimesh.Trimesh) -> str:
    points = ", ".join(str(tuple(v)) for v in mesh.vertices.tolist())
    counts, indices = ", ".join(["3"] * len(mesh.faces)), ", ".join(map(str, mesh.faces.ravel().tolist()))
    return _USD.format(points=points, counts=counts, indices=indices)


def _write_3mf(mesh: trimesh.Trimesh, folder: Path) -> None:
    folder.mkdir()
    vertices = "".join('<vertex x="{}" y="{}" z="{}"/>'.format(*v) for v in mesh.vertices.tolist())
    triangles = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*f) for f in mesh.faces.tolist())
    with zipfile.ZipFile(folder / "a.3mf", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", _TYPES)
        archive.writestr("3D/3dmodel.model", _3MF.format(vertices=vertices, triangles=triangles))


def _splat(points: np.ndarray) -> bytes:
    """Rows of 32 bytes: place, size, colour with opacity, turn."""
    rows = np.zeros(len(points), [("at", "<f4", 3), ("sigma", "<f4", 3), ("colour", "u1", 4), ("turn", "u1", 4)])
    rows["at"], rows["sigma"], rows["colour"], rows["turn"] = points, 0.01, (200, 100, 50, 240), (255, 128, 128, 128)
    return rows.tobytes()


def _spz(points: np.ndarray) -> bytes:
    """Version 2, without spherical harmonics."""
    fixed = np.rint(points * 4096).astype(int)
    places = np.stack([fixed & 255, fixed >> 8 & 255, fixed >> 16 & 255], 2).astype("u1").tobytes()
    count = len(points)
    rest = bytes([240]) * count + bytes(3 * count) + bytes([80]) * 3 * count + bytes([128]) * 3 * count
    return gzip.compress(struct.pack("<4s2I4B", b"NGSP", 2, count, 0, 12, 0, 0) + places + rest)


def _write_scans(points: np.ndarray, folder: Path) -> None:
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = points.min(0), [1e-4] * 3
    scan = laspy.LasData(header)
    scan.x, scan.y, scan.z = points.T
    for ending in ("las", "laz", "e57"):
        (folder / f"cloud-{ending}").mkdir()
    scan.write(str(folder / "cloud-las/a.las"))
    scan.write(str(folder / "cloud-laz/a.laz"))
    file = pye57.E57(str(folder / "cloud-e57/a.e57"), mode="w")
    columns = {f"cartesian{a}": points[:, i] for i, a in enumerate("XYZ")}
    file.write_scan_raw(columns, rotation=np.array([1.0, 0, 0, 0]), translation=np.zeros(3))
    file.close()
