"""One real object of any source: where its mesh is, how its axes lie, and the way into the canonical frame.

Canonical frame: right-handed, X right, the object faces -Y, Z up, bounding box centred on the origin, longest side 1.
"""

from __future__ import annotations

import dataclasses
import io
import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh

from datasets.mesh_reader import MeshError, read_triangles

log = logging.getLogger(__name__)

CLASSES = ("bed", "chair", "shelf", "sofa", "table")
FLAT = 1e-6  # of the longest side: an object lower than this is no object


class DataError(ValueError):
    """A folder, a file or an object in it is not usable; the message says why and what to do."""


@dataclass(frozen=True)
class RealObject:
    """One object. Listing reads no mesh; `load` does.

    data                 short name of the source, such as "ikea_dev", "Scopia" or "ShapeNetCore.v2"
    class_name           bed, chair, shelf, sofa or table
    name                 unique inside data and class
    source               file or archive member that the mesh comes from
    mask                 a picture of it, white = object, if there is one
    canonical_from_file  (3, 3) rotation
    read                 the mesh in the file's axes and units
    """

    data: str
    class_name: str
    name: str
    source: str
    mask: Path | None
    canonical_from_file: np.ndarray = field(repr=False, compare=False)
    read: Callable[[], trimesh.Trimesh] = field(repr=False, compare=False)

    def load(self) -> trimesh.Trimesh:
        """All parts as one mesh in the canonical frame, without materials. Raises DataError naming a bad file."""
        mesh = self.read()
        return trimesh.Trimesh(
            canonical(mesh.vertices, self.canonical_from_file, self.source), mesh.faces, process=False
        )


def canonical(vertices: np.ndarray, rotation: np.ndarray, source: str) -> np.ndarray:
    """Vertices (n, 3), turned, centred and scaled to the canonical frame. Raises DataError when they have no size."""
    turned = np.asarray(vertices, float) @ rotation.T
    low, high = turned.min(0), turned.max(0)
    longest = float((high - low).max())
    if not longest > 0 or (high - low)[2] <= FLAT * longest:
        raise DataError(f"{source}: the mesh is flat on the floor, or its axes are wrong; look at it")
    return (turned - (low + high) / 2) / longest


def read_mesh(file: Path) -> trimesh.Trimesh:
    """All triangles of a mesh file, in its own axes. Raises DataError for damage and for a mesh without faces."""
    try:
        content = file.read_bytes()
    except OSError as error:
        raise DataError(f"{file} cannot be read ({error.strerror or error}); get it again") from error
    return parse_mesh(content, file.suffix.lower().lstrip("."), str(file))


def parse_mesh(content: bytes, file_type: str, source: str) -> trimesh.Trimesh:
    """All triangles of a mesh file's bytes; `file_type` as trimesh calls it, `source` names it. Raises DataError."""
    try:
        vertices, faces = read_triangles(io.BytesIO(content), file_type, source)
    except MeshError as error:
        raise DataError(str(error)) from error
    return trimesh.Trimesh(vertices, faces, process=False)


def with_unique_names(objects: list[RealObject]) -> list[RealObject]:
    """The same objects; where names repeat inside data and class, the later ones get "-2", "-3" and so on."""
    seen: Counter[tuple[str, str, str]] = Counter()
    out = []
    for item in objects:
        key = item.data, item.class_name, item.name
        seen[key] += 1
        name = item.name if seen[key] == 1 else f"{item.name}-{seen[key]}"
        out.append(dataclasses.replace(item, name=name))
    return out
