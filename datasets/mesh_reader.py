"""All triangles of a mesh file of any make, cleaned of what is no number."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import IO, Any

import numpy as np

log = logging.getLogger(__name__)

LARGEST = 1e15  # what is larger is no coordinate


class MeshError(ValueError):
    """The file holds no mesh that can be used; the message names it and says why and what to do."""


def read_triangles(source: Path | IO[bytes], file_type: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) float in the file's axes and units, and triangles (m, 3) int; no materials, no vertex unused.

    file_type  as trimesh calls it; name: of the file, for messages
    Faces with corners that are not numbers are left out. Raises MeshError.
    """
    try:
        points, triangles = scene_triangles(source, file_type)
    except Exception as error:  # a reader of other people's files may fail in any way
        raise MeshError(f"{name} is a damaged mesh ({type(error).__name__}: {error}); export it again") from error
    return usable(points, triangles, name)


def scene_triangles(source: Path | IO[bytes], file_type: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and triangles (m, 3) of all meshes in the scene, where it puts them. Raises anything."""
    import trimesh  # not needed to load this module

    scene = trimesh.load_scene(source, file_type=file_type, process=False, skip_materials=True)
    pieces: list[Any] = [g for g in scene.dump(concatenate=False) if isinstance(g, trimesh.Trimesh)]
    vertices = [np.asarray(p.vertices, float).reshape(-1, 3) for p in pieces]
    offsets = np.cumsum([0] + [len(v) for v in vertices])
    faces = [np.asarray(p.faces, int).reshape(-1, 3) + o for p, o in zip(pieces, offsets, strict=False)]
    return np.concatenate([np.zeros((0, 3)), *vertices]), np.concatenate([np.zeros((0, 3), int), *faces])


def usable(points: np.ndarray, triangles: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) that triangles (m, 3) use, and those whose corners are numbers. Raises MeshError when none is."""
    if not len(triangles):
        raise MeshError(f"{name} is a mesh without faces; export its triangles, or give the points as a cloud")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise MeshError(f"{name} is a damaged mesh: a face names a vertex that is not there; export it again")
    good = (np.abs(points) < LARGEST).all(1)[triangles].all(1)  # NaN is not smaller
    if not good.any():
        raise MeshError(f"{name}: all {len(good):,} faces have corners that are not numbers; export the mesh again")
    if not good.all():
        wrong = int((~good).sum())
        log.warning("%s: %d of %d faces have corners that are not numbers and are left out", name, wrong, len(good))
        triangles = triangles[good]
    # Vertices that no face uses would count in the bounding box.
    used = np.zeros(len(points), bool)
    used[triangles] = True
    return points[used], (np.cumsum(used) - 1)[triangles]
