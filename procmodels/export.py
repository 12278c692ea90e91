"""A built shape as files for other programs: .blend with its parameters, GLB and OBJ. Only save_blend needs Blender.

All three hold the object standing on the floor plane, in metres when its real size is known and otherwise with its
longest side 1. Axes: .blend as in the canonical frame (X right, faces -Y, Z up); GLB as glTF demands, and OBJ as its
readers assume (Y up, the object faces +Z).
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from procmodels.blender import require
from procmodels.shape import Part, Shape
from procmodels.space import Choice, Integer, Parameter, Params, ParamSpace, Scalar

COLOUR = (0.60, 0.43, 0.27)  # linear RGB of the one material: light oak
ROUGHNESS = 0.6
# Edges below this angle are shaded smooth: a cylinder's facets (15 degrees) vanish, a rounded box edge stays crisp.
SMOOTH_DEGREES = 20.0
_GLTF_FROM_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class Asset:
    """A shape with all that the files say about it.

    metres_per_unit       metres per canonical unit, None when the real size is not known
    world_from_canonical  (4, 4) float similarity into the frame of the photos' cameras, None without photos
    live_object           the model's function of that name, None when it has none
    lengths               metres of the parameters that are lengths and do something, by name
    """

    shape: Shape
    space: ParamSpace
    params: Params
    metres_per_unit: float | None = None
    world_from_canonical: np.ndarray | None = None
    live_object: Callable[[Params, Any], Any] | None = None
    lengths: Mapping[str, float] = field(default_factory=dict)

    @property
    def unit(self) -> str:
        return "longest side = 1" if self.metres_per_unit is None else "metres"

    @property
    def mesh_from_canonical(self) -> np.ndarray:
        """(4, 4) similarity into the frame of the files, before glTF's change of axes."""
        matrix = np.diag([self.metres_per_unit or 1.0] * 3 + [1.0])
        matrix[2, 3] = -matrix[2, 2] * self.shape.bounds()[0, 2]
        return matrix


def save_blend(asset: Asset, path: Path) -> None:
    """A .blend with one object a part, parented to an empty that carries the parameters as custom properties.

    A model with a live object gives that one instead: its modifier builds all parts, and its inputs can be changed.

    Replaces Blender's current session by a clean one. Raises BlenderMissing, and OSError when it cannot be written.
    """
    bpy = require("bpy")
    with redirect_stdout(io.StringIO()):  # Blender reports every saved file there
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene = bpy.context.scene
        scene.unit_settings.system = "NONE" if asset.metres_per_unit is None else "METRIC"
        collection = bpy.data.collections.new(asset.space.name)
        scene.collection.children.link(collection)
        root = bpy.data.objects.new(asset.space.name, None)
        root.empty_display_size = 0.1 * (asset.metres_per_unit or 1.0)
        collection.objects.link(root)
        _set_properties(root, asset)
        material = _material(bpy)
        live = asset.live_object and asset.live_object(asset.params, material)
        for obj in [live] if live else _part_objects(bpy, asset, material):
            obj.parent = root
            collection.objects.link(obj)
        if live:
            _place(bpy, live, asset)
        try:
            bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False, compress=True)
        except RuntimeError as error:  # Blender's operators know no other kind
            raise OSError(f"{path}: {error}") from error


def export_glb(asset: Asset, path: Path) -> None:
    """A binary glTF: Y up, one named node a part, normals smooth by angle, parameters in the scene's extras."""
    import trimesh

    colour = [*(round(255 * c ** (1 / 2.2)) for c in COLOUR), 255]
    material = trimesh.visual.material.PBRMaterial(
        name="wood", baseColorFactor=colour, metallicFactor=0.0, roughnessFactor=ROUGHNESS
    )
    scene = trimesh.Scene(base_frame=asset.space.name)
    scene.metadata.update(unit=asset.unit, space_hash=asset.space.hash, **asset.params)
    for part in asset.shape.parts:
        moved = part.moved(_GLTF_FROM_Z_UP @ asset.mesh_from_canonical)
        vertices, normals, triangles = with_normals(moved)
        mesh = trimesh.Trimesh(vertices, triangles, vertex_normals=normals, process=False)
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(mesh, node_name=part.name, geom_name=part.name)
    path.write_bytes(scene.export(file_type="glb", include_normals=True))


