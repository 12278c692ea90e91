"""Geometry-node graphs written as expressions: numbers add and multiply, groups are called with named inputs.

graph = Graph("slab")
width = graph.number("width", 1.5, 1.0, 2.0, "from side to side")
slab = graph.add("GeometryNodeMeshCube", Size=(width, width / 2, 0.1))
tree = graph.finish(slab)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from procmodels.blender import require
from procmodels.shape import Part


@dataclass(frozen=True)
class Value:
    """What comes out of a node: a number, a vector or geometry. Arithmetic on it adds nodes (vectors by component)."""

    graph: Graph
    socket: Any

    def math(self, operation: str, *others: Any) -> Value:
        """A Math or Vector Math node, with this value as its first input."""
        values = (self, *others)
        vector = any(isinstance(v, tuple) or (isinstance(v, Value) and v.socket.type == "VECTOR") for v in values)
        node = self.graph.tree.nodes.new("ShaderNodeVectorMath" if vector else "ShaderNodeMath")
        node.operation = operation
        for socket, value in zip([s for s in node.inputs if s.enabled], values, strict=False):
            if vector and operation != "SCALE" and isinstance(value, int | float):
                value = (value, value, value)
            self.graph.feed(socket, value)
        return Value(self.graph, next(s for s in node.outputs if s.enabled))

    def __add__(self, other: Any) -> Value:
        return self.math("ADD", other)

    def __radd__(self, other: Any) -> Value:
        return self.math("ADD", other)

    def __sub__(self, other: Any) -> Value:
        return self.math("SUBTRACT", other)

    def __rsub__(self, other: Any) -> Value:
        return (self * -1).math("ADD", other)

    def __mul__(self, other: Any) -> Value:
        return self.math("MULTIPLY", other)

    def __rmul__(self, other: Any) -> Value:
        return self.math("MULTIPLY", other)

    def __truediv__(self, other: Any) -> Value:
        return self.math("DIVIDE", other)

    @property
    def parts(self) -> tuple[Value, Value, Value]:
        """x, y and z of a vector."""
        node = self.graph.tree.nodes.new("ShaderNodeSeparateXYZ")
        self.graph.feed(node.inputs[0], self)
        return (*(Value(self.graph, s) for s in node.outputs),)  # type: ignore[return-value]


class Graph:
    """A geometry-node group in the making."""

    def __init__(self, name: str) -> None:
        self.tree: Any = require("bpy").data.node_groups.new(name, "GeometryNodeTree")
        self._entrance = self.tree.nodes.new("NodeGroupInput")

    def number(self, name: str, default: float, low: float, high: float, about: str, subtype: str = "NONE") -> Value:
        """A slider among the group's inputs; subtype is Blender's: NONE, DISTANCE, ANGLE, FACTOR."""
        return self._input(name, "NodeSocketFloat", default, low, high, about, subtype)

    def integer(self, name: str, default: int, low: int, high: int, about: str) -> Value:
        """A slider of whole numbers among the group's inputs."""
        return self._input(name, "NodeSocketInt", default, low, high, about)

    def vector(self, name: str, about: str) -> Value:
        """A vector among the group's inputs."""
        return self._input(name, "NodeSocketVector", about=about)

    def geometry(self, name: str = "Geometry") -> Value:
        """Geometry among the group's inputs."""
        return self._input(name, "NodeSocketGeometry")

    def material(self, name: str, about: str) -> Value:
        """A material among the group's inputs."""
        return self._input(name, "NodeSocketMaterial", about=about)

    def _input(
        self,
        name: str,
        kind: str,
        default: float | None = None,
        low: float = 0,
        high: float = 0,
        about: str = "",
        subtype: str = "NONE",
    ) -> Value:
        item = self.tree.interface.new_socket(name, description=about, in_out="INPUT", socket_type=kind)
        if default is not None:
            if subtype != "NONE":
                item.subtype = subtype
            item.min_value, item.max_value = low, high
            item.default_value = default
        return Value(self, self._entrance.outputs[item.identifier])

    def add(self, kind: str, settings: dict[str, Any] | None = None, **inputs: Any) -> Value:
        """A node of Blender's type `kind`; inputs by name ("Size" or Vertices_X for "Vertices X"); its first output.

        settings are the node's own properties. An input is a Value, a constant, or a tuple that mixes both (a vector).
        """
        node = self.tree.nodes.new(kind)
        for key, value in (settings or {}).items():
            setattr(node, key, value)
        for key, value in inputs.items():
            named = [s for s in node.inputs if s.enabled and s.name == key.replace("_", " ")]
            self.feed(named[0], value)
        return Value(self, next(s for s in node.outputs if s.enabled))

    def call(self, group: Any, **inputs: Any) -> Value:
        """A finished group as one node."""
        return self.add("GeometryNodeGroup", {"node_tree": group}, **inputs)

    def join(self, *pieces: Value) -> Value:
        """One geometry of several."""
        node = self.tree.nodes.new("GeometryNodeJoinGeometry")
        for piece in reversed(pieces):  # a socket with many links lists the last one first
            self.tree.links.new(piece.socket, node.inputs[0])
        return Value(self, node.outputs[0])

    def feed(self, socket: Any, value: Any) -> None:
        """Link or set one input."""
        if isinstance(value, tuple) and any(isinstance(v, Value) for v in value):
            value = self.add("ShaderNodeCombineXYZ", X=value[0], Y=value[1], Z=value[2])
        if isinstance(value, Value):
            self.tree.links.new(value.socket, socket)
        else:
            socket.default_value = value

    def finish(self, result: Value) -> Any:
        """Blender's node group, with `result` as its output; nodes are laid out from left to right."""
        self.tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        end = self.tree.nodes.new("NodeGroupOutput")
        self.tree.links.new(result.socket, end.inputs[0])
        self._lay_out()
        return self.tree

    def _lay_out(self) -> None:
        column = {node: 0 for node in self.tree.nodes}
        for node in self.tree.nodes:  # made in the order of use: what a node needs stands before it
            for link in (x for s in node.inputs for x in s.links):
                column[node] = max(column[node], column[link.from_node] + 1)
        filled: dict[int, int] = {}
        for node, x in column.items():
            row = filled[x] = filled.get(x, 0) + 1
            node.location = (220.0 * x, -180.0 * row)


def parts_of(mesh: Any, names: Mapping[int, str]) -> list[Part]:
    """Convex parts of a mesh of quadrilaterals, told apart and named by the vertices' integer attribute "part"."""
    vertices, owner = np.empty(3 * len(mesh.vertices), np.float32), np.empty(len(mesh.vertices), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.attributes["part"].data.foreach_get("value", owner)
    corners, sizes = np.empty(len(mesh.loops), np.int32), np.empty(len(mesh.polygons), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.polygons.foreach_get("loop_total", sizes)
    if (sizes != 4).any():
        raise ValueError("the node graph made a face that is no quadrilateral")
    quads = corners.reshape(-1, 4)
    vertices = vertices.reshape(-1, 3).astype(float)
    number = np.empty(len(vertices), int)  # of a vertex in its own part
    parts = []
    for code in np.unique(owner):
        mine = np.flatnonzero(owner == code)
        number[mine] = np.arange(len(mine))
        faces = number[quads[owner[quads[:, 0]] == code]]
        parts.append(Part(names[int(code)], vertices[mine], tuple(map(tuple, faces.tolist())), convex=True))
    return parts
