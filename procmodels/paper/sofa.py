"""Sofas: a geometry-node graph with 19 inputs. Lengths are metres beside legs of 0.15 m; the legs keep theirs.

Arms stand on the legs from front to back; between them the base, on it the seat cushions, behind them the back frame,
which leans by shearing (its foot stays on the base), and before the frame the back cushions and the pillows.
"""

from __future__ import annotations

import math
from typing import Any

from procmodels.blender import require
from procmodels.nodes.graph import Graph, Value, parts_of
from procmodels.nodes.groups import finish_group, lean_group, row_group, soft_box_group
from procmodels.shape import Part
from procmodels.space import Integer, Params, ParamSpace, Scalar
from procmodels.units import DEGREES, MODEL, Unit

METRES = Unit("model metres", MODEL)
SPACE = ParamSpace(
    "sofa",
    (
        Scalar("width", 1.5, 2.2, 3, METRES),
        Scalar("depth", 0.8, 1.0, 3, METRES),
        Scalar("seat_height", 0.4, 0.5, 3, METRES),
        Scalar("arm_width", 0.08, 0.24, 3, METRES),
        Scalar("arm_height", 0.08, 0.28, 3, METRES),
        Scalar("back_height", 0.4, 0.54, 3, METRES),
        Scalar("back_tilt", 0.0, 20.0, 3, DEGREES),
        Scalar("back_thickness", 0.08, 0.2, 3, METRES),
        Scalar("cushion_softness", 0.0, 1.0, 3, Unit("0 crisp, 1 plump")),
        Integer("seats", 1, 3),
        Integer("back_cushions", 1, 3),
        Integer("pillows", 0, 2),
    ),
)

# Of real ones: IKEA-Manuals-at-Work, and Sweet Home 3D's Scopia and BlendSwap-CC-0 catalogues.
USUAL_DEPTH = (-0.74, 0.25)
ABOUT = {
    "width": "outer width, over the arms",
    "depth": "from the front of the arms to their rear",
    "seat_height": "top of the seat cushions above the floor",
    "arm_width": "thickness of each arm",
    "arm_height": "top of the arms above the seat",
    "back_height": "top of the back frame above the seat",
    "back_tilt": "how far the back leans, in degrees from upright",
    "back_thickness": "thickness of the back frame",
    "cushion_softness": "0: boxes with crisp edges; 1: plump, rounded cushions",
    "seats": "number of seat cushions",
    "back_cushions": "number of back cushions",
    "pillows": "loose pillows: the first at the sitter's left arm, the second at the right",
}
LEGS = {  # name: value, low, high, meaning
    "leg_height": (0.15, 0.04, 0.2, "floor to the underside of the arms and the base"),
    "leg_width": (0.06, 0.03, 0.1, "of a leg's upper end, from left to right"),
    "leg_depth": (0.06, 0.03, 0.1, "of a leg's upper end, from front to back"),
    "leg_taper": (0.65, 0.3, 1.0, "size of a leg's foot beside its upper end"),
    "leg_splay": (0.15, 0.0, 0.3, "how far a leg slants outwards, as a slope"),
    "leg_inset_x": (0.03, 0.0, 0.2, "from the sofa's sides to the legs' upper ends"),
    "leg_inset_y": (0.04, 0.0, 0.2, "from the sofa's front and rear to the legs' upper ends"),
}

SEAT = 0.15  # thickness of a seat cushion
BACK = 0.16  # thickness of a back cushion
PILLOW = (0.38, 0.38, 0.13)  # width, height, thickness
GAP = 0.044  # between neighbouring cushions, half of it beside the arms
RECESS = 0.02  # of the base behind the front of the arms
REVEAL = 0.05  # of the back frame above the back cushions
SINK = 0.012  # cushions press this deep into what carries them
FRAME_EDGE = 0.012  # radius of the edges of base, arms and back frame

ARM_LEFT, ARM_RIGHT, BACK_FRAME, LEG, SEAT_CUSHION, BACK_CUSHION, LOOSE = 1, 2, 3, 10, 20, 30, 40
NAMES = {0: "base", ARM_LEFT: "arm left", ARM_RIGHT: "arm right", BACK_FRAME: "back frame"}
NAMES |= {
    LEG + i: f"leg {e} {s}" for i, (e, s) in enumerate((e, s) for e in ("front", "back") for s in ("left", "right"))
}
NAMES |= {SEAT_CUSHION + i: f"seat cushion {i + 1}" for i in range(8)}
NAMES |= {BACK_CUSHION + i: f"back cushion {i + 1}" for i in range(8)}
NAMES |= {LOOSE + i: f"pillow {i + 1}" for i in range(8)}

