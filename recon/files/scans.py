"""Laser scans: LAS and LAZ by laspy, E57 by pye57. These packages are extras: pip install "nnproc-recon[scans]".

A damaged file can end the process that decodes it, so that it is one of its own:
`python -m recon.files.scans FILE PACKAGE OUT.npz`.
"""

from __future__ import annotations

import importlib.util
import resource
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from recon.files.child import arrays_of
from recon.files.head import Head
from recon.files.rows import kept
from recon.files.shape import Cloud, Kind, Recognised, cloud_of
from recon.scene import InputError
from recon.system import limits

_LAS_RECORD = 54  # bytes of the shortest record before the points


def is_las(head: Head) -> bool:
    return head.start[:4] == b"LASF"


def is_e57(head: Head) -> bool:
    return head.start[:8] == b"ASTM-E57"


def describe_las(path: Path) -> Recognised:
    """From the header. Raises InputError without laspy, and for a header that claims more than the file has."""
    _required("laspy", path)
    with path.open("rb") as file:
        head = file.read(375)
    first, records = int.from_bytes(head[96:100], "little"), int.from_bytes(head[100:104], "little")
    if max(first, _LAS_RECORD * records) > path.stat().st_size:
        raise InputError(f"{path} is a damaged LAS file, or cut short; save it again")
    old, new = int.from_bytes(head[107:111], "little"), int.from_bytes(head[247:255], "little")
    return Recognised(Kind.CLOUD, f"{cloud_of(new if head[25] >= 4 else old)} (LAS)")


def describe_e57(path: Path) -> Recognised:
    """Raises InputError without pye57."""
    _required("pye57", path)
    return Recognised(Kind.CLOUD, "a point cloud (E57)")


def read(package: str) -> Callable[[Path], Cloud]:
    """A reader by this package: places in the file's frame and units, at most limits.POINTS of them."""

    def cloud(path: Path) -> Cloud:
        _required(package, path)
        return Cloud(
            arrays_of(path, "recon.files.scans", str(path.absolute()), package, advice="save it as PLY")["points"]
        )

    return cloud


def _required(package: str, path: Path) -> None:
    if importlib.util.find_spec(package) is None:
        raise InputError(
            f'{path} is a laser scan that needs {package}: pip install "nnproc-recon[scans]", or save it as PLY'
        )


def _las(file: str) -> np.ndarray:
    import laspy

    with laspy.open(file) as scan:
        keep, start, parts = kept(scan.header.point_count, limits.POINTS), 0, [np.zeros((0, 3))]
        for rows in scan.chunk_iterator(limits.POINTS):
            mine = keep[(keep >= start) & (keep < start + len(rows))] - start
            parts.append(np.stack([np.asarray(rows[a], float)[mine] for a in "xyz"], 1))
            start += len(rows)
    return np.concatenate(parts)


def _e57(file: str) -> np.ndarray:
    """All scans, each in its place."""
    import pye57

    scan, parts = pye57.E57(file), [np.zeros((0, 3))]
    counts = [scan.get_header(i).point_count for i in range(scan.scan_count)]
    if max(counts, default=0) > 2 * limits.FACES:
        raise SystemExit(f"a scan of {max(counts):,} points is more than is read at once")
    for i, count in enumerate(counts):
        rows = scan.read_scan(i, ignore_missing_fields=True, transform=True)
        found = np.stack([rows[f"cartesian{a}"] for a in "XYZ"], 1)
        parts.append(found[kept(len(found), max(1, round(limits.POINTS * count / sum(counts))))])
    return np.concatenate(parts)


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (limits.UNPACKED, limits.UNPACKED))
    np.savez(sys.argv[3], points={"laspy": _las, "pye57": _e57}[sys.argv[2]](sys.argv[1]))
