"""A photo studio in Blender: a textured mesh in a room with a patterned floor, photographed by Cycles.

The only place where Cycles renders. Everything here works on Blender's one global scene, in this order:
`load_mesh` (clean session, import) -> `furnish` (place the mesh, build the room) -> `shoot` once a view.
World frame: metres, right-handed, Z up, the object stands on z = 0. Cameras: OpenCV axes, world_from_cam (4, 4).
`bpy` is imported inside the functions, so that this module can be read without Blender.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from procmodels.blender import silenced

if TYPE_CHECKING:
    from procmodels.studio.room import Room

SENSOR_MM = 36.0  # width of the virtual sensor; `lens_mm` is meant on this width
IMPORTERS = (".obj", ".ply", ".stl", ".glb", ".gltf")
# Blender turns glTF's Y-up into Z-up on import; this turns it back, so that all formats come in the file's own axes.
_FILE_FROM_GLTF_IMPORT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_BLENDER_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])  # Blender's cameras look along -Z with Y up


class StudioError(ValueError):
    """The mesh cannot be photographed; the message says why."""


@dataclass(frozen=True)
class RenderSettings:
    width: int = 800  # pixels
    height: int = 600  # pixels
    lens_mm: float = 32.0  # focal length on a 36 mm wide sensor: focal in pixels = lens_mm / 36 * width
    samples: int = 16  # light paths a pixel, before denoising
    threads: int = 0  # render threads, 0 = all cores


@dataclass(frozen=True)
class Shot:
    world_from_cam: np.ndarray  # (4, 4) float, OpenCV axes, metres
    exposure: float = 0.0  # stops
    focus: float = 1.0  # metres, distance that is sharp
    aperture: float = 0.0  # metres, diameter of the lens opening; 0 = all is sharp
    seed: int = 0  # render noise


def load_mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Start a clean session and import a mesh: vertices (n, 3), triangles (m, 3) int, the file's axes and units."""
    import bpy

    suffix = path.suffix.lower()
    with silenced():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        try:
            if suffix == ".obj":
                bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z")
            elif suffix == ".ply":
                bpy.ops.wm.ply_import(filepath=str(path), forward_axis="Y", up_axis="Z")
            elif suffix == ".stl":
                bpy.ops.wm.stl_import(filepath=str(path), forward_axis="Y", up_axis="Z")
            elif suffix in (".glb", ".gltf"):
                bpy.ops.import_scene.gltf(filepath=str(path))
            else:
                raise StudioError(
                    f"{path.name}: cannot read {suffix or 'a file without extension'}; use {' '.join(IMPORTERS)}"
                )
        except RuntimeError as error:
            raise StudioError(f"{path.name}: Blender cannot read it: {str(error).strip()}") from error
    file_from_import = _FILE_FROM_GLTF_IMPORT if suffix in (".glb", ".gltf") else np.eye(4)
    _flatten(file_from_import)
    vertices, faces = _geometry()
    if not len(faces):
        raise StudioError(f"{path.name}: there is no surface in it")
    return vertices, faces


def _meshes() -> list[Any]:
    import bpy

    return [o for o in bpy.data.objects if o.type == "MESH" and not o.name.startswith("studio_")]


def _flatten(file_from_import: np.ndarray) -> None:
    """Unparent the imported meshes, keep their places, and drop what else came with the file (lamps, cameras)."""
    import bpy
    from mathutils import Matrix

    bpy.context.view_layer.update()
    places = [(o, file_from_import @ np.array(o.matrix_world)) for o in _meshes()]
    for obj, place in places:
        obj.parent = None
        obj.matrix_world = Matrix(place.tolist())
    for obj in list(bpy.data.objects):
        if obj.type != "MESH":
            bpy.data.objects.remove(obj)
    bpy.context.view_layer.update()


def _geometry() -> tuple[np.ndarray, np.ndarray]:
    """All imported triangles in one list, world frame."""
    vertices: list[np.ndarray] = [np.zeros((0, 3))]
    faces: list[np.ndarray] = [np.zeros((0, 3), dtype=np.int64)]
    count = 0
    for obj in sorted(_meshes(), key=lambda o: o.name):
        mesh = obj.data
        mesh.calc_loop_triangles()
        points = np.empty(3 * len(mesh.vertices), dtype=np.float32)
        corners = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
        mesh.vertices.foreach_get("co", points)
        mesh.loop_triangles.foreach_get("vertices", corners)
        place = np.array(obj.matrix_world)
        vertices.append(points.reshape(-1, 3).astype(float) @ place[:3, :3].T + place[:3, 3])
        faces.append(corners.reshape(-1, 3).astype(np.int64) + count)
        count += len(mesh.vertices)
    return np.concatenate(vertices), np.concatenate(faces)


def furnish(world_from_file: np.ndarray, room: Room, settings: RenderSettings, seed: int = 0) -> None:
    """Place the imported mesh, finish its materials, and build floor, walls, lamps and the camera round it."""
    import bpy
    from mathutils import Matrix

    from procmodels.studio import materials
    from procmodels.studio import room as room_building

    for obj in _meshes():
        obj.matrix_world = Matrix((world_from_file @ np.array(obj.matrix_world)).tolist())
    materials.finish(_meshes(), seed)
    room_building.build(room)
    _render_settings(settings)
    camera = bpy.data.cameras.new("studio_camera")
    camera.sensor_fit, camera.sensor_width, camera.lens = "HORIZONTAL", SENSOR_MM, settings.lens_mm
    camera.clip_start, camera.clip_end = 0.01 * room.half_side, 100 * room.half_side
    holder = bpy.data.objects.new("studio_camera", camera)
    bpy.context.collection.objects.link(holder)
    bpy.context.scene.camera = holder


def _render_settings(settings: RenderSettings) -> None:
    import bpy

    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = settings.width, settings.height, 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.use_persistent_data = True  # keeps the BVH and the textures from frame to frame
    if settings.threads:
        render.threads_mode, render.threads = "FIXED", settings.threads
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGB"
    render.image_settings.compression = 15
    cycles.device, cycles.samples, cycles.use_adaptive_sampling = "CPU", settings.samples, False
    cycles.max_bounces = cycles.diffuse_bounces = 2
    cycles.glossy_bounces, cycles.transmission_bounces = 1, 0
    cycles.use_light_tree = False  # pays only with many lamps
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.use_denoising, cycles.denoiser, cycles.denoising_prefilter = True, "OPENIMAGEDENOISE", "FAST"
    scene.view_settings.view_transform, scene.view_settings.look = "Standard", "None"


def shoot(shot: Shot, path: Path) -> None:
    """Render one view to an 8-bit RGB PNG."""
    import bpy
    from mathutils import Matrix

    scene = bpy.context.scene
    camera = scene.camera
    camera.matrix_world = Matrix((shot.world_from_cam @ _BLENDER_FROM_OPENCV).tolist())
    dof = camera.data.dof
    dof.use_dof = shot.aperture > 0
    dof.focus_distance = shot.focus
    if shot.aperture > 0:
        dof.aperture_fstop = camera.data.lens * 1e-3 / shot.aperture
    scene.view_settings.exposure = shot.exposure
    scene.cycles.seed = shot.seed
    scene.render.filepath = str(path)
    with silenced():
        bpy.ops.render.render(write_still=True)