GROUP = "Sofa"
_WORKSHOP = "sofa workshop"


def build(params: Params) -> list[Part]:
    """The parts of a sofa in metres, standing on z = 0, facing -Y, as the evaluated node graph gives them."""
    bpy = require("bpy")
    scene = bpy.data.scenes.get(_WORKSHOP) or _open_workshop(bpy)
    obj = scene.objects[0]
    _set_inputs(obj, params)
    view = scene.view_layers[0]
    view.update()
    return parts_of(obj.evaluated_get(view.depsgraph).data, NAMES)


def live_object(params: Params, material: Any = None) -> Any:
    """A new Blender object, not yet in a collection, whose node modifier builds the sofa, in metres, from 19 inputs."""
    bpy = require("bpy")
    obj = bpy.data.objects.new(GROUP, bpy.data.meshes.new(GROUP))
    modifier = obj.modifiers.new(GROUP, "NODES")
    modifier.node_group = node_group(material)
    _set_inputs(obj, params)
    return obj


def _open_workshop(bpy: Any) -> Any:
    """A scene of its own for the one object that every build evaluates; made anew when another file was opened."""
    scene = bpy.data.scenes.new(_WORKSHOP)
    scene.collection.objects.link(live_object({}))
    return scene


def _set_inputs(obj: Any, params: Params) -> None:
    """Write parameters into the modifier's inputs; degrees become radians, as Blender keeps angles."""
    modifier = obj.modifiers[0]
    for item in modifier.node_group.interface.items_tree:
        if item.name in params:
            value = params[item.name]
            if item.socket_type == "NodeSocketInt":
                modifier[item.identifier] = int(value)
            else:
                modifier[item.identifier] = math.radians(float(value)) if item.subtype == "ANGLE" else float(value)
    obj.update_tag()


# The graph.


def node_group(material: Any = None) -> Any:
    """The sofa's node group, new in Blender's current file: 19 inputs, each with its range and meaning."""
    g = Graph(GROUP)
    inputs = {p.name: _slider(g, p) for p in SPACE.parameters}
    for name, (value, low, high, about) in LEGS.items():
        subtype = "NONE" if name in ("leg_taper", "leg_splay") else "DISTANCE"
        inputs[name] = g.number(name, value, low, high, about, subtype)
    sofa = _Sofa(g, inputs)
    everything = g.join(*sofa.frame(), *sofa.legs(), sofa.seats(), *sofa.leaning())
    return g.finish(g.call(finish_group(), piece=everything, material=material))


