"""glTF and GLB: the triangles of one scene, placed by its nodes and their instances; or its points, if it has no more.

Skins and morph targets are left out: the shape at rest counts.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from recon.files.gltf_buffers import Buffers, json_of
from recon.files.head import Head
from recon.files.polygons import strips
from recon.files.shape import Cloud, Kind, Recognised, Surface, counted, not_too_many
from recon.scene import InputError

_DRACO = "KHR_draco_mesh_compression"
_INSTANCES = "EXT_mesh_gpu_instancing"
_MOST = 50_000  # parts; a node that hangs below many others counts every time
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


@dataclass(frozen=True)
class _Part:
    """A mesh in the scene: its number, and where it stands: scene_from_mesh (k, 4, 4), one for each instance."""

    mesh: int
    scene_from_mesh: np.ndarray


def is_glb(head: Head) -> bool:
    return head.start[:4] == b"glTF"


def is_gltf(head: Head) -> bool:
    """Whether it is JSON that says of itself that it is glTF."""
    if head.start.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] != b"{":
        return False
    try:
        tree = json.loads(head.path.read_bytes().decode("utf-8-sig"))
    except (ValueError, RecursionError):
        return False
    return isinstance(tree, dict) and isinstance(tree.get("asset"), dict) and ("meshes" in tree or "nodes" in tree)


def describe(path: Path) -> Recognised:
    """Faces, parts and scenes from the JSON. Raises InputError for what cannot be read."""
    tree, buffers = _opened(path)
    parts = _parts(tree, buffers)
    scenes = len(tree.get("scenes", []))
    chosen = f", 1 of {scenes} scenes" if scenes > 1 else ""
    faces = sum(len(p.scene_from_mesh) * _count(tree, q) for p, q in _pieces(tree, parts) if _is_surface(q))
    not_too_many(path, faces)
    if not faces:
        points = sum(len(p.scene_from_mesh) * _vertices(tree, q) for p, q in _pieces(tree, parts))
        return Recognised(Kind.CLOUD, f"a point cloud of {points:,} points (glTF without faces{chosen})")
    pieces = sum(len(p.scene_from_mesh) for p, q in _pieces(tree, parts) if _is_surface(q))
    return Recognised(Kind.MESH, f"a mesh of {counted(faces, 'face')} in {counted(pieces, 'part')}{chosen}")


def read(path: Path) -> Surface | Cloud:
    """The scene that the file opens with, else the first that shows anything."""
    tree, buffers = _opened(path)
    parts = _parts(tree, buffers)
    pieces = list(_pieces(tree, parts))
    surfaces = [(p, q) for p, q in pieces if _is_surface(q)]
    points, triangles, known = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for part, primitive in surfaces or pieces:
        places, faces = _primitive(path, buffers, primitive)
        for pose in part.scene_from_mesh:
            points.append(places @ pose[:3, :3].T + pose[:3, 3])
            triangles.append(faces + known)
            known += len(places)
    if not surfaces:
        return Cloud(np.concatenate(points))
    return Surface(np.concatenate(points), np.concatenate(triangles))


def _opened(path: Path) -> tuple[dict[str, Any], Buffers]:
    tree, own = json_of(path)
    if str(tree.get("asset", {}).get("version", "2")).split(".")[0] != "2":
        raise InputError(f"{path} is glTF of version {tree['asset']['version']}, only 2 is read here; export it again")
    return tree, Buffers(path, tree, own)


def _parts(tree: dict[str, Any], buffers: Buffers) -> list[_Part]:
    """The meshes of the scene that the file opens with; of the first that has any, if that one is empty."""
    scenes = tree.get("scenes") or [{"nodes": _roots(tree)}]
    first = int(tree.get("scene", 0))
    for scene in [*scenes[first : first + 1], *scenes]:
        parts = list(islice(_placed(tree, buffers, scene.get("nodes", [])), _MOST + 1))
        if len(parts) > _MOST:
            raise ValueError(f"more than {_MOST:,} parts")
        if parts:
            return parts
    return []


def _roots(tree: dict[str, Any]) -> list[int]:
    nodes = tree.get("nodes", [])
    below = {child for node in nodes for child in node.get("children", [])}
    return [i for i in range(len(nodes)) if i not in below]


def _placed(tree: dict[str, Any], buffers: Buffers, roots: list[int]) -> Iterator[_Part]:
    """Every mesh below these nodes. Raises ValueError for nodes that are their own ancestors."""
    waiting = [(root, np.eye(4), 0) for root in reversed(roots)]
    while waiting:
        index, scene_from_parent, depth = waiting.pop()
        if depth > len(tree["nodes"]):
            raise ValueError("its nodes go round in a circle")
        node = tree["nodes"][index]
        extensions = node.get("extensions", {})
        if extensions.get("KHR_node_visibility", {}).get("visible") is False:
            continue
        pose = scene_from_parent @ _local(node)
        waiting += [(child, pose, depth + 1) for child in reversed(node.get("children", []))]
        if "mesh" in node:
            copies = _instances(buffers, extensions[_INSTANCES]) if _INSTANCES in extensions else np.eye(4)[None]
            yield _Part(node["mesh"], pose @ copies)


def _local(node: dict[str, Any]) -> np.ndarray:
    """(4, 4) parent_from_node."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    if not {"translation", "rotation", "scale"} & set(node):
        return np.eye(4)
    turn, scale = (
        np.array([node.get(key, usual)], float) for key, usual in (("rotation", (0, 0, 0, 1)), ("scale", (1, 1, 1)))
    )
    return _composed(np.array([node.get("translation", (0, 0, 0))], float), turn, scale)[0]


