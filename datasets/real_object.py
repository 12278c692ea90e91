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
from typing import Any

import numpy as np
import trimesh

log = logging.getLogger(__name__)

CLASSES = ("bed", "chair", "shelf", "sofa", "table")
AXES = {s + a: (-1.0 if s == "-" else 1.0) * np.eye(3)[i] for s in ("", "+", "-") for i, a in enumerate("xyz")}
FLAT = 1e-6  # of the longest side: an object lower than this is no object


class DataError(ValueError):
    """A folder, a file or an object in it is not usable; the message says why and what to do."""


def turn(up: str, front: str) -> np.ndarray:
    """(3, 3) rotation, canonical from file, for a file whose `up` and `front` are axes such as "y" or "-z"."""
    if up not in AXES or front not in AXES:
        raise DataError(f"up and front are axes such as y or -z, not {up!r} and {front!r}")
    z, y = AXES[up], -AXES[front]
    if abs(z @ y) > 0.5:
        raise DataError(f"up ({up}) and front ({front}) lie on one axis")
    return np.array([np.cross(y, z), y, z])


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
    """All triangles of a mesh file's bytes; `file_type` as trimesh calls it, `source` for messages."""
    try:
        scene = trimesh.load_scene(io.BytesIO(content), file_type=file_type, process=False, skip_materials=True)
        pieces: list[Any] = [g for g in scene.dump(concatenate=False) if isinstance(g, trimesh.Trimesh)]
    except Exception as error:  # a reader of other people's files may fail in any way
        raise DataError(f"{source} is a damaged mesh ({type(error).__name__}: {error}); get it again") from error
    vertices = [np.asarray(p.vertices, float).reshape(-1, 3) for p in pieces]
    offsets = np.cumsum([0] + [len(v) for v in vertices])
    faces = [np.asarray(p.faces, int).reshape(-1, 3) + o for p, o in zip(pieces, offsets, strict=False)]
    if not sum(map(len, faces)):
        raise DataError(f"{source} has no faces: an empty or damaged mesh; get it again")
    points, triangles = np.concatenate(vertices), np.concatenate(faces)
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise DataError(f"{source} is a damaged mesh: a face names a vertex that is not there; get it again")
    good = np.isfinite(points).all(1)[triangles].all(1)
    if not good.any():
        raise DataError(f"{source}: all faces have corners that are not numbers; get it again")
    # Vertices that no face uses would count in the bounding box.
    used, triangles = np.unique(triangles[good], return_inverse=True)
    return trimesh.Trimesh(points[used], triangles.reshape(-1, 3), process=False)


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
