"""Meshes, point clouds, Gaussian splats and voxel grids from files: plain arrays out, nothing unpickled.

A file's content decides how it is read, not its name. Whatever is wrong with a file becomes an InputError.
"""

from __future__ import annotations

import logging
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from datasets.triangles import MeshError, read_triangles
from recon.ply import ply_header, ply_vertices
from recon.scene import InputError

log = logging.getLogger("recon")

MAX_BYTES = 4 << 30  # of arrays that a small file may claim to unpack to


@dataclass(frozen=True)
class Surface:
    """Triangles: vertices (n, 3) float and triangles (m, 3) int."""

    vertices: np.ndarray
    triangles: np.ndarray


def npy_header(path: Path) -> tuple[int, ...]:
    """The shape of the array in a .npy file; nothing is loaded."""
    with path.open("rb") as file:
        return _npy_shape(file, path)


def zip_arrays(path: Path) -> dict[str, tuple[int, ...]]:
    """Name and shape of every array in an .npz file; nothing is loaded. Raises InputError when it claims to be huge."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = [m for m in archive.infolist() if m.filename.endswith(".npy")]
            if sum(m.file_size for m in members) > MAX_BYTES:
                raise InputError(f"{path} would unpack to more than {MAX_BYTES >> 30} GB; give a coarser grid")
            shapes = {}
            for member in members:
                with archive.open(member) as file:
                    shapes[member.filename[:-4]] = _npy_shape(file, path)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise InputError(f"{path} is a damaged zip file ({error})") from error
    if not shapes:
        raise InputError(f"{path} is a zip file without numpy arrays; unpack it and give what is inside")
    return shapes


def _npy_shape(file: Any, path: Path) -> tuple[int, ...]:
    try:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = read(file)
    except (ValueError, OSError, EOFError) as error:
        raise InputError(f"{path} is a damaged numpy file ({error})") from error
    if kind.hasobject:
        raise InputError(f"{path} holds Python objects, which are not read; save plain numbers")
    return tuple(shape)


def read_mesh(path: Path) -> Surface:
    """All triangles of a mesh file. Raises InputError for damage and for a mesh without faces."""
    try:
        return Surface(*read_triangles(path, mesh_format(path), str(path)))
    except MeshError as error:
        raise InputError(str(error)) from error


def mesh_format(path: Path) -> str:
    """The format by content, as trimesh calls it."""
    with path.open("rb") as file:
        head = file.read(512)
    text = head.lstrip()
    if head[:3] == b"ply":
        return "ply"
    if head[:4] == b"glTF":
        return "glb"
    if text[:1] == b"{":
        return "gltf"
    if text.split(b"\n", 1)[0].split(b" ", 1)[0].strip().endswith(b"OFF"):
        return "off"
    size = path.stat().st_size
    if size >= 84 and size == 84 + 50 * int.from_bytes(head[80:84], "little"):
        return "stl"
    return "stl_ascii" if text[:5] == b"solid" else "obj"


def read_cloud(path: Path) -> np.ndarray:
    """(n, 3) float points of a PLY, PCD, NPY, NPZ, OBJ or text file, with whatever is wrong with single points."""
    with path.open("rb") as file:
        head = file.read(512).lstrip()
    if head[:3] == b"ply":
        header = ply_header(path)
        if header.plain:
            columns = ply_vertices(path)
            return np.stack([columns[a] for a in "xyz"], 1)
        return _trimesh_points(path, "ply")
    if head[:6] == b"# .PCD" or head[:8] == b"VERSION ":
        return _pcd(path)
    if head[:6] == b"\x93NUMPY" or head[:4] == b"PK\x03\x04":
        return _array(path, 2)[:, :3].astype(float)
    if head[:2] in (b"v ", b"vn", b"vt", b"o ", b"g ", b"mt"):
        return _trimesh_points(path, "obj")
    return _rows(path)


def _trimesh_points(path: Path, form: str) -> np.ndarray:
    import trimesh

    try:
        loaded = trimesh.load_scene(path, file_type=form, process=False, skip_materials=True)
        pieces: Any = loaded.dump(concatenate=False)
        return np.concatenate([np.asarray(g.vertices, np.float64) for g in pieces])
    except Exception as error:  # as above
        raise InputError(f"{path} is damaged ({type(error).__name__}: {error}); export it again") from error


def _pcd(path: Path) -> np.ndarray:
    import open3d as o3d

    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        points = np.asarray(o3d.io.read_point_cloud(path, format="pcd").points, np.float64)
    if not len(points):
        raise InputError(f"{path} is a PCD file without readable points: empty, or cut short; export it again")
    return points


def _rows(path: Path) -> np.ndarray:
    """Text: three numbers or more a line, separated by spaces, commas or semicolons; headings are skipped."""
    rows = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.replace(",", " ").replace(";", " ").split()[:3]
        try:
            rows.append([float(w) for w in words])
        except ValueError:
            continue
    points = np.array([r for r in rows if len(r) == 3])
    if not len(points):
        raise InputError(f"{path} has no rows of three numbers")
    return points


def _array(path: Path, dimensions: int) -> np.ndarray:
    """The first array of that many dimensions in a .npy or .npz file."""
    try:
        loaded = np.load(path, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return loaded
        with loaded:
            for name, shape in zip_arrays(path).items():
                if len(shape) == dimensions:
                    return loaded[name]
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is damaged, or holds Python objects ({error}); save plain numbers") from error
    raise InputError(f"{path} holds no array of {dimensions} dimensions")


def read_splat(path: Path, least_opacity: float) -> np.ndarray:
    """(n, 3) float, centres of the Gaussians that can be seen: opacity (stored as a logit) of at least `least_opacity`.

    Raises InputError for a splat without opacity.
    """
    columns = ply_vertices(path)
    if "opacity" not in columns:
        raise InputError(
            f"{path} is a Gaussian splat without opacity, so floaters cannot be told from the object; export it with "
            "opacity, or take its points as they are with --input cloud"
        )
    opacity = 1 / (1 + np.exp(-np.clip(columns["opacity"], -50, 50)))
    points = np.stack([columns[a] for a in "xyz"], 1)[opacity >= least_opacity]
    if len(points) < len(opacity) / 1000 or not len(points):
        raise InputError(f"{path}: only {len(points)} of {len(opacity):,} Gaussians are opaque; train the splat longer")
    return points


def read_voxels(path: Path) -> np.ndarray:
    """(X, Y, Z) bool. Numbers count as filled above the middle of 0 and 1; Raises InputError for damage."""
    with path.open("rb") as file:
        head = file.read(8)
    grid = _binvox(path) if head[:7] == b"#binvox" else _array(path, 3)
    if grid.ndim != 3 or max(grid.shape) > 1024:
        raise InputError(f"{path}: a voxel grid has three dimensions of up to 1024, this one is {grid.shape}")
    filled = grid if grid.dtype == bool else np.nan_to_num(grid.astype(float)) > 0.5
    if not filled.any():
        raise InputError(f"{path} is a voxel grid with nothing in it")
    return filled


def _binvox(path: Path) -> np.ndarray:
    """Patrick Min's format: runs of (value, length), y running fastest, then z, then x."""
    data = path.read_bytes()
    head, found, body = data.partition(b"data\n")
    try:
        words = [line.split() for line in head.decode("ascii").splitlines()]
        size = next(tuple(int(x) for x in w[1:4]) for w in words if w[:1] == ["dim"])
    except (UnicodeDecodeError, ValueError, StopIteration) as error:
        raise InputError(f"{path} is a damaged binvox file: no readable dimensions") from error
    runs = np.frombuffer(body[: len(body) // 2 * 2], np.uint8).reshape(-1, 2)
    total = int(runs[:, 1].sum())
    if not found or len(size) != 3 or min(size) < 1 or max(size) > 1024 or total != int(np.prod(size)):
        raise InputError(f"{path} is a binvox file cut short: {total:,} voxels, its header promises {size}")
    return np.repeat(runs[:, 0], runs[:, 1]).reshape(size[0], size[2], size[1]).transpose(0, 2, 1) > 0
