"""The room that the studio photographs in: floor, walls, lamps; on request a rug, or a wall close behind the object.

World frame: metres, right-handed, Z up, the object stands on z = 0 over the origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procmodels.studio import materials as materials

Corner = tuple[float, float, float]
_PAPER_LIFT = 2e-4  # metres above the floor, so that the renderer can tell them apart


@dataclass(frozen=True)
class Rug:
    """A rectangle that lies under the object; the floor is lower by its thickness."""

    size: tuple[float, float]  # metres
    image: Path  # covers the rug once
    angle: float = 0.0  # radians about Z
    thickness: float = 0.01  # metres


@dataclass(frozen=True)
class NearWall:
    """A wall right across the room, from floor to ceiling."""

    distance: float  # metres, from the origin
    angle: float  # radians about Z: where it stands
    image: Path  # covers the wall once


@dataclass(frozen=True)
class Paper:
    """A printed page that lies on the floor, flat and without thickness."""

    image: str  # file of the page
    size: tuple[float, float]  # metres, width and height of the page
    place: tuple[float, float]  # metres, its middle
    angle: float = 0.0  # radians about Z, from X to the page's right


@dataclass(frozen=True)
class Room:
    """Four walls round the origin, open above; the object stands in the middle."""

    half_side: float  # metres, from the middle to each wall
    wall_height: float  # metres
    floor_image: Path  # covers the whole floor once
    wall_image: Path  # runs once round the four walls
    light_angle: float = 0.0  # radians about Z: where the main lamp hangs
    rug: Rug | None = None
    near_wall: NearWall | None = None
    papers: tuple[Paper, ...] = ()


def build(room: Room) -> None:
    """Put the room into Blender's scene."""
    s, h = room.half_side, room.wall_height
    low = -room.rug.thickness if room.rug else 0.0
    floor = materials.picture("studio_floor", room.floor_image)
    wall = materials.picture("studio_wall", room.wall_image)
    corners = [(-s, -s), (s, -s), (s, s), (-s, s)]
    _quad("studio_floor", [(x, y, low) for x, y in corners], (0.0, 1.0), floor)
    for i in range(4):
        _wall(f"studio_wall{i}", corners[i], corners[(i + 1) % 4], (low, h), (i / 4, (i + 1) / 4), wall)
    if room.rug:
        _lay(room.rug)
    for i, paper in enumerate(room.papers):
        picture = materials.picture(f"studio_paper{i}", Path(paper.image))
        _quad(f"studio_paper{i}", _turned(paper.size, paper.angle, paper.place, _PAPER_LIFT), (0.0, 1.0), picture)
    if room.near_wall:
        near = room.near_wall
        out = np.array([np.cos(near.angle), np.sin(near.angle)])
        along = np.array([out[1], -out[0]])
        ends = [out * near.distance + side * 1.45 * s * along for side in (-1, 1)]  # the room's diagonal is enough
        picture = materials.picture("studio_near_wall", near.image)
        _wall("studio_near_wall", (ends[0][0], ends[0][1]), (ends[1][0], ends[1][1]), (low, h), (0.0, 1.0), picture)
    _lights(room)


def _lay(rug: Rug) -> None:
    """The rug's upper side at z = 0, and its edges down to the floor."""
    flat = _turned(rug.size, rug.angle)
    picture = materials.picture("studio_rug", rug.image)
    _quad("studio_rug", flat, (0.0, 1.0), picture)
    for i in range(4):
        _wall(f"studio_rug_edge{i}", flat[i][:2], flat[(i + 1) % 4][:2], (-rug.thickness, 0.0), (0.0, 0.02), picture)


def _turned(
    size: tuple[float, float], angle: float, place: tuple[float, float] = (0.0, 0.0), z: float = 0.0
) -> list[Corner]:
    """The corners of a level rectangle, counter-clockwise from its lower left."""
    a, b = size[0] / 2, size[1] / 2
    c, s = np.cos(angle), np.sin(angle)
    flat = ((-a, -b), (a, -b), (a, b), (-a, b))
    return [(place[0] + x * c - y * s, place[1] + x * s + y * c, z) for x, y in flat]


def _wall(
    name: str,
    start: tuple[float, float],
    end: tuple[float, float],
    z: tuple[float, float],
    u: tuple[float, float],
    material: Any,
) -> None:
    (ax, ay), (bx, by) = start, end
    _quad(name, [(ax, ay, z[0]), (bx, by, z[0]), (bx, by, z[1]), (ax, ay, z[1])], u, material)


def _quad(name: str, corners: list[Corner], u: tuple[float, float], material: Any) -> None:
    import bpy

    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="uv")
    for i, uv in enumerate([(u[0], 0.0), (u[1], 0.0), (u[1], 1.0), (u[0], 1.0)]):
        layer.data[i].uv = uv
    mesh.materials.append(material)
    bpy.context.collection.objects.link(bpy.data.objects.new(name, mesh))


def _lights(room: Room) -> None:
    """A large main lamp, a weaker one opposite, and gentle light from above; power grows with the room's area."""
    import bpy
    from mathutils import Vector

    s = room.half_side
    for name, angle, reach, watts in (("key", 0.0, 0.55, 15.0), ("fill", 2.4, 0.6, 7.0)):
        lamp = bpy.data.lights.new(f"studio_{name}", "AREA")
        lamp.shape, lamp.size, lamp.energy = "DISK", 0.5 * s, watts * s * s
        holder = bpy.data.objects.new(lamp.name, lamp)
        turn = room.light_angle + angle
        holder.location = (reach * s * np.cos(turn), reach * s * np.sin(turn), 0.95 * room.wall_height)
        holder.rotation_euler = Vector(-np.array(holder.location)).to_track_quat("-Z", "Y").to_euler()
        bpy.context.collection.objects.link(holder)
    world = bpy.data.worlds.new("studio_world")
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.95, 0.97, 1.0, 1.0)
    background.inputs["Strength"].default_value = 0.8
    world.cycles.sampling_method = "NONE"  # one even colour: chance hits are enough
    bpy.context.scene.world = world
