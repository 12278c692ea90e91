"""A Blender file of an asset: named parts, materials, and the parameters as custom properties. Needs Blender."""

from __future__ import annotations

import io
import tempfile
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from procmodels.asset import ROUGHNESS, Asset
from procmodels.blender import require
from procmodels.look import encoded
from procmodels.normals import SMOOTH_DEGREES
from procmodels.shape import Part
from procmodels.space import Choice, Integer, Parameter, Scalar


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
        live = asset.live_object and asset.live_object(asset.params, _material(bpy, "wood", asset.colours.mean(0)))
        for obj in [live] if live else _part_objects(bpy, asset):
            obj.parent = root
            collection.objects.link(obj)
        if live:
            _place(bpy, live, asset)
        try:
            bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False, compress=True)
        except RuntimeError as error:  # Blender's operators know no other kind
            raise OSError(f"{path}: {error}") from error


def _part_objects(bpy: Any, asset: Asset) -> list[Any]:
    """One object a part, its mesh in the frame of the files; a material each when they have colours."""
    look, objects = asset.look, []
    picture = None if look is None or look.picture is None else _packed(bpy, look.picture)
    plain = None if look else _material(bpy, "wood", asset.colours[0])
    for i, part in enumerate(asset.shape.parts):
        mesh = _mesh(bpy, part.moved(asset.mesh_from_canonical), look.uv[i] if look and look.uv else None)
        mesh.materials.append(plain or _material(bpy, part.name, asset.colours[i], picture))
        objects.append(bpy.data.objects.new(part.name, mesh))
    return objects


def _packed(bpy: Any, picture: np.ndarray) -> Any:
    """The picture inside the .blend file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "texture.jpg"
        path.write_bytes(encoded(picture))
        image = bpy.data.images.load(str(path))
        image.pack()
        image.filepath_raw = "//texture.jpg"  # where unpacking would put it
    return image


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


def _mesh(bpy: Any, part: Part, uv: np.ndarray | None) -> Any:
    """A Blender mesh with the part's polygons, smooth by angle; uv (c, 2) of its corners, face after face."""
    mesh = bpy.data.meshes.new(part.name)
    mesh.from_pydata(part.vertices.tolist(), [], [list(f) for f in part.faces])
    mesh.shade_smooth()
    mesh.set_sharp_from_angle(angle=np.radians(SMOOTH_DEGREES))
    if uv is not None:
        mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uv.astype(np.float32).ravel())
    mesh.update()
    return mesh


def _material(bpy: Any, name: str, colour: np.ndarray, picture: Any = None) -> Any:
    """A material of that linear RGB, or showing a picture; the solid view shows the colour in any case."""
    material = bpy.data.materials.new(name)
    material.diffuse_color = (*colour, 1)
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    shader.inputs["Roughness"].default_value = ROUGHNESS
    if picture is not None:
        texture = material.node_tree.nodes.new("ShaderNodeTexImage")
        texture.image = picture
        texture.location = (-320, 300)
        material.node_tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
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
