"""PLY files: meshes (also of strips), clouds, Gaussian splats, and splats packed by chunks."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np

from recon.files.packed_splat import PACKED, unpacked
from recon.files.ply_elements import Column, Header, Lists, columns_of, header_of
from recon.files.polygons import fans, strips
from recon.files.shape import Cloud, Gaussians, Kind, Recognised, Shape, Surface, cloud_of, not_too_many, splat_of
from recon.scene import InputError
from recon.system import limits

_GAUSSIAN = {"scale_0", "rot_0"}


def describe(path: Path) -> Recognised:
    """What a PLY file holds, from its header."""
    header = header_of(path)
    vertex = header.element("vertex")
    faces, names = header.element("face").count, set(vertex.names)
    whole = bool(faces) or "tristrips" in (e.name for e in header.elements) or names >= set(PACKED)
    not_too_many(path, max(faces, vertex.count) if whole else 0)
    if header.element("tristrips").count and not faces:
        return Recognised(Kind.MESH, "a mesh of triangle strips (PLY)")
    if faces:
        return Recognised(Kind.MESH, f"a mesh of {faces:,} faces")
    if names >= set(PACKED):
        return Recognised(Kind.SPLAT, splat_of(vertex.count, "packed PLY"))
    if names >= _GAUSSIAN:
        return Recognised(Kind.SPLAT, splat_of(vertex.count))
    return Recognised(Kind.CLOUD, cloud_of(vertex.count))


def read(path: Path) -> Shape:
    """Whatever the file holds. Raises InputError for vertices without x, y and z, ValueError for damage."""
    kind, header = describe(path).kind, header_of(path)
    if kind == Kind.MESH:
        return _surface(path, header)
    if kind == Kind.CLOUD:
        vertex = cast(dict[str, np.ndarray], columns_of(path, header, ("vertex",), limits.POINTS).get("vertex", {}))
        return Cloud(_places(path, vertex))
    if "chunk" in (e.name for e in header.elements):
        tables = columns_of(path, header, ("chunk", "vertex"), limits.FACES)
        return unpacked(*(cast(dict[str, np.ndarray], tables[name]) for name in ("vertex", "chunk")))
    tables = columns_of(path, header, ("vertex",), limits.GAUSSIANS)
    return _gaussians(path, cast(dict[str, np.ndarray], tables["vertex"]))


def _places(path: Path, vertex: dict[str, np.ndarray]) -> np.ndarray:
    if not {"x", "y", "z"} <= set(vertex):
        raise InputError(
            f"{path}: its vertices have no x, y and z but {', '.join(vertex) or 'nothing'}; save them again"
        )
    return np.stack([vertex[a] for a in "xyz"], 1)


def _surface(path: Path, header: Header) -> Surface:
    tables = columns_of(path, header, ("vertex", "face", "tristrips"), limits.FACES)
    vertices = _places(path, cast(dict[str, np.ndarray], tables["vertex"]))
    polygons, runs = (_corners(tables.get(name, {})) for name in ("face", "tristrips"))
    found = [fans(c.counts, c.values) for c in polygons] + [strips(c.values.astype(np.int64)) for c in runs]
    return Surface(vertices, np.concatenate([np.zeros((0, 3), np.int64), *found]))


def _corners(table: dict[str, Column]) -> list[Lists]:
    """The column of vertex numbers, or the only list; none for an element that is not there."""
    lists = {name: column for name, column in table.items() if isinstance(column, Lists)}
    named = [lists[name] for name in ("vertex_indices", "vertex_index") if name in lists]
    return (named or list(lists.values()))[:1]


def _gaussians(path: Path, vertex: dict[str, np.ndarray]) -> Gaussians:
    """As the usual programs write them: scales are logarithms, opacities logits; two scales make flat discs."""
    scales = [f"scale_{i}" for i in range(3) if f"scale_{i}" in vertex]
    turns = [f"rot_{i}" for i in range(4)]
    sigma = np.exp(np.clip(np.stack([vertex[s] for s in scales], 1), -50, 50))
    return Gaussians(
        _places(path, vertex),
        opaque(vertex["opacity"]) if "opacity" in vertex else None,
        np.pad(sigma, ((0, 0), (0, 3 - len(scales)))) if len(scales) > 1 else None,
        np.stack([vertex[t] for t in turns], 1) if set(turns) <= set(vertex) else None,
    )


def opaque(logit: np.ndarray) -> np.ndarray:
    """Opacity 0..1 of logits."""
    return 1 / (1 + np.exp(-np.clip(logit, -50, 50)))
