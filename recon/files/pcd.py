"""PCD clouds of the Point Cloud Library: fields of any type, size and count, as text, binary or packed with LZF."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.files.head import Head
from recon.files.rows import kept, numbers, picked
from recon.files.shape import Cloud, Kind, Recognised, cloud_of
from recon.scene import InputError
from recon.system import limits

_HEAD = 1 << 16
_KINDS = {"F": "f", "I": "i", "U": "u"}


@dataclass(frozen=True)
class _Header:
    fields: tuple[tuple[str, str, int], ...]  # name, numpy type, count
    points: int
    data: str
    offset: int

    @property
    def row(self) -> np.dtype:
        return np.dtype([(f"{i}{name}", kind, (count,)) for i, (name, kind, count) in enumerate(self.fields)])


def is_pcd(head: Head) -> bool:
    """Whether it has PCD's header, after any comments."""
    return bool(
        re.match(rb"\s*(#[^\n]*\n\s*)*(VERSION|FIELDS)\s", head.start) and re.search(rb"\nDATA\s+\w", head.start)
    )


def describe(path: Path) -> Recognised:
    return Recognised(Kind.CLOUD, cloud_of(_header(path).points))


def read(path: Path) -> Cloud:
    """x, y and z. Raises InputError without them, ValueError when the file is cut short."""
    header = _header(path)
    names = [name.lower() for name, _, _ in header.fields]
    if not {"x", "y", "z"} <= set(names):
        raise InputError(f"{path} is a PCD file without x, y and z, but {', '.join(names)}; export it again")
    keep, where = kept(header.points, limits.POINTS), [names.index(axis) for axis in "xyz"]
    with path.open("rb") as file:
        file.seek(header.offset)
        if header.data == "ascii":
            rows = _text(file.read(limits.TEXT), header)
            starts = np.cumsum([0, *(count for _, _, count in header.fields)])
            return Cloud(rows[keep][:, starts[where]])
        if header.data == "binary":
            fields = [list(header.row.names or ())[i] for i in where]
            table = picked(file, header.row, header.points, keep, fields)
            return Cloud(np.stack([table[name][:, 0].astype(float) for name in fields], 1))
        columns = _columns(file.read(limits.TEXT), header)
        return Cloud(np.stack([columns[i][keep, 0].astype(float) for i in where], 1))


def _header(path: Path) -> _Header:
    """Raises InputError when it is damaged."""
    with path.open("rb") as file:
        head = file.read(_HEAD)
    end = re.search(rb"\nDATA[ \t]+(\w+)[ \t]*\r?\n?", head)
    try:
        if end is None:
            raise ValueError("it has no DATA")
        lines = [line.split() for line in head[: end.start()].decode("latin-1").splitlines()]
        said = {words[0].upper(): words[1:] for words in lines if words and not words[0].startswith("#")}
        names = said.get("FIELDS") or said["COLUMNS"]
        counts = [int(c) for c in said.get("COUNT", ["1"] * len(names))]
        kinds = [f"<{_KINDS[t.upper()]}{int(s)}" for t, s in zip(said["TYPE"], said["SIZE"], strict=True)]
        points = int(said["POINTS"][0]) if "POINTS" in said else int(said["WIDTH"][0]) * int(said["HEIGHT"][0])
        fields = tuple(zip(names, (np.dtype(k).str for k in kinds), counts, strict=True))
        data = end[1].decode().lower()
        if (
            points < 0
            or min(counts) < 1
            or max(counts) > 1 << 16
            or data not in ("ascii", "binary", "binary_compressed")
        ):
            raise ValueError(f"it has {points} points, data {data!r}")
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise InputError(f"{path} is a damaged PCD file (its header: {error}); export it again") from error
    return _Header(fields, points, data, end.end())


def _text(body: bytes, header: _Header) -> np.ndarray:
    """(n, columns) float."""
    width = sum(count for _, _, count in header.fields)
    flat = numbers(body)
    if len(flat) < header.points * width:
        raise ValueError(f"it is cut short: {len(flat) // width:,} points, its header promises {header.points:,}")
    return flat[: header.points * width].reshape(-1, width)


def _columns(body: bytes, header: _Header) -> list[np.ndarray]:
    """Every field (n, count) of packed data, which lie one after the other."""
    packed, whole = (int(v) for v in np.frombuffer(body, "<u4", 2))
    if whole < header.points * header.row.itemsize or whole > limits.TEXT:
        raise ValueError(f"it claims {whole:,} bytes for {header.points:,} points")
    file = io.BytesIO(_unpacked(body[8 : 8 + packed], whole))
    out = []
    for _, kind, count in header.fields:
        size = header.points * count * np.dtype(kind).itemsize
        out.append(np.frombuffer(file.read(size), kind).reshape(-1, count))
    return out


def _unpacked(data: bytes, size: int) -> bytes:
    """LZF: runs of bytes as they are, and copies of what came before. Raises ValueError for any other length."""
    out, at = bytearray(), 0
    while at < len(data) and len(out) <= size:
        control, at = data[at], at + 1
        if control < 32:
            out += data[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length, at = length + data[at], at + 1
        back, at, length = ((control & 31) << 8) + data[at] + 1, at + 1, length + 2
        start = len(out) - back
        if start < 0:
            raise ValueError("its packed data are damaged")
        if back >= length:
            out += out[start : start + length]
        else:
            out += (out[start:] * (length // back + 1))[:length]
    if len(out) != size:
        raise ValueError(f"it is cut short: {len(out):,} of {size:,} bytes")
    return bytes(out)
