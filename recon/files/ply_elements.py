"""PLY files as tables: the header, and the columns of every element, text or binary, lists or not."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from recon.files.rows import kept, numbers, picked
from recon.scene import InputError
from recon.system import limits

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"},
    **{"double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8"},
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_HEADER = 1 << 20  # bytes that a header may have


@dataclass(frozen=True)
class Property:
    """A column: name in small letters, numpy's type, and the type of a list's length (None: no list)."""

    name: str
    kind: str
    length: str | None


@dataclass(frozen=True)
class Element:
    """A table of `count` rows."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def plain(self) -> bool:
        """Whether all rows have one length."""
        return all(p.length is None for p in self.properties)

    @property
    def names(self) -> list[str]:
        return [p.name for p in self.properties]


@dataclass(frozen=True)
class Header:
    """A PLY file's header. order: numpy's sign of the byte order, "" for text; offset: where the data begin."""

    elements: tuple[Element, ...]
    order: str
    offset: int

    def element(self, name: str) -> Element:
        """That element, or an empty one."""
        return next((e for e in self.elements if e.name == name), Element(name, 0, ()))


@dataclass(frozen=True)
class Lists:
    """A column of lists: the length of each, and all values one after the other."""

    counts: np.ndarray
    values: np.ndarray


Column = np.ndarray | Lists


def header_of(path: Path) -> Header:
    """The header. Raises InputError when it is damaged."""
    with path.open("rb") as file:
        head = file.read(_HEADER)
    end = re.search(rb"[\r\n][ \t]*end_header[ \t]*(\r\n|\r|\n)", head)
    if end is None:
        raise InputError(f"{path} is a damaged PLY file: its header has no end")
    words = [line.split() for line in re.split(r"[\r\n]+", head[: end.start()].decode("latin-1").lower())]
    order, elements = None, []  # type: tuple[str | None, list[Element]]
    try:
        for word in words:
            if word[:1] == ["format"]:
                order = _ORDERS[word[1]]
            elif word[:1] == ["element"]:
                elements.append(Element(word[1], int(word[2]), ()))
            elif word[:1] == ["property"]:
                last = elements[-1]
                elements[-1] = Element(last.name, last.count, (*last.properties, _property(word)))
    except (IndexError, KeyError, ValueError) as error:
        raise InputError(
            f"{path} is a damaged PLY file: its header says {' '.join(word)!r}; export it again"
        ) from error
    if order is None or any(e.count < 0 for e in elements):
        raise InputError(f"{path} is a damaged PLY file: its header names no format; save it as binary or ascii")
    return Header(tuple(elements), order, end.end())


def _property(word: list[str]) -> Property:
    if word[1] == "list":
        return Property(word[4], _TYPES[word[3]], _TYPES[word[2]])
    return Property(word[2], _TYPES[word[1]], None)


def columns_of(path: Path, header: Header, wanted: tuple[str, ...], most: int) -> dict[str, dict[str, Column]]:
    """The columns of the elements named `wanted`: of more than `most` rows without lists, `most` are drawn.

    Colours, normals and the many numbers of a splat's shading are left out.

    Raises ValueError when the file is cut short or holds what is no number.
    """
    out: dict[str, dict[str, Column]] = {}
    wanted = tuple(e.name for e in header.elements if e.name in wanted)
    with path.open("rb") as file:
        file.seek(header.offset)
        if not header.order:
            return _from_text(file, header, wanted, most)
        for element in header.elements:
            if element.name in wanted or not element.plain:
                out[element.name] = _binary(file, element, header.order, most)
            else:
                file.seek(element.count * np.dtype(_row(element, header.order)).itemsize, 1)
            if set(wanted) <= set(out):
                break
    return {name: out[name] for name in wanted if name in out}


def _useful(name: str) -> bool:
    return not name.startswith(("f_", "nx", "ny", "nz", "red", "green", "blue"))


def _row(element: Element, order: str) -> list[tuple[str, str]]:
    """numpy's record of a row without lists; names may repeat in a file."""
    return [(str(i), order + p.kind) for i, p in enumerate(element.properties)]


def _binary(file: IO[bytes], element: Element, order: str, most: int) -> dict[str, Column]:
    if element.plain:
        kept_names = {str(i): p.name for i, p in enumerate(element.properties) if _useful(p.name)}
        rows = picked(file, np.dtype(_row(element, order)), element.count, kept(element.count, most), list(kept_names))
        return {name: rows[i].astype(float) for i, name in kept_names.items()}
    at = file.tell()
    size = file.seek(0, 2) - at
    file.seek(at)
    if element.count > min(size, limits.FACES):
        raise ValueError(f"its header promises {element.count:,} rows of {element.name}, which are not there")
    uniform = _uniform(file, element, order)
    if uniform is not None:
        return uniform
    file.seek(at)
    data = file.read()
    out, used = _ragged(data, element, order)
    file.seek(at + used)
    return out


