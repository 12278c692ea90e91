"""The Blender room: primitives through bmesh, a clean session, saving .blend files. Nothing else imports bpy."""

from __future__ import annotations

import math
from collections.abc import Iterable
from types import ModuleType
from typing import Any

import numpy as np

from procmodels.shape import Part

SUPPORTED = ((5, 0), (5, 1))  # tested Blender versions: from, up to but excluding


class BlenderMissing(RuntimeError):
    """Blender's Python module cannot be used; the message says why and what to install."""


def require(name: str) -> Any:
    """bpy, bmesh or mathutils; raises BlenderMissing, with an explanation, when they cannot be loaded."""
    try:
        import bpy

        module: ModuleType = __import__(name)
    except ImportError as error:
        raise BlenderMissing(
            f"Blender's Python module cannot be loaded ({error}). "
            'If it is not installed: pip install "bpy==5.0.1" with Python 3.11 and numpy < 2. '
            "If a system library is missing, on Debian: apt-get install libxrender1 libxi6 libxxf86vm1 libxfixes3 "
            "libxkbcommon0 libsm6 libgl1"
        ) from error
    if not SUPPORTED[0] <= bpy.app.version[:2] < SUPPORTED[1]:
        raise BlenderMissing(f"Blender {bpy.app.version_string} found, {SUPPORTED[0]} to {SUPPORTED[1]} supported")
    return module


def box(
    name: str,
    low: Iterable[float],
    high: Iterable[float],
    bevel: float = 0.0,
    matrix: np.ndarray | None = None,
) -> Part:
    """An axis-aligned box between two corners, its edges rounded by `bevel`, then moved by a (4, 4) matrix."""
    bmesh, mathutils = require("bmesh"), require("mathutils")
    low, high = np.asarray(list(low), float), np.asarray(list(high), float)
    place = mathutils.Matrix.Translation((low + high) / 2) @ mathutils.Matrix.Diagonal((*(high - low), 1))
    bm = bmesh.new()
    bmesh.ops.create_cube(bm, size=1, matrix=place)
    if bevel:
        bmesh.ops.bevel(bm, geom=bm.edges[:], offset=bevel, segments=2, profile=0.5, affect="EDGES")
    return _part(name, bm, matrix)


def cylinder(
    name: str,
    radius: float,
    bottom: Iterable[float],
    top: Iterable[float],
    segments: int = 24,
    top_radius: float | None = None,
) -> Part:
    """A cylinder (or cone frustum) between the centres of its two end discs."""
    bmesh, mathutils = require("bmesh"), require("mathutils")
    start, end = mathutils.Vector(tuple(bottom)), mathutils.Vector(tuple(top))
    axis = end - start
    turn = mathutils.Vector((0, 0, 1)).rotation_difference(axis).to_matrix().to_4x4()
    bm = bmesh.new()
    bmesh.ops.create_cone(
        bm,
        cap_ends=True,
        segments=segments,
        radius1=radius,
        radius2=radius if top_radius is None else top_radius,
        depth=axis.length,
        matrix=mathutils.Matrix.Translation((start + end) / 2) @ turn,
    )
    return _part(name, bm, None)


def rotation(axis: str, degrees: float, about: Iterable[float] = (0, 0, 0)) -> np.ndarray:
    """(4, 4) rotation about the line through `about` along axis "X", "Y" or "Z"."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}[axis]
    matrix = np.eye(4)
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = c, -s, s, c
    centre = np.asarray(list(about), float)
    matrix[:3, 3] = centre - matrix[:3, :3] @ centre
    return matrix


def _part(name: str, bm: Any, matrix: np.ndarray | None) -> Part:
    """Arrays of a finished bmesh, which is freed."""
    vertices = np.array([v.co[:] for v in bm.verts], float)
    faces = tuple(tuple(v.index for v in f.verts) for f in bm.faces)
    bm.free()
    part = Part(name, vertices, faces, convex=True)  # both primitives are convex, bevelled or not
    return part if matrix is None else part.moved(matrix)
