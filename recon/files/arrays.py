"""numpy's files, .npy and .npz: a voxel grid, points in rows or columns, or vertices with faces. Nothing is unpickled.

Only the headers are read to tell what there is; then what is used, in portions.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from recon.files.head import Head
from recon.files.names import COLOURS, POINTS, axis_columns
from recon.files.polygons import table_triangles
from recon.files.rows import kept, picked
from recon.files.shape import Cloud, Grid, Kind, Recognised, Shape, Surface, cloud_of, not_too_many
from recon.files.voxels import gathered
from recon.scene import InputError
from recon.system import limits


@dataclass(frozen=True)
class Array:
    """One array's header. name is "" in a .npy file."""

    name: str
    shape: tuple[int, ...]
    kind: np.dtype
    fortran: bool

    @property
    def stored(self) -> tuple[int, ...]:
        """The shape as the numbers lie in the file, the last index running fastest."""
        return self.shape[::-1] if self.fortran else self.shape


@dataclass(frozen=True)
class Chosen:
    """Which array of a file is the shape, and how its points lie.

    rows     how many points there are
    columns  numbers or names of x, y and z
    across   whether the points lie along the last axis, (3, n)
    """

    array: Array
    kind: Kind
    what: str
    rows: int = 0
    columns: tuple[int | str, ...] = (0, 1, 2)
    across: bool = False
    faces: Array | None = None


def is_arrays(head: Head) -> bool:
    """Whether it is a .npy file, or a zip archive with arrays."""
    return head.start[:6] == b"\x93NUMPY" or any(name.endswith(".npy") for name in head.members)


def describe(path: Path) -> Recognised:
    """Raises InputError for arrays of other shapes, of objects or text, for huge ones and for damage."""
    chosen = _chosen(path)
    return Recognised(chosen.kind, chosen.what)


def read(path: Path) -> Shape:
    """What describe says. Raises ValueError for damage."""
    chosen = _chosen(path)
    if chosen.kind == Kind.VOXELS:
        return _grid(path, chosen.array)
    if chosen.faces is not None:
        vertices = _points(path, chosen, limits.FACES)
        with _opened(path, chosen.faces) as file:
            faces = np.frombuffer(
                file.read(int(np.prod(chosen.faces.shape)) * chosen.faces.kind.itemsize), chosen.faces.kind
            )
        table = faces.reshape(chosen.faces.stored)
        return Surface(vertices, table_triangles(table.T if chosen.faces.fortran else table))
    return Cloud(_points(path, chosen, limits.POINTS))


def arrays_in(path: Path) -> list[Array]:
    """The headers of all arrays. Raises InputError for damage, and when they claim to be huge."""
    with path.open("rb") as file:
        if file.read(6) == b"\x93NUMPY":
            file.seek(0)
            return [_array(file, "", path)]
    try:
        with zipfile.ZipFile(path) as archive:
            members = [m for m in archive.infolist() if m.filename.endswith(".npy")]
            if sum(m.file_size for m in members) > limits.UNPACKED:
                raise InputError(
                    f"{path} would unpack to more than {limits.UNPACKED >> 30} GB; give a coarser grid or fewer points"
                )
            found = []
            for member in members:
                with archive.open(member) as inside:
                    found.append(_array(inside, member.filename[:-4], path))
            return found
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise InputError(f"{path} is a damaged zip file ({error}); save it again") from error


def _array(file: IO[bytes], name: str, path: Path) -> Array:
    try:
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, kind = header(file)
    except Exception as error:  # numpy reads the header as Python, which fails in many ways
        raise InputError(f"{path} is a damaged numpy file ({error}); save it again") from error
    return Array(name, tuple(shape), kind, fortran)


def _chosen(path: Path) -> Chosen:
    """The array that is the shape: a mesh's, else one that is called points, else the first that can be."""
    there = arrays_in(path)
    arrays = [a for a in there if not a.kind.hasobject and (a.kind.names or a.kind.kind in "fiub")]
    named = {a.name.rsplit("/", 1)[-1].lower(): a for a in arrays}
    faces = next(
        (named[n] for n in ("faces", "triangles", "tris", "f") if n in named and named[n].kind.kind in "iu"), None
    )
    order = sorted(arrays, key=lambda a: (a.name.lower() in COLOURS, a.name.lower() not in POINTS))
    for array in order:
        chosen = _as_shape(path, array, faces)
        if chosen is not None:
            return chosen
    if single := _three_columns(named):
        return single
    if any(a.kind.hasobject for a in there):
        raise InputError(
            f"{path} holds Python objects, which are not read; save plain numbers, (n, 3) points or a voxel grid"
        )
    said = ", ".join(f"{a.name or 'one'} {a.shape} of {a.kind}" for a in there[:6])
    raise InputError(f"{path} holds no 3-d voxel grid and no (n, 3) points, but: {said}; save one of these")