def _uniform(file: IO[bytes], element: Element, order: str) -> dict[str, Column] | None:
    """The columns when all lists of a column are as long as the first, as in a mesh of triangles; else None."""
    at = file.tell()
    _, lengths, used = _one_row(file.read(1 << 16), 0, element, order)
    fields: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = []
    for i, (p, length) in enumerate(zip(element.properties, lengths, strict=True)):
        if p.length is not None:
            fields.append((f"n{i}", order + p.length))
        fields.append((str(i), order + p.kind, () if p.length is None else (length,)))
    kind = np.dtype(fields)
    file.seek(at)
    data = file.read(element.count * kind.itemsize)
    if kind.itemsize != used or len(data) < element.count * kind.itemsize:
        return None
    rows = np.frombuffer(data, kind)
    out: dict[str, Column] = {}
    for i, (p, length) in enumerate(zip(element.properties, lengths, strict=True)):
        if p.length is None:
            out[p.name] = rows[str(i)].astype(float)
        elif (rows[f"n{i}"] == length).all():
            out[p.name] = Lists(np.full(element.count, length), rows[str(i)].ravel())
        else:
            return None
    return out


def _ragged(data: bytes, element: Element, order: str) -> tuple[dict[str, Column], int]:
    """The columns of rows of any lengths, and the bytes that they take."""
    pieces: list[list[np.ndarray]] = [[] for _ in element.properties]
    at = 0
    for _ in range(element.count):
        values, _, at = _one_row(data, at, element, order)
        for piece, value in zip(pieces, values, strict=True):
            piece.append(value)
    out: dict[str, Column] = {}
    for p, piece in zip(element.properties, pieces, strict=True):
        flat = np.concatenate(piece)
        out[p.name] = flat.astype(float) if p.length is None else Lists(np.array([len(v) for v in piece]), flat)
    return out, at


def _one_row(data: bytes, at: int, element: Element, order: str) -> tuple[list[np.ndarray], list[int], int]:
    """Values and lengths of the row at a place, and where it ends. Raises ValueError when it is cut."""
    values, lengths = [], []
    for p in element.properties:
        length = 1
        if p.length is not None:
            length = int(np.frombuffer(data, order + p.length, 1, at)[0])
            at += np.dtype(p.length).itemsize
        values.append(np.frombuffer(data, order + p.kind, length, at))
        lengths.append(length)
        at += np.dtype(p.kind).itemsize * length
    return values, lengths, at


def _from_text(file: IO[bytes], header: Header, wanted: tuple[str, ...], most: int) -> dict[str, dict[str, Column]]:
    flat, at, out = numbers(file.read(limits.TEXT)), 0, {}  # type: tuple[np.ndarray, int, dict[str, dict[str, Column]]]
    for element in header.elements:
        width = len(element.properties)
        if element.plain:
            if at + element.count * width > len(flat):
                raise ValueError(f"it is cut short: its header promises {element.count:,} rows of {element.name}")
            table = flat[at : at + element.count * width].reshape(-1, width)[kept(element.count, most)]
            columns: dict[str, Column] = {p.name: table[:, i] for i, p in enumerate(element.properties)}
            at += element.count * width
        else:
            columns, at = _text_lists(flat, at, element)
        if element.name in wanted:
            out[element.name] = columns
    return out


def _text_lists(flat: np.ndarray, at: int, element: Element) -> tuple[dict[str, Column], int]:
    """The columns of an element with lists that begins at flat[at], and where it ends."""
    starts, counts = np.zeros((2, len(element.properties), min(element.count, len(flat))), np.int64)
    for row in range(element.count):
        for i, p in enumerate(element.properties):
            length = 1
            if p.length is not None:
                length, at = int(flat[at]), at + 1
            starts[i, row], counts[i, row] = at, length
            at += length
            if length < 0 or at > len(flat):
                raise ValueError(f"it is cut short: its header promises {element.count:,} rows of {element.name}")
    out: dict[str, Column] = {}
    for i, p in enumerate(element.properties):
        index = np.repeat(starts[i] - np.cumsum(counts[i]) + counts[i], counts[i]) + np.arange(counts[i].sum())
        out[p.name] = flat[index] if p.length is None else Lists(counts[i], flat[index].astype(np.int64))
    return out, at
