"""Primitives in plain arrays: closed, facing outwards, where and as large as asked, their convexity told truly."""

import math

import numpy as np
import pytest
import trimesh

from procmodels.parts import primitives
from procmodels.parts.primitives import (
    Plane,
    beam,
    box,
    cylinder,
    lathe,
    loft,
    mirrored,
    plate,
    rotation,
    rounded,
    sheet,
    sweep,
    torus,
    upright,
)


def _mesh(part):
    return trimesh.Trimesh(part.vertices, part.triangles(), process=False)


def _arc_sheet(bend):
    """A sheet that faces -Y, 1 wide, 2 high and 0.1 thick, curved in plan."""
    x = np.linspace(-0.5, 0.5, 7)
    front = np.stack(np.broadcast_arrays(x, -bend * (2 * x) ** 2, np.linspace(0, 2, 3)[:, None]), -1)
    return sheet("sheet", front, front + np.array([0, 0.1, 0]), convex=bend == 0)


def _helix():
    t = np.linspace(0, 1, 9)
    path = np.stack([np.cos(t), np.sin(t), t], 1)
    across = np.stack([np.cos(t), np.sin(t), 0 * t], 1)
    return sweep("handrail", path, across, (0.05, 0.1), sides=8)


ROUND = 1 - (1 - math.pi / 4) * 0.99**2  # area of the roundest outline in a square of side 1
CONE = math.pi * 2 / 3 * (0.25 + 0.05 + 0.01)  # of radii 0.5 and 0.1, 2 high
CASES = {
    "box": (box("b", (1, 2, 3), (2, 4, 6)), 6.0, True),
    "turned box": (box("b", (1, 2, 3), (2, 4, 6), matrix=rotation("Y", 30, (1, 1, 1))), 6.0, True),
    "bevelled box": (box("b", (0, 0, 0), (1, 2, 3), bevel=1e-4), 6.0, True),
    "roundest box": (box("b", (0, 0, 0), (1, 1, 1), bevel=5.0), None, True),
    "leg": (beam("l", (0, 0, 0), (0.2, 0.3, 2), (0.2, 0.1), (0.4, 0.2)), 2 * 0.14 / 3, True),
    "leg downwards": (beam("l", (0.2, 0.3, 2), (0, 0, 0), (0.4, 0.2), (0.2, 0.1)), 2 * 0.14 / 3, True),
    "stretcher": (beam("s", (0, 0, 0), (2, 0.1, 0.3), (0.1, 0.2), cut="X"), 0.04, True),
    "rail": (beam("s", (0, 3, 0), (0.1, 0, 0.3), (0.1, 0.2), cut="Y"), 0.06, True),
    "round leg": (beam("l", (0, 0, 0), (0.5, 0, 1), (0.2, 0.2), sides=48), math.pi / 100 * 0.9971, True),  # 48 corners
    "post under a slope": (upright("p", (0, 0), (0.5, 0), (0.2, 0.2), (0.2, 0.2), high=Plane(1, -0.3)), 0.04, True),
    "ring": (torus("t", 0.5, 0.1, 1.0, segments=64, sides=32), math.pi**2 * 0.0025, False),
    "cylinder": (cylinder("c", 0.5, (0, 0, 0), (0, 0, 2), segments=96), math.pi / 2, True),
    "frustum": (cylinder("c", 0.5, (1, 0, 0), (1, 2, 0), segments=96, top_radius=0.1), CONE, True),
    "frustum downwards": (cylinder("c", 0.5, (1, 0, 0), (1, 0, -2), segments=96, top_radius=0.1), CONE, True),
    "plate": (plate("p", rounded(2, 1, 0.0), 1, 3), 4.0, True),
    "round plate": (plate("p", rounded(2, 1, 1.0, arc=24), 1, 3), 4 * ROUND, True),
    "turned vase": (lathe("v", [(0.2, 0), (0.5, 1), (0.1, 2), (0.3, 3)]), None, False),
    "turned bowl": (lathe("v", [(0.2, 0), (0.5, 1), (0.6, 2)]), None, True),
    "flat sheet": (_arc_sheet(0.0), 0.2, True),
    "bent sheet": (_arc_sheet(0.3), 0.2, False),
    "handrail": (_helix(), None, False),
    "mirrored": (mirrored(beam("l", (0.5, 0, 0), (1, 0, 2), (0.2, 0.1)), "r"), 0.04, True),
}