def _as_shape(path: Path, array: Array, faces: Array | None) -> Chosen | None:
    """How an array can be a shape, or None."""
    if array.kind.names:
        single = [n for n in array.kind.names if array.kind[n].shape == () and array.kind[n].kind in "fiu"]
        columns = axis_columns(single)
        rows = int(np.prod(array.shape))
        fields = tuple(single[c] for c in columns) if columns else ()
        return Chosen(array, Kind.CLOUD, cloud_of(rows), rows, fields) if fields else None
    shape = array.shape
    while len(shape) > 2 and 1 in (shape[0], shape[-1] if len(shape) > 3 else 0):
        shape = shape[1:] if shape[0] == 1 else shape[:-1]
    flat = Array(array.name, shape, array.kind, array.fortran)
    if len(shape) == 3 and shape[2] == 3 and array.kind.kind == "f":
        raise InputError(
            f"{path} holds {shape[0]:,} sets of {shape[1]:,} points; save one of them, or all of one object, as (n, 3)"
        )
    if len(shape) == 3 and min(shape) > 3:
        return _voxels(path, flat)
    if len(shape) != 2 or min(shape) < 3 or min(shape) > 128 or array.kind.kind == "b" or array is faces:
        return None
    across = shape[0] < shape[1] and (shape[1] > 128 or shape[0] == 3)
    rows, width = (shape[1], shape[0]) if across else shape
    said = cloud_of(rows) + (f" (array {array.name!r})" if array.name else "")
    if faces is not None and array.name.rsplit("/", 1)[-1].lower() in POINTS:
        not_too_many(path, max(*faces.shape, rows))
        return Chosen(flat, Kind.MESH, f"a mesh of {faces.shape[0]:,} faces (numpy)", rows, across=across, faces=faces)
    return Chosen(
        flat, Kind.CLOUD, said + (f", the first three of {width} columns" if width > 3 else ""), rows, across=across
    )


def _voxels(path: Path, array: Array) -> Chosen:
    if max(array.shape) > limits.SIDE or int(np.prod(array.shape)) * array.kind.itemsize > limits.UNPACKED:
        raise InputError(f"{path}: a voxel grid of {array.shape} is too large; give one of up to 1024 voxels a side")
    if array.kind == np.uint8 and array.shape[2] == 4:
        raise InputError(f"{path} holds an array {array.shape} of bytes, which looks like a picture; save it as PNG")
    return Chosen(array, Kind.VOXELS, f"a voxel grid of {' x '.join(map(str, array.shape))}")


def _three_columns(named: dict[str, Array]) -> Chosen | None:
    """Three arrays called x, y and z."""
    if not {"x", "y", "z"} <= set(named) or len({named[a].shape for a in "xyz"}) != 1 or len(named["x"].shape) != 1:
        return None
    rows = named["x"].shape[0]
    return Chosen(named["x"], Kind.CLOUD, cloud_of(rows), rows, tuple(named[a].name for a in "xyz"))


@contextmanager
def _opened(path: Path, array: Array) -> Iterator[IO[bytes]]:
    """The file at the array's first number."""
    if not array.name:
        with path.open("rb") as file:
            _array(file, "", path)
            yield file
        return
    with zipfile.ZipFile(path) as archive, archive.open(f"{array.name}.npy") as inside:
        _array(inside, array.name, path)
        yield inside


def _points(path: Path, chosen: Chosen, most: int) -> np.ndarray:
    """(n, 3) float, at most `most` of them."""
    array, keep = chosen.array, kept(chosen.rows, most)
    if array.kind.names:
        with _opened(path, array) as file:
            rows = picked(file, array.kind, chosen.rows, keep, [str(c) for c in chosen.columns])
        return np.stack([rows[c].astype(float) for c in chosen.columns], 1)
    if len(array.shape) == 1:  # three arrays
        columns = []
        for name in chosen.columns:
            single = next(a for a in arrays_in(path) if a.name == name)
            with _opened(path, single) as file:
                columns.append(picked(file, single.kind, chosen.rows, keep).astype(float))
        return np.stack(columns, 1)
    width = int(np.prod(array.shape)) // max(chosen.rows, 1)
    with _opened(path, array) as file:
        if chosen.across != array.fortran:  # one coordinate after the other
            return np.stack([picked(file, array.kind, chosen.rows, keep).astype(float) for _ in range(3)], 1)
        row = np.dtype([("place", array.kind, 3), ("rest", array.kind, width - 3)])
        return picked(file, row, chosen.rows, keep, ["place"])["place"].astype(float)


def _grid(path: Path, array: Array) -> Grid:
    """Numbers count as filled above the middle of 0 and 1."""
    count, shape = int(np.prod(array.stored[1:])), array.stored

    def layers(file: IO[bytes]) -> Iterator[np.ndarray]:
        for _ in range(shape[0]):
            data = file.read(count * array.kind.itemsize)
            yield _full(np.frombuffer(data, array.kind, count)).reshape(shape[1:])

    with _opened(path, array) as file:
        filled = gathered(layers(file), shape)
    if not filled.any():
        raise InputError(f"{path} is a voxel grid with nothing in it")
    return Grid(filled.transpose() if array.fortran else filled)


def _full(values: np.ndarray) -> np.ndarray:
    """Which numbers are above the middle of 0 and 1; what is no number is not."""
    return values > 0.5 if values.dtype.kind == "f" else values > 0
