"""STL files, text and binary, told from each other by what follows the header and not by the word "solid"."""

from __future__ import annotations

import logging
import mmap
import re
from pathlib import Path

import numpy as np

from recon.files.head import Head
from recon.files.shape import Kind, Recognised, Surface, not_too_many
from recon.scene import InputError
from recon.system import limits

log = logging.getLogger("recon")

_HEAD = 84  # bytes: a comment of 80, and the number of triangles
_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")])
_WORDS = re.compile(r"\b(facet\s+normal|end\s?solid|outer\s+loop)\b", re.IGNORECASE)


def is_text(head: Head) -> bool:
    """Whether it is text that begins as STL does, in small or capital letters."""
    text = head.text
    return text is not None and bool(re.match(r"\s*(solid|facet)\b", text, re.IGNORECASE) and _WORDS.search(text))


def is_binary(head: Head) -> bool:
    """Whether the size is that of so many triangles, or the rows look like triangles whatever their number says."""
    if head.size < _HEAD or head.start[:4] in (b"glTF", b"PK\x03\x04", b"\x89PNG"):
        return False
    said = int.from_bytes(head.start[80:84], "little")
    rows = said if 0 < said <= (head.size - _HEAD) // _ROW.itemsize else 200
    return head.size == _HEAD + _ROW.itemsize * said or _plausible(head.start[_HEAD : _HEAD + _ROW.itemsize * rows])


def _plausible(data: bytes) -> bool:
    """Whether these bytes are triangles: numbers of usual size, and normals that are unit vectors or nothing."""
    rows = np.frombuffer(data, _ROW, min(len(data) // _ROW.itemsize, 200))
    if not len(rows):
        return False
    with np.errstate(invalid="ignore"):
        corners, normals = rows["corners"].astype(float), rows["normal"].astype(float)
    size = np.abs(corners)
    usual = (
        np.isfinite(corners).all()
        and np.isfinite(normals).all()
        and ((size == 0) | ((size > 1e-15) & (size < 1e15))).all()
    )
    length = np.linalg.norm(normals, axis=1) if usual else np.ones(1)
    return bool(usual and ((length < 1e-6) | (np.abs(length - 1) < 0.02)).all() and np.ptp(corners) > 0)


def describe_text(path: Path) -> Recognised:
    if path.stat().st_size > limits.TEXT:
        raise InputError(f"{path} is a text STL of more than {limits.TEXT >> 30} GB; save it as binary STL")
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        count = sum(1 for _ in re.finditer(rb"(?i)\bfacet\s+normal", text))
    not_too_many(path, count)
    return Recognised(Kind.MESH, f"a mesh of {count:,} faces (STL, text)")


def read_text(path: Path) -> Surface:
    """Raises ValueError when a corner is cut off or is no number."""
    rows = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", path.read_bytes(), re.IGNORECASE)
    if len(rows) % 3:
        raise ValueError("it is cut short inside a triangle")
    words = np.array(rows, "S").reshape(-1, 3)
    if b"," in b"".join(rows[0] if rows else ()):
        words = np.char.replace(words, b",", b".")
    return _surface(words.astype(float))


def describe_binary(path: Path) -> Recognised:
    count, _ = _count(path)
    not_too_many(path, count)
    return Recognised(Kind.MESH, f"a mesh of {count:,} faces (STL)")


def read_binary(path: Path) -> Surface:
    count, warning = _count(path)
    if warning:
        log.warning("%s: %s", path, warning)
    rows: np.ndarray = np.fromfile(path, _ROW, count, offset=_HEAD)
    return _surface(rows["corners"].reshape(-1, 3).astype(float))


def _count(path: Path) -> tuple[int, str]:
    """The number of triangles, and a warning when the header says another.

    More than the header says are taken when they fill the rest of the file exactly; fewer, likewise. Raises InputError
    for a file that ends inside a triangle that its header promises.
    """
    size = path.stat().st_size - _HEAD
    there, left = divmod(size, _ROW.itemsize)
    with path.open("rb") as file:
        said = int.from_bytes(file.read(_HEAD)[80:], "little")
        file.seek(_HEAD + _ROW.itemsize * min(said, there))
        more = file.read(200 * _ROW.itemsize)
    if said == there or (0 < said < there and not _plausible(more)):
        return said, ""
    if said > there and left and said != 0xFFFFFFFF:
        raise InputError(f"{path} is cut short: {there:,} faces, its header promises {said:,}; export it again")
    return there, f"its header says {said:,} faces, it has {there:,}"


def _surface(corners: np.ndarray) -> Surface:
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    return Surface(vertices, index.reshape(-1, 3))