def _composed(translation: np.ndarray, rotation: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(n, 4, 4) of translations (n, 3), quaternions x y z w (n, 4) and scales (n, 3)."""
    out = np.tile(np.eye(4), (len(translation), 1, 1))
    still = np.linalg.norm(rotation, axis=1) < 1e-9
    turns = Rotation.from_quat(np.where(still[:, None], (0, 0, 0, 1), rotation)).as_matrix()
    out[:, :3, :3], out[:, :3, 3] = turns * scale[:, None, :], translation
    return out


def _instances(buffers: Buffers, extension: dict[str, Any]) -> np.ndarray:
    """(n, 4, 4) node_from_instance."""
    found = {
        name: buffers.accessor(i).astype(float) for name, i in extension.get("attributes", {}).items() if name[0] != "_"
    }
    count = max((len(v) for v in found.values()), default=0)
    usual = {"TRANSLATION": (0, 0, 0), "ROTATION": (0, 0, 0, 1), "SCALE": (1, 1, 1)}
    return _composed(*(found.get(name, np.tile(np.array(value, float), (count, 1))) for name, value in usual.items()))


def _pieces(tree: dict[str, Any], parts: list[_Part]) -> Iterator[tuple[_Part, dict[str, Any]]]:
    """Every primitive of every mesh in the scene."""
    for part in parts:
        for primitive in tree["meshes"][part.mesh]["primitives"]:
            if "POSITION" in primitive.get("attributes", {}):
                yield part, primitive


def _is_surface(primitive: dict[str, Any]) -> bool:
    return primitive.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP, _FAN)


def _vertices(tree: dict[str, Any], primitive: dict[str, Any]) -> int:
    return int(tree["accessors"][primitive["attributes"]["POSITION"]]["count"])


def _count(tree: dict[str, Any], primitive: dict[str, Any]) -> int:
    """How many triangles a primitive has."""
    corners = (
        int(tree["accessors"][primitive["indices"]]["count"]) if "indices" in primitive else _vertices(tree, primitive)
    )
    return corners // 3 if primitive.get("mode", _TRIANGLES) == _TRIANGLES else max(0, corners - 2)


def _primitive(path: Path, buffers: Buffers, primitive: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) float and triangles (m, 3) int; no triangles of points and lines."""
    if _DRACO in primitive.get("extensions", {}):
        places, corners = _unpacked(path, buffers, primitive["extensions"][_DRACO], primitive)
    else:
        places = buffers.accessor(primitive["attributes"]["POSITION"]).astype(float)
        there = "indices" in primitive
        corners = buffers.accessor(primitive["indices"])[:, 0].astype(np.int64) if there else np.arange(len(places))
    mode = primitive.get("mode", _TRIANGLES)
    if mode == _STRIP:
        return places, strips(corners)
    if mode == _FAN:
        return places, np.stack([np.full(max(len(corners) - 2, 0), corners[0]), corners[1:-1], corners[2:]], 1)
    return places, corners[: len(corners) // 3 * 3].reshape(-1, 3) if mode == _TRIANGLES else np.zeros((0, 3), np.int64)


def _unpacked(
    path: Path, buffers: Buffers, packed: dict[str, Any], primitive: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) and corners (m,) of a primitive that Draco packed."""
    import DracoPy  # not needed for most files

    decoded = DracoPy.decode(buffers.view(packed["bufferView"])[0])
    wanted = packed["attributes"]["POSITION"]
    places = next((a["data"] for a in decoded.attributes if a["unique_id"] == wanted), decoded.points)
    said = buffers.tree["accessors"][primitive["attributes"]["POSITION"]]
    places = np.asarray(places, float).reshape(-1, 3)
    if said.get("normalized"):
        places = places / {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}.get(said["componentType"], 1)
    faces = getattr(decoded, "faces", None)
    if faces is None:
        return places, np.arange(len(places))
    return places, np.asarray(faces, np.int64).ravel()
