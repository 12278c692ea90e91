"""Blender's importers, in a process of their own: `python -m procmodels.blender_import FILE IMPORTER OUT.npz`.

Writes vertices (n, 3) and triangles (m, 3) of all that a render of the file would show, in Blender's axes (Z up).
A file that crashes an importer ends this process alone.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

_IMPORTERS = {
    "usd": lambda file: bpy.ops.wm.usd_import(
        filepath=file, import_materials=False, import_textures_mode="IMPORT_NONE"
    ),
    "fbx": lambda file: bpy.ops.wm.fbx_import(filepath=file),
    "abc": lambda file: bpy.ops.wm.alembic_import(filepath=file, as_background_job=False),
    "blend": lambda file: bpy.ops.wm.open_mainfile(filepath=file, use_scripts=False),
}


def main(file: str, importer: str, out: str) -> None:
    """Import the file into an empty scene and write its triangles."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _IMPORTERS[importer](file)
    vertices, triangles = shown()
    np.savez(out, vertices=vertices, triangles=triangles)


def shown() -> tuple[np.ndarray, np.ndarray]:
    """All visible geometry with modifiers and instances, triangulated."""
    points, faces, known = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if not instance.show_self or instance.object.type not in ("MESH", "CURVE", "SURFACE", "META", "FONT"):
            continue
        mesh = instance.object.to_mesh()
        if mesh is not None:
            places, corners = (
                np.empty((len(mesh.vertices), 3), np.float32),
                np.empty((len(mesh.loop_triangles), 3), np.int32),
            )
            mesh.vertices.foreach_get("co", places.ravel())
            mesh.loop_triangles.foreach_get("vertices", corners.ravel())
            pose = np.array(instance.matrix_world)
            points.append(places @ pose[:3, :3].T + pose[:3, 3])
            faces.append(corners.astype(np.int64) + known)
            known += len(places)
        instance.object.to_mesh_clear()
    return np.concatenate(points), np.concatenate(faces)


if __name__ == "__main__":
    main(str(Path(sys.argv[1]).absolute()), sys.argv[2], sys.argv[3])
