"""Binary glTF 2.0 of an asset: one node, mesh and material a part, one picture for all."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from procmodels.asset import ROUGHNESS, Y_UP_FROM_Z_UP, Asset
from procmodels.look import encoded
from procmodels.normals import with_uv

_FLOAT, _WHOLE = 5126, 5125  # component types
_VERTICES, _INDICES = 34962, 34963  # what a piece of the buffer is for
_LINEAR, _MIPMAPS, _CLAMP = 9729, 9987, 33071


def export_glb(asset: Asset, path: Path) -> None:
    """A binary glTF: Y up, one named node a part, normals smooth by angle, parameters in the scene's extras.

    With a look every part has a material of its own, whose base colour is in its extras when a picture shows it.
    """
    buffer = _Buffer()
    meshes: list[dict[str, Any]] = []
    for i, part in enumerate(asset.shape.parts):
        uv = asset.look.uv[i] if asset.look and asset.look.uv else None
        found = with_uv(part.moved(Y_UP_FROM_Z_UP @ asset.mesh_from_canonical), uv)
        attributes = {
            "POSITION": buffer.accessor(found.places.astype(np.float32), "VEC3", bounds=True),
            "NORMAL": buffer.accessor(found.normals.astype(np.float32), "VEC3"),
        }
        if uv is not None:  # glTF counts down from the picture's upper edge
            attributes["TEXCOORD_0"] = buffer.accessor((found.uv * (1, -1) + (0, 1)).astype(np.float32), "VEC2")
        indices = buffer.accessor(found.triangles.ravel().astype(np.uint32), "SCALAR", bounds=True)
        material = i if asset.look else 0
        primitive = {"attributes": attributes, "indices": indices, "material": material}
        meshes.append({"name": part.name, "primitives": [primitive]})
    tree: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "nnproc-recon"},
        "scene": 0,
        "scenes": [{"name": asset.space.name, "nodes": list(range(len(meshes))), "extras": _extras(asset)}],
        "nodes": [{"name": p.name, "mesh": i} for i, p in enumerate(asset.shape.parts)],
        "meshes": meshes,
        "materials": _materials(asset),
    }
    if asset.look and asset.look.picture is not None:
        view = buffer.add(encoded(asset.look.picture))
        tree["images"] = [{"name": "texture", "mimeType": "image/jpeg", "bufferView": view}]
        tree["samplers"] = [{"magFilter": _LINEAR, "minFilter": _MIPMAPS, "wrapS": _CLAMP, "wrapT": _CLAMP}]
        tree["textures"] = [{"source": 0, "sampler": 0}]
    tree |= {"accessors": buffer.accessors, "bufferViews": buffer.views, "buffers": [{"byteLength": len(buffer.data)}]}
    path.write_bytes(_packed(tree, bytes(buffer.data)))


class _Buffer:
    """The file's binary chunk as it grows."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, piece: bytes, target: int | None = None) -> int:
        """Append a piece; returns the number of its view."""
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(piece)}
        self.views.append(view if target is None else view | {"target": target})
        self.data += piece + b"\0" * (-len(piece) % 4)
        return len(self.views) - 1

    def accessor(self, values: np.ndarray, kind: str, bounds: bool = False) -> int:
        """Append an array (n,) or (n, k); returns the number of its accessor."""
        whole = values.dtype == np.uint32
        view = self.add(values.tobytes(), _INDICES if whole else _VERTICES)
        entry = {"bufferView": view, "componentType": _WHOLE if whole else _FLOAT, "count": len(values), "type": kind}
        if bounds:
            columns = values.reshape(len(values), -1)
            entry |= {"min": columns.min(0).tolist(), "max": columns.max(0).tolist()}
        self.accessors.append(entry)
        return len(self.accessors) - 1


def _materials(asset: Asset) -> list[dict[str, Any]]:
    if asset.look is None:
        return [_material("wood", asset.colours[0])]
    names = [p.name for p in asset.shape.parts]
    if asset.look.picture is None:
        return [_material(n, c) for n, c in zip(names, asset.colours, strict=True)]
    out = []
    for name, colour in zip(names, asset.colours, strict=True):
        entry = _material(name, np.ones(3))
        entry["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
        out.append(entry | {"extras": {"base_color_linear": [round(float(c), 5) for c in colour]}})
    return out


def _material(name: str, colour: np.ndarray) -> dict[str, Any]:
    factor = [*(round(float(c), 5) for c in colour), 1.0]
    return {
        "name": name,
        "pbrMetallicRoughness": {"baseColorFactor": factor, "metallicFactor": 0.0, "roughnessFactor": ROUGHNESS},
    }


def _extras(asset: Asset) -> dict[str, Any]:
    values = {k: v.item() if isinstance(v, np.generic) else v for k, v in asset.params.items()}
    return {"unit": asset.unit, "space_hash": asset.space.hash, **values}


def _packed(tree: dict[str, Any], data: bytes) -> bytes:
    text = json.dumps(tree, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<4sII", b"glTF", 2, size)
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
