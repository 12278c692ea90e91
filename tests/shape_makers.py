"""A chair of six boxes, and small writers of files as people have them."""

from __future__ import annotations

import json
import struct

import numpy as np

BOXES = [  # low and high corners; Z up
    *(((x, y, 0), (x + 0.04, y + 0.04, 0.43)) for x in (-0.225, 0.185) for y in (-0.25, 0.21)),
    ((-0.225, -0.25, 0.43), (0.225, 0.25, 0.47)),
    ((-0.225, 0.21, 0.47), (0.225, 0.25, 0.92)),
]
QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
TRIANGLES = QUADS[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def corners(low, high) -> np.ndarray:
    """(8, 3) of a box."""
    return np.array([(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])], float)


VERTICES = np.concatenate([corners(*box) for box in BOXES])
CHAIR_QUADS = np.concatenate([QUADS + 8 * i for i in range(len(BOXES))])
CHAIR = np.concatenate([TRIANGLES + 8 * i for i in range(len(BOXES))])


def assert_chair(surface, turn=np.eye(3), scale=1.0, atol=1e-4) -> None:
    """Whether triangles are those of the chair, in any order, after turn (3, 3) and scale."""
    found = _in_order(surface.vertices[surface.triangles])
    np.testing.assert_allclose(found, _in_order((scale * VERTICES @ np.transpose(turn))[CHAIR]), atol=atol * scale)


def _in_order(triangles: np.ndarray) -> np.ndarray:
    """(m, 3) middles of the triangles, sorted: two files with the same ones agree."""
    middles = triangles.mean(1).round(3)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    order = np.lexsort((*middles.T, area.round(3)))
    return np.column_stack([triangles.mean(1), area])[order]


def surface_points(rng, count=3000) -> np.ndarray:
    """(count, 3) points on the chair."""
    triangles = VERTICES[CHAIR]
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    a, b, c = triangles[rng.choice(len(triangles), count, p=area / area.sum())].transpose(1, 0, 2)
    u, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return (1 - u) * a + u * (1 - v) * b + u * v * c


class Gltf:
    """A glTF file in the making: arrays become accessors of one buffer."""

    def __init__(self) -> None:
        self.data = b""
        self.tree: dict = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "meshes": [], "nodes": []}

    def view(self, data: bytes, **more) -> int:
        self.data += bytes(-len(self.data) % 4)
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, array, **more) -> int:
        array = np.asarray(array)
        kinds = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
        said = {"componentType": kinds[array.dtype.str[1:]], "count": len(array)}
        said["type"] = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        if "bufferView" not in more and "sparse" not in more:
            said["bufferView"] = self.view(array.tobytes())
        self.tree["accessors"].append({**said, **more})
        return len(self.tree["accessors"]) - 1

    def mesh(self, vertices, triangles, **primitive) -> int:
        attributes = {"POSITION": vertices if isinstance(vertices, int) else self.accessor(np.asarray(vertices, "f4"))}
        indices = self.accessor(np.asarray(triangles, "u2").ravel())
        self.tree["meshes"].append({"primitives": [{"attributes": attributes, "indices": indices, **primitive}]})
        return len(self.tree["meshes"]) - 1

    def node(self, **node) -> int:
        self.tree["nodes"].append(node)
        return len(self.tree["nodes"]) - 1

    def glb(self, path, *others):
        """With its own buffer, and others as they are said."""
        data = self.data + bytes(-len(self.data) % 4)
        self.tree["buffers"] = [{"byteLength": len(data)}, *others]
        text = json.dumps(self.tree).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
        path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)
        return path

    def gltf(self, path, uri, buffer=None):
        """With its buffer in the file `buffer`, or nowhere."""
        if buffer is not None:
            buffer.write_bytes(self.data)
        self.tree["buffers"] = [{"byteLength": len(self.data), "uri": uri}]
        path.write_text(json.dumps(self.tree))
        return path
