"""Laser scans: LAS and LAZ by laspy, E57 by pye57. These packages are extras: pip install "nnproc-recon[scans]"."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np

from recon import limits
from recon.files.head import Head
from recon.files.rows import kept
from recon.files.shape import Cloud, Kind, Recognised, cloud_of
from recon.scene import InputError


def is_las(head: Head) -> bool:
    return head.start[:4] == b"LASF"


def is_e57(head: Head) -> bool:
    return head.start[:8] == b"ASTM-E57"


def describe_las(path: Path) -> Recognised:
    """From the header. Raises InputError without laspy."""
    with _package("laspy", path).open(path) as file:
        return Recognised(Kind.CLOUD, f"{cloud_of(file.header.point_count)} (LAS)")


def read_las(path: Path) -> Cloud:
    """Places in the file's units, at most limits.POINTS of them."""
    with _package("laspy", path).open(path) as file:
        keep, start, parts = kept(file.header.point_count, limits.POINTS), 0, [np.zeros((0, 3))]
        for rows in file.chunk_iterator(limits.POINTS):
            mine = keep[(keep >= start) & (keep < start + len(rows))] - start
            parts.append(np.stack([np.asarray(rows[a], float)[mine] for a in "xyz"], 1))
            start += len(rows)
    return Cloud(np.concatenate(parts))


def describe_e57(path: Path) -> Recognised:
    """From the headers. Raises InputError without pye57."""
    file = _package("pye57", path).E57(str(path))
    try:
        counts = [file.get_header(i).point_count for i in range(file.scan_count)]
    finally:
        file.close()
    scans = f", {len(counts)} scans together" if len(counts) > 1 else ""
    return Recognised(Kind.CLOUD, f"{cloud_of(sum(counts))} (E57{scans})")


def read_e57(path: Path) -> Cloud:
    """All scans in the file's own frame, at most limits.POINTS of their points. Raises InputError for huge scans."""
    file = _package("pye57", path).E57(str(path))
    try:
        counts, parts = [file.get_header(i).point_count for i in range(file.scan_count)], [np.zeros((0, 3))]
        if max(counts, default=0) > 2 * limits.FACES:
            raise InputError(f"{path} has a scan of {max(counts):,} points, more than is read at once; thin it out")
        for i, count in enumerate(counts):
            rows = file.read_scan(i, ignore_missing_fields=True, transform=True)
            found = np.stack([rows[f"cartesian{a}"] for a in "XYZ"], 1)
            parts.append(found[kept(len(found), max(1, round(limits.POINTS * count / sum(counts))))])
    finally:
        file.close()
    return Cloud(np.concatenate(parts))


def _package(name: str, path: Path) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f'{path} is a laser scan that needs {name}: pip install "nnproc-recon[scans]", or save it as PLY'
        ) from error
