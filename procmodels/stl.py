"""A built shape as a binary STL file: closed shells, one a part, for slicers and CAD."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from procmodels.export import Asset
from procmodels.shape import Part, Shape

MILLIMETRES = 1000.0  # of a metre: STL has no units, and programs take its numbers for millimetres
MODEL_SIZE = 100.0  # mm, longest side where the real size is not known
APART = 1e-6  # of the longest side, by which each part is grown more than the one before
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def export_stl(asset: Asset, path: Path) -> None:
    """Z up, standing on z = 0, millimetres; without a real size the longest side is MODEL_SIZE.

    Every part is a closed shell of its own, which slicers take together for one solid.
    """
    scale = MODEL_SIZE if asset.metres_per_unit is None else MILLIMETRES
    matrix = np.diag([scale] * 3 + [1.0]) @ asset.mesh_from_canonical
    corners = np.concatenate([_corners(p.moved(matrix)) for p in _apart(asset.shape)])
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype(float)
    records = np.zeros(len(corners), _TRIANGLE)
    records["corners"] = corners
    records["normal"] = sides / np.maximum(np.linalg.norm(sides, axis=1, keepdims=True), 1e-30)
    what = "millimetres" if asset.metres_per_unit else f"size unknown, longest side {MODEL_SIZE:g} mm"
    head = f"{asset.space.name}, {what}, Z up".encode("ascii", "replace")[:80]  # must not begin with "solid"
    path.write_bytes(head.ljust(80) + np.uint32(len(records)).tobytes() + records.tobytes())


def _apart(shape: Shape) -> list[Part]:
    """The parts, each a little larger than it is, by another amount, so that no two share a corner.

    STL names no vertices: readers join corners that are equal, and two parts that share an edge would make one edge of
    four triangles, which is not closed to them.
    """
    out = []
    for i, part in enumerate(shape.parts):
        low, high = part.vertices.min(0), part.vertices.max(0)
        middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
        grown = middle + (part.vertices - middle) * (1 + APART * (i + 1) / half)
        out.append(Part(part.name, grown, part.faces, part.convex))
    return out


def _corners(part: Part) -> np.ndarray:
    """(t, 3, 3) float32; without triangles of which two corners are one in single precision."""
    corners = part.vertices.astype(np.float32)[part.triangles()]
    same = [(corners[:, i] == corners[:, i - 1]).all(1) for i in range(3)]
    return corners[~np.any(same, axis=0)]
