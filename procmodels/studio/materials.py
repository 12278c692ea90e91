"""Materials for the studio: pictures on floor and walls, and a plausible surface for meshes that come without one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

# Base colours (linear RGB) that untextured furniture is painted or stained with.
WOODS = ((0.42, 0.23, 0.10), (0.25, 0.12, 0.05), (0.55, 0.36, 0.18), (0.12, 0.06, 0.03))
PAINTS = ((0.65, 0.62, 0.55), (0.10, 0.20, 0.30), (0.35, 0.08, 0.06), (0.15, 0.25, 0.13))


def picture(name: str, path: Path) -> Any:
    """A matt material that shows an image through the mesh's UV layer."""
    import bpy

    material = bpy.data.materials.new(name)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.load(str(path))
    texture.extension = "EXTEND"
    surface = nodes.new("ShaderNodeBsdfDiffuse")  # much cheaper than the principled one, and most pixels show it
    links.new(texture.outputs["Color"], surface.inputs["Color"])
    links.new(surface.outputs["BSDF"], nodes["Material Output"].inputs["Surface"])
    return material


def finish(objects: list[Any], seed: int) -> None:
    """Make every surface opaque, give plain ones a grain, and colour those without any colour by `seed`."""
    import bpy

    rng = np.random.default_rng(seed)
    wood = bool(rng.random() < 0.6)
    palette = WOODS if wood else PAINTS
    colour = (*palette[rng.integers(len(palette))], 1.0)
    bare = bpy.data.materials.new("studio_bare")
    bare.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = colour
    bare.node_tree.nodes["Principled BSDF"].inputs["Roughness"].default_value = 0.5
    done: set[str] = set()
    for obj in objects:
        if not any(slot.material for slot in obj.material_slots):
            obj.data.materials.clear()
            obj.data.materials.append(_painted_by_vertices(obj) or bare)
        for slot in obj.material_slots:
            material = slot.material or bare
            slot.material = material
            if material.name not in done:
                done.add(material.name)
                _finish_one(material, wood, float(rng.uniform(0, 100)))


def _painted_by_vertices(obj: Any) -> Any:
    """A material that shows the mesh's own vertex colours, or None when it has none."""
    import bpy

    if not obj.data.color_attributes:
        return None
    material = bpy.data.materials.new("studio_vertex_colours")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    source = nodes.new("ShaderNodeVertexColor")
    source.layer_name = obj.data.color_attributes[0].name
    links.new(source.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return material


def _finish_one(material: Any, wood: bool, offset: float) -> None:
    tree = material.node_tree
    surface = next((n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    if surface is None:
        return
    # The truth masks are the geometry's: a see-through surface would contradict them.
    for name, value in (("Alpha", 1.0), ("Transmission Weight", 0.0)):
        for link in list(surface.inputs[name].links):
            tree.links.remove(link)
        surface.inputs[name].default_value = value
    base = surface.inputs["Base Color"]
    for link in list(base.links):
        node = link.from_node
        if node.type == "TEX_IMAGE" and (node.image is None or 0 in node.image.size):
            tree.links.remove(link)  # the picture is missing: Blender would paint it magenta
    if not base.is_linked:
        _grain(tree, base, wood, offset)


def _grain(tree: Any, base: Any, wood: bool, offset: float) -> None:
    """Multiply a plain colour by a mild procedural pattern: stretched waves (wood) or soft blotches (paint)."""
    place = tree.nodes.new("ShaderNodeTexCoord")
    shift = tree.nodes.new("ShaderNodeMapping")
    shift.inputs["Location"].default_value = (offset, 0.37 * offset, 0.71 * offset)
    shift.inputs["Scale"].default_value = (6.0, 6.0, 1.5) if wood else (7.0, 7.0, 7.0)
    tree.links.new(place.outputs["Generated"], shift.inputs["Vector"])
    if wood:
        pattern = tree.nodes.new("ShaderNodeTexWave")
        pattern.inputs["Distortion"].default_value = 9.0
        pattern.inputs["Detail"].default_value = 4.0
    else:
        pattern = tree.nodes.new("ShaderNodeTexNoise")
        pattern.inputs["Detail"].default_value = 8.0
    tree.links.new(shift.outputs["Vector"], pattern.inputs["Vector"])
    ramp = tree.nodes.new("ShaderNodeMapRange")
    ramp.inputs["To Min"].default_value, ramp.inputs["To Max"].default_value = (0.55, 1.2) if wood else (0.7, 1.25)
    tree.links.new(pattern.outputs["Fac"], ramp.inputs["Value"])
    mix = tree.nodes.new("ShaderNodeVectorMath")
    mix.operation = "MULTIPLY"
    mix.inputs[0].default_value = tuple(base.default_value)[:3]
    tree.links.new(ramp.outputs["Result"], mix.inputs[1])
    tree.links.new(mix.outputs["Vector"], base)