def _slider(g: Graph, p: Any) -> Value:
    if isinstance(p, Integer):
        return g.integer(p.name, (p.low + p.high) // 2, p.low, p.high, ABOUT[p.name])
    middle, scale = (p.low + p.high) / 2, 1.0
    subtype = "DISTANCE" if p.unit == METRES else "FACTOR"
    if p.unit == DEGREES:
        subtype, scale = "ANGLE", math.radians(1)
    return g.number(p.name, middle * scale, p.low * scale, p.high * scale, ABOUT[p.name], subtype)


class _Sofa:
    """The inputs of the graph, the lengths that follow from them, and the pieces."""

    def __init__(self, g: Graph, inputs: dict[str, Value]) -> None:
        self.g, self.inputs = g, inputs
        self.soft_box, self.row, self.lean = soft_box_group(), row_group(), lean_group()
        i = inputs
        self.inner = i["width"] - i["arm_width"] * 2  # between the arms
        self.front, self.rear = i["depth"] * -0.5, i["depth"] * 0.5
        self.deck = i["seat_height"] - (SEAT - SINK)  # top of the base
        self.frame_front = self.rear - i["back_thickness"]
        self.edge = 0.008 + i["cushion_softness"] * 0.062  # radius of a cushion's edges
        self.crown = i["cushion_softness"] * 0.6

    def frame(self) -> list[Value]:
        """Base, arms and back frame."""
        i, low, half = self.inputs, self.inputs["leg_height"], self.inner / 2
        arm_top, outer = i["seat_height"] + i["arm_height"], i["width"] / 2
        top = i["seat_height"] + i["back_height"]
        back = self._box(BACK_FRAME, (half * -1, self.frame_front, self.deck), (half, self.rear, top))
        return [
            self._box(0, (half * -1, self.front + RECESS, low), (half, self.rear, self.deck)),
            self._box(ARM_LEFT, (half, self.front, low), (outer, self.rear, arm_top)),
            self._box(ARM_RIGHT, (outer * -1, self.front, low), (half * -1, self.rear, arm_top)),
            self._leaning(back),
        ]

    def legs(self) -> list[Value]:
        """Four tapered legs that slant outwards, from the floor to the underside of arms and base."""
        g, i = self.g, self.inputs
        pieces = []
        for number, (y, x) in enumerate((y, x) for y in (-1, 1) for x in (1, -1)):
            size = (i["leg_width"], i["leg_depth"], i["leg_height"])
            cube = g.add("GeometryNodeMeshCube", Size=size, Vertices_X=2, Vertices_Y=2, Vertices_Z=2)
            px, py, pz = g.add("GeometryNodeInputPosition").parts
            down = 0.5 - pz / i["leg_height"]  # 0 at the upper end, 1 at the foot
            narrow, out = 1 - down * (1 - i["leg_taper"]), down * i["leg_splay"] * i["leg_height"]
            shaped = g.add(
                "GeometryNodeSetPosition", Geometry=cube, Position=(px * narrow + out * x, py * narrow + out * y, pz)
            )
            place = (
                (i["width"] / 2 - i["leg_inset_x"] - i["leg_width"] / 2) * x,
                (i["depth"] / 2 - i["leg_inset_y"] - i["leg_depth"] / 2) * y,
                i["leg_height"] / 2,
            )
            pieces.append(
                self._numbered(g.add("GeometryNodeTransform", Geometry=shaped, Translation=place), LEG + number)
            )
        return pieces

    def seats(self) -> Value:
        """The seat cushions, side by side on the base, up to the back frame."""
        depth = self.frame_front - self.front - GAP / 2
        pitch = self.inner / self.inputs["seats"]
        cushion = self._cushion((pitch - GAP, depth, SEAT))
        start = ((self.inner - pitch) / -2, self.front + GAP / 4 + depth / 2, self.inputs["seat_height"] - SEAT / 2)
        return self._row(cushion, self.inputs["seats"], start, pitch, SEAT_CUSHION)

    def leaning(self) -> list[Value]:
        """Back cushions before the frame and pillows before them, leaning as the frame does."""
        i, foot = self.inputs, self.inputs["seat_height"] - SINK
        height = i["back_height"] + (SINK - REVEAL)
        pitch = self.inner / i["back_cushions"]
        # Made lying on the back, then set upright: the dome looks forwards.
        upright = self._turned(self._cushion((pitch - GAP, height, BACK)))
        start = ((self.inner - pitch) / -2, self.frame_front - BACK / 2, foot + height / 2)
        cushions = self._row(upright, i["back_cushions"], start, pitch, BACK_CUSHION)

        pillow = self.g.call(self.soft_box, size=PILLOW, radius=0.4 * PILLOW[2], crown=0.7, underside=1.0, segments=3)
        y = self.frame_front - (BACK + PILLOW[2] / 2 - SINK)
        from_middle = (self.inner - (PILLOW[0] + GAP)) / 2
        place = (from_middle, y, i["seat_height"] + (PILLOW[1] / 2 - SINK))
        pillows = self._row(self._turned(pillow), i["pillows"], place, from_middle * -2, LOOSE)
        return [self._leaning(cushions), self._leaning(pillows)]

    def _box(self, number: int, low: tuple[Any, Any, Any], high: tuple[Any, Any, Any]) -> Value:
        """A part of the frame between two corners."""
        size = tuple(b - a for a, b in zip(low, high, strict=True))
        centre = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
        box = self.g.call(self.soft_box, size=size, radius=FRAME_EDGE, segments=2)
        return self._numbered(self.g.add("GeometryNodeTransform", Geometry=box, Translation=centre), number)

    def _cushion(self, size: tuple[Any, Any, Any]) -> Value:
        return self.g.call(self.soft_box, size=size, radius=self.edge, crown=self.crown, segments=3)

    def _turned(self, piece: Value) -> Value:
        return self.g.add("GeometryNodeTransform", Geometry=piece, Rotation=(math.pi / 2, 0, 0))

    def _leaning(self, piece: Value) -> Value:
        return self.g.call(self.lean, piece=piece, tilt=self.inputs["back_tilt"], level=self.deck)

    def _row(self, piece: Value, count: Value, start: tuple[Any, Any, Any], step: Value, first: int) -> Value:
        return self.g.call(self.row, piece=piece, count=count, start=start, step=step, first=first)

    def _numbered(self, piece: Value, number: int) -> Value:
        return self.g.add(
            "GeometryNodeStoreNamedAttribute",
            {"data_type": "INT", "domain": "POINT"},
            Geometry=piece,
            Name="part",
            Value=number,
        )
