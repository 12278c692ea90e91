"""Splats of programs for the web: .splat (rows of 32 bytes) and .ksplat (sections of such rows, packed or not)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recon.files.head import Head
from recon.files.rows import kept, picked
from recon.files.shape import Gaussians, Kind, Recognised, splat_of
from recon.scene import InputError
from recon.system import limits

_ROW = np.dtype([("at", "<f4", 3), ("sigma", "<f4", 3), ("colour", "u1", 4), ("turn", "u1", 4)])
_HEAD, _SECTION = 4096, 1024  # bytes of a .ksplat's header, and of each section's
_WHOLE = [("at", "<f4", 3), ("sigma", "<f4", 3), ("turn", "<f4", 4), ("colour", "u1", 4)]
_HALVES = [("at", "<u2", 3), ("sigma", "<f2", 3), ("turn", "<f2", 4), ("colour", "u1", 4)]
_GRADES = (_WHOLE, _HALVES, _HALVES)  # rows by a .ksplat's grade of packing; shading follows
_SHADING = np.array([0, 9, 24, 45])  # numbers a row, by degree
_SHADING_BYTES = (4, 2, 1)  # by grade


def is_splat(head: Head) -> bool:
    """Whether these are rows of 32 bytes with sizes above zero and quaternions of length one: it has no name inside."""
    if head.size % _ROW.itemsize or head.size < 20 * _ROW.itemsize:
        return False
    rows = np.frombuffer(head.start[: len(head.start) // _ROW.itemsize * _ROW.itemsize], _ROW)
    with np.errstate(invalid="ignore"):
        places, sigma = rows["at"].astype(float), rows["sigma"].astype(float)
    length = np.linalg.norm(rows["turn"] / 128 - 1.0, axis=1)
    good = np.isfinite(places).all(1) & (np.abs(places) < 1e6).all(1) & (sigma >= 0).all(1) & (sigma < 1e5).all(1)
    return bool((good & (np.abs(length - 1) < 0.1)).mean() > 0.95 and np.ptp(places, axis=0).max() > 1e-9)


def describe_splat(path: Path) -> Recognised:
    return Recognised(Kind.SPLAT, splat_of(path.stat().st_size // _ROW.itemsize, ".splat"))


def read_splat(path: Path) -> Gaussians:
    count = path.stat().st_size // _ROW.itemsize
    with path.open("rb") as file:
        rows = picked(file, _ROW, count, kept(count, limits.GAUSSIANS))
    return Gaussians(
        rows["at"].astype(float), rows["colour"][:, 3] / 255, rows["sigma"].astype(float), rows["turn"] / 128 - 1.0
    )


def is_ksplat(head: Head) -> bool:
    """Whether it begins with version 0.1 to 0.9 and a header that is nearly empty."""
    start = head.start[:_HEAD]
    return head.size >= _HEAD and start[0] == 0 and 1 <= start[1] <= 9 and not any(start[44:]) and not any(start[2:4])


def describe_ksplat(path: Path) -> Recognised:
    """From the header. Raises InputError when it promises nothing, or more than the file holds."""
    with path.open("rb") as file:
        head = file.read(_HEAD)
    sections, _, _, count = (int(v) for v in np.frombuffer(head, "<u4", 4, 4))
    grade, size = int.from_bytes(head[20:22], "little"), path.stat().st_size
    if not count or grade > 2 or _HEAD + sections * _SECTION + count * np.dtype(_HALVES).itemsize > size:
        raise InputError(
            f"{path} is a damaged .ksplat file: its header promises {count:,} Gaussians in {sections:,} sections, "
            f"packed by grade {grade}, which its {size:,} bytes do not hold; export it again, or save it as PLY"
        )
    return Recognised(Kind.SPLAT, splat_of(count, ".ksplat"))


def read_ksplat(path: Path) -> Gaussians:
    """Raises ValueError when it is cut short."""
    if path.stat().st_size > limits.UNPACKED // 4:
        raise ValueError("it is larger than 1 GB")
    data = path.read_bytes()
    sections, grade = int(np.frombuffer(data, "<u4", 1, 4)[0]), int.from_bytes(data[20:22], "little")
    at, parts = _HEAD + sections * _SECTION, []
    for i in range(sections):
        rows, places, at = _section(data, _HEAD + i * _SECTION, at, grade)
        turns, sigma = rows["turn"].astype(float), rows["sigma"].astype(float)
        parts.append((places, rows["colour"][:, 3] / 255, sigma, turns))
    return Gaussians(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _section(data: bytes, head: int, at: int, grade: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Rows and places (n, 3) of one section whose header and data begin there, and where the next one's data begin."""
    count, capacity, bucket, buckets = (int(v) for v in np.frombuffer(data, "<u4", 4, head))
    side = float(np.frombuffer(data, "<f4", 1, head + 16)[0])
    stored = int.from_bytes(data[head + 20 : head + 22], "little")
    reach = int.from_bytes(data[head + 24 : head + 28], "little") or (1 if grade == 0 else 32767)
    full, partial = (int(v) for v in np.frombuffer(data, "<u4", 2, head + 32))
    degree = int.from_bytes(data[head + 40 : head + 42], "little")
    tail = int(_SHADING[degree]) * _SHADING_BYTES[grade]
    kind = np.dtype([*_GRADES[grade], ("shading", "u1", tail)])
    sizes = np.frombuffer(data, "<u4", partial, at)
    middles = np.frombuffer(data, "<f4", 3 * buckets, at + 4 * partial).reshape(-1, 3)
    begin = at + 4 * partial + stored * buckets
    rows = np.frombuffer(data, kind, count, begin)
    places = rows["at"].astype(float)
    if grade:
        mine = np.repeat(np.arange(full + partial), np.concatenate([np.full(full, bucket), sizes]).astype(int))[:count]
        places = (places - reach) * (side / 2 / reach) + middles[mine]
    return rows, places, begin + kind.itemsize * capacity