def export_obj(asset: Asset, path: Path, world: bool = False, up: str = "y") -> None:
    """A Wavefront OBJ with the polygons kept and one object a part.

    up     "y", which readers assume, or "z": the axis that points up; the object stands on 0 of it
    world  in the frame of the photos' cameras instead (SfM units, no preferred up)
    """
    lines = [f"# {asset.space.name}"]
    if world:
        if asset.world_from_canonical is None:
            raise ValueError("there is no world frame: world_from_canonical is None")
        matrix = asset.world_from_canonical
        lines.append("# frame: the world of the cameras beside this file; SfM units; no preferred up axis")
    else:
        matrix = (_GLTF_FROM_Z_UP if up == "y" else np.eye(4)) @ asset.mesh_from_canonical
        told = "faces +Z, Y up, standing on y = 0" if up == "y" else "faces -Y, Z up, standing on z = 0"
        lines.append(f"# axes: right-handed, X right, object {told}; unit: {asset.unit}")
    lines += [f"# {name} = {value}" for name, value in asset.params.items()]
    start = 1  # OBJ counts from 1, over all objects
    for part in asset.shape.parts:
        lines.append(f"o {part.name.replace(' ', '_')}")  # many readers end a name at a space
        lines += [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in part.moved(matrix).vertices]
        lines += ["f " + " ".join(str(start + i) for i in face) for face in part.faces]
        start += len(part.vertices)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def with_normals(part: Part) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (m, 3), unit normals (m, 3) and triangles (t, 3) of a part, vertices doubled along sharp edges."""
    owner = np.repeat(np.arange(len(part.faces)), [len(f) for f in part.faces])
    vertex = np.concatenate([np.asarray(f, int) for f in part.faces])
    following = np.concatenate([np.roll(f, -1) for f in part.faces])
    areas = np.zeros((len(part.faces), 3))  # Newell: sums to twice the polygon's area along its normal
    np.add.at(areas, owner, np.cross(part.vertices[vertex], part.vertices[following]))
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-30)

    # A corner's normal: mean over the faces round its vertex that turn away from its own by less than the angle.
    touches = sparse.csr_array((np.ones(len(vertex)), (np.arange(len(vertex)), vertex)))
    corner, other = (touches @ touches.T).nonzero()
    smooth = (normals[owner[corner]] * normals[owner[other]]).sum(1) > np.cos(np.radians(SMOOTH_DEGREES))
    summed = areas[owner].copy()
    keep = smooth & (corner != other)
    np.add.at(summed, corner[keep], areas[owner[other[keep]]])
    summed /= np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-30)

    key = np.concatenate([vertex[:, None], np.rint(summed * 1e4)], 1)
    _, first, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    ends = np.cumsum([len(f) for f in part.faces])
    faces = tuple(tuple(f) for f in np.split(number.ravel(), ends[:-1]))
    triangles = Part(part.name, part.vertices, faces).triangles()
    return part.vertices[vertex[first]], summed[first], triangles


def _part_objects(bpy: Any, asset: Asset, material: Any) -> list[Any]:
    """One object a part, its mesh in the frame of the files."""
    objects = []
    for part in asset.shape.parts:
        objects.append(bpy.data.objects.new(part.name, _mesh(bpy, part.moved(asset.mesh_from_canonical))))
        objects[-1].data.materials.append(material)
    return objects


def _place(bpy: Any, obj: Any, asset: Asset) -> None:
    """Scale and move a live object, whose units are the model's own, to where the shape stands in the file."""
    bpy.context.view_layer.update()
    mesh = obj.evaluated_get(bpy.context.view_layer.depsgraph).data
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    low, high = points.reshape(-1, 3).min(0).astype(float), points.reshape(-1, 3).max(0).astype(float)
    corners = asset.shape.bounds() @ asset.mesh_from_canonical[:3, :3].T + asset.mesh_from_canonical[:3, 3]
    scale = (corners[1] - corners[0]).max() / (high - low).max()
    obj.scale = [scale] * 3
    obj.location = corners.mean(0) - scale * (low + high) / 2


def _mesh(bpy: Any, part: Part) -> Any:
    """A Blender mesh with the part's polygons, smooth by angle."""
    mesh = bpy.data.meshes.new(part.name)
    mesh.from_pydata(part.vertices.tolist(), [], [list(f) for f in part.faces])
    mesh.shade_smooth()
    mesh.set_sharp_from_angle(angle=np.radians(SMOOTH_DEGREES))
    mesh.update()
    return mesh


def _material(bpy: Any) -> Any:
    material = bpy.data.materials.new("wood")
    material.diffuse_color = (*COLOUR, 1)  # what the solid view shows
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*COLOUR, 1)
    shader.inputs["Roughness"].default_value = ROUGHNESS
    return material


def _set_properties(root: Any, asset: Asset) -> None:
    """Parameters with range and description, and where the object came from, as custom properties of the empty."""
    for parameter in asset.space.parameters:
        value = asset.params[parameter.name]
        root[parameter.name] = value.item() if isinstance(value, np.generic) else value
        root.id_properties_ui(parameter.name).update(**_ui(parameter))
    root["space_hash"] = asset.space.hash
    root["unit"] = asset.unit
    if asset.metres_per_unit is not None:
        root["metres_per_unit"] = float(asset.metres_per_unit)
    if asset.world_from_canonical is not None:
        root["world_from_canonical"] = [float(x) for x in asset.world_from_canonical.ravel()]
        about = "rows of the 4 x 4 matrix from the canonical frame to the frame of the photos' cameras"
        root.id_properties_ui("world_from_canonical").update(description=about)


def _ui(parameter: Parameter) -> dict[str, Any]:
    """What Blender shows beside a custom property."""
    told = [parameter.about, parameter.describe(), parameter.only_if and f"only if {parameter.only_if}"]
    ui: dict[str, Any] = {"description": "; ".join(str(t) for t in told if t)}
    if isinstance(parameter, Scalar | Integer):
        ui |= {"min": parameter.low, "max": parameter.high, "soft_min": parameter.low, "soft_max": parameter.high}
    if isinstance(parameter, Choice):
        ui["default"] = parameter.options[0]
    return ui
