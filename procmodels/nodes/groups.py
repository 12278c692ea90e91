"""Small node groups that furniture graphs are put together from: a soft box, a row of copies, a lean, a finish."""

from __future__ import annotations

import math
from typing import Any

from procmodels.nodes.graph import Graph
from procmodels.normals import SMOOTH_DEGREES


def soft_box_group() -> Any:
    """A box round the origin with rounded edges and a domed top (+Z) that keeps the box's outer size.

    crown is how much thinner the box is at its corners than in the middle; with both sides domed it is a pillow.
    """
    g = Graph("Soft box")
    size = g.vector("size", "outer size")
    radius = g.number("radius", 0.02, 0.001, 1, "of the edges")
    crown = g.number("crown", 0, 0, 1, "loss of thickness at the corners")
    underside = g.number("underside", 0, 0, 1, "share of the crown that the underside has too")
    segments = g.integer("segments", 3, 1, 8, "faces across half a rounded edge")
    count = segments * 2 + 3
    cube = g.add("GeometryNodeMeshCube", Size=(2, 2, 2), Vertices_X=count, Vertices_Y=count, Vertices_Z=count)

    # Of the cube's lattice the cells at the rim make the round edge, and the middle ones the flat inside it.
    at = g.add("GeometryNodeInputPosition")
    side, out = at.math("SIGN"), at.math("ABSOLUTE")
    cells = segments + 1
    flat = out.math("MULTIPLY", (cells, cells, cells)).math("MINIMUM", 1)
    rim = (out * (cells, cells, cells) - 1).math("MAXIMUM", 0) / (segments, segments, segments)
    half = size * 0.5
    round_off = (rim * (math.pi / 4)).math("TANGENT").math("NORMALIZE").math("SCALE", radius)
    rounded = side * (flat * (half - (radius, radius, radius)) + round_off)

    x, y, z = (rounded / half).parts
    dome = 1 - crown * (x * x + y * y) / 2
    share = underside + (1 - underside) * z.math("GREATER_THAN", 0)
    squash = 1 - share * (1 - dome)
    return g.finish(g.add("GeometryNodeSetPosition", Geometry=cube, Position=rounded * (1, 1, squash)))


def row_group() -> Any:
    """Copies of a piece in a row along X, numbered from `first` in the attribute "part"."""
    g = Graph("Row")
    piece = g.geometry("piece")
    count = g.integer("count", 1, 0, 8, "number of copies")
    start = g.vector("start", "place of the first")
    step = g.number("step", 0, -10, 10, "from one to the next, along X")
    first = g.integer("first", 0, 0, 1000, "part number of the first")
    line = g.add("GeometryNodeMeshLine", Count=count, Start_Location=start, Offset=(step, 0, 0))
    copies = g.add("GeometryNodeInstanceOnPoints", Points=line, Instance=piece)
    numbered = g.add(
        "GeometryNodeStoreNamedAttribute",
        {"data_type": "INT", "domain": "INSTANCE"},
        Geometry=copies,
        Name="part",
        Value=first + g.add("GeometryNodeInputIndex"),
    )
    return g.finish(g.add("GeometryNodeRealizeInstances", Geometry=numbered))


def lean_group() -> Any:
    """Geometry sheared backwards above a level, so that its foot stays where it is."""
    g = Graph("Lean")
    piece = g.geometry("piece")
    tilt = g.number("tilt", 0, 0, 1, "angle from upright", "ANGLE")
    level = g.number("level", 0, 0, 10, "height that does not move")
    _, _, z = g.add("GeometryNodeInputPosition").parts
    offset = (0, (z - level) * tilt.math("TANGENT"), 0)
    return g.finish(g.add("GeometryNodeSetPosition", Geometry=piece, Offset=offset))


def finish_group() -> Any:
    """A material, and shading that is smooth but for the edges that the other files keep sharp too."""
    g = Graph("Finish")
    piece = g.geometry("piece")
    material = g.material("material", "of all faces")
    angle = g.add("GeometryNodeInputMeshEdgeAngle")
    sharp = angle.math("GREATER_THAN", math.radians(SMOOTH_DEGREES))
    smooth = g.add("GeometryNodeSetShadeSmooth", {"domain": "EDGE"}, Mesh=piece, Selection=sharp, Shade_Smooth=False)
    smooth = g.add("GeometryNodeSetShadeSmooth", {"domain": "FACE"}, Mesh=smooth, Shade_Smooth=True)
    return g.finish(g.add("GeometryNodeSetMaterial", Geometry=smooth, Material=material))