@pytest.mark.parametrize("case", CASES)
def test_parts_are_closed_and_as_large_as_asked(case):
    part, volume, convex = CASES[case]
    mesh = _mesh(part)
    assert mesh.is_watertight
    assert mesh.volume > 0
    assert mesh.is_convex == part.convex == convex
    if volume is not None:
        assert mesh.volume == pytest.approx(volume, rel=1e-2 if part.name == "t" else 2e-3)


@pytest.mark.parametrize("case", CASES)
def test_every_face_is_a_plane_polygon(case):
    part = CASES[case][0]
    for face in part.faces if case != "handrail" and case != "roundest box" else ():
        corners = part.vertices[list(face)]
        away = np.linalg.svd(corners - corners.mean(0))[1][-1] if len(face) > 3 else 0
        assert away < 2e-3 * np.ptp(part.vertices), face
        assert len(set(face)) == len(face)


def test_boxes_and_beams_end_where_they_are_told():
    part = CASES["box"][0]
    assert part.vertices.min(0).tolist() == [1, 2, 3]
    assert part.vertices.max(0).tolist() == [2, 4, 6]
    assert CASES["roundest box"][0].vertices.min(0) == pytest.approx([0, 0, 0])
    foot = CASES["leg"][0].vertices[:4]
    assert foot[:, 2] == pytest.approx(0), "feet stand flat"
    assert np.ptp(foot, axis=0) == pytest.approx([0.2, 0.1, 0])
    rail = CASES["rail"][0].vertices
    assert rail[rail[:, 1] < 1].mean(0) == pytest.approx([0.1, 0, 0.3])
    assert np.ptp(rail[rail[:, 1] < 1], axis=0) == pytest.approx([0.2, 0, 0.1])


def test_a_bevel_is_round():
    """All vertices of a cube's corner but those on its sides lie on the ball that fits into the bevel."""
    part = box("b", (0, 0, 0), (1, 1, 1), bevel=0.25)
    corner = part.vertices[(part.vertices < 0.5).all(1)]
    assert len(corner) == 7
    assert np.linalg.norm(corner - 0.25, axis=1) == pytest.approx(0.25)


def test_outlines_go_from_rectangle_to_ellipse():
    assert rounded(2, 1, 0.0, arc=2).max(0) == pytest.approx([1, 0.5])
    round_one = rounded(2, 1, 1.0)
    assert (round_one[:, 0] ** 2 + (2 * round_one[:, 1]) ** 2) == pytest.approx(1, abs=0.02)
    for share in (0.0, 0.3, 1.0):
        outline = rounded(2, 1, share)
        steps = np.linalg.norm(np.roll(outline, -1, 0) - outline, axis=1)
        assert steps.min() > 1e-3, "vertices are apart"
        assert np.ptp(outline, axis=0) == pytest.approx([2, 1])


def test_mirroring_keeps_the_cut_of_the_faces():
    part = CASES["leg"][0]
    other = mirrored(part, "other")
    assert other.name == "other"
    assert (other.vertices == part.vertices * [-1, 1, 1]).all()
    assert {frozenset(t) for t in other.triangles().tolist()} == {frozenset(t) for t in part.triangles().tolist()}


def test_rings_may_lean():
    rings = np.stack([np.c_[rounded(1, 1, 1, arc=20) + 0.2 * z * z, np.full(80, z)] for z in (0, 1, 2)])
    mesh = _mesh(loft("horn", rings))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(2 * ROUND, rel=2e-3)


def test_no_blender_is_needed():
    assert "bpy" not in vars(primitives)
    assert all(getattr(v, "__name__", "") not in ("bpy", "bmesh", "mathutils") for v in vars(primitives).values())
