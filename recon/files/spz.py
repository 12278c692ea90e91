"""Niantic's .spz splats, versions 1 to 4: columns of bytes, in one gzip stream or in a zstd stream each.

Columns: positions (24 bits with a fixed point; halves in version 1), opacities, colours, scales (sixteenths of a
logarithm), and quaternions as x, y, z (8 bits each) or, from version 3, as their three smallest parts.
"""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

import numpy as np
import zstandard

from recon.files.head import Head
from recon.files.quaternions import from_smallest_three
from recon.files.shape import Gaussians, Kind, Recognised, splat_of
from recon.scene import InputError
from recon.system import limits

_MAGIC = b"NGSP"


@dataclass(frozen=True)
class _Header:
    version: int
    count: int
    fraction: int  # bits after the point
    columns: int  # zstd streams, version 4
    table: int  # where their sizes lie, version 4

    @property
    def widths(self) -> tuple[int, int, int, int, int]:
        """Bytes a Gaussian in the columns that are read."""
        return 6 if self.version == 1 else 9, 1, 3, 3, 3 if self.version < 3 else 4


def is_spz(head: Head) -> bool:
    """Whether a file begins with the format's name, in a gzip stream or without."""
    if head.start[:4] == _MAGIC:
        return True
    if head.start[:2] != b"\x1f\x8b":
        return False
    try:
        with gzip.open(head.path) as file:
            return file.read(4) == _MAGIC
    except (OSError, EOFError, zlib.error):
        return False


def describe(path: Path) -> Recognised:
    """From the header. Raises InputError for a version or a size that is not read."""
    return Recognised(Kind.SPLAT, splat_of(_header(path).count, ".spz"))


def read(path: Path) -> Gaussians:
    """All Gaussians. Raises ValueError when it is cut short."""
    header = _header(path)
    places, opacity, _, scale, turn = _packed(path, header) if header.version == 4 else _zipped(path, header)
    return Gaussians(
        _places(places, header),
        opacity[:, 0] / 255,
        np.exp(scale / 16 - 10.0),
        _turns(turn) if header.version >= 3 else _old_turns(turn),
    )


def _header(path: Path) -> _Header:
    with _stream(path) as file:
        head = file.read(32)
    version, count = (int(v) for v in np.frombuffer(head, "<u4", 2, 4))
    if not 1 <= version <= 4:
        raise InputError(f"{path} is an .spz file of version {version}, which is not read here; save it as PLY")
    if count > limits.FACES:
        raise InputError(
            f"{path} claims {count:,} Gaussians, more than the {limits.FACES:,} that are read here; thin it out"
        )
    table = int(np.frombuffer(head, "<u4", 1, 16)[0]) if version == 4 else 0
    return _Header(version, count, head[13], head[15], table)


def _zipped(path: Path, header: _Header) -> list[np.ndarray]:
    with _stream(path) as file:
        file.read(16)
        return [_column(file.read(header.count * width), header.count, width) for width in header.widths]


def _stream(path: Path) -> IO[bytes]:
    """The file without gzip around it."""
    with path.open("rb") as file:
        bare = file.read(4) == _MAGIC
    return path.open("rb") if bare else cast(IO[bytes], gzip.open(path))


def _packed(path: Path, header: _Header) -> list[np.ndarray]:
    data = path.read_bytes()
    sizes = np.frombuffer(data, "<u8", 2 * header.columns, header.table).reshape(-1, 2)
    at, out = header.table + 16 * header.columns, []
    for width, (size, _) in zip(header.widths, sizes, strict=False):
        with zstandard.ZstdDecompressor().stream_reader(data[at : at + int(size)]) as stream:
            out.append(_column(stream.read(header.count * width), header.count, width))
        at += int(size)
    return out


def _column(data: bytes, count: int, width: int) -> np.ndarray:
    if len(data) < count * width:
        raise ValueError(f"it is cut short: fewer than the {count:,} Gaussians its header promises")
    return np.frombuffer(data[: count * width], np.uint8).reshape(count, width)


def _places(column: np.ndarray, header: _Header) -> np.ndarray:
    if header.version == 1:
        return np.ascontiguousarray(column).view("<f2").astype(float)
    low, middle, high = column.reshape(-1, 3, 3).astype(np.int64).transpose(2, 0, 1)
    whole = low | middle << 8 | high << 16
    return (whole - ((whole >> 23) << 24)) / (1 << header.fraction)


def _old_turns(column: np.ndarray) -> np.ndarray:
    """(n, 4), w x y z."""
    part = column / 127.5 - 1
    return np.column_stack([np.sqrt(np.maximum(0, 1 - (part**2).sum(1))), part])


def _turns(column: np.ndarray) -> np.ndarray:
    """(n, 4), w x y z; kept as x, y, z, w without the largest, each with a sign and 9 bits."""
    word = np.ascontiguousarray(column).view("<u4").ravel()
    parts = np.stack([word >> shift & 1023 for shift in (20, 10, 0)], 1).astype(np.int64)
    size = (parts & 511) / 511 * np.sqrt(0.5)
    return from_smallest_three(np.where(parts & 512, -size, size), word >> 30)[:, [3, 0, 1, 2]]
