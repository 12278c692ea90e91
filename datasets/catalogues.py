"""Real objects of any outside layout behind one interface.

    for item in objects(Path("Scopia.sh3f"), "chair"):
        mesh = item.load()  # trimesh.Trimesh in the canonical frame

What a path is, is told by its look:
- a .sh3f file or a folder of them: furniture catalogues of Sweet Home 3D (datasets.sweethome3d_objects)
- a folder with pix3d.json: Pix3D (datasets.pix3d)
- a folder of ShapeNet's synset folders, or one of them: ShapeNetCore v1 or v2 (datasets.shapenet)
- a folder with class-named sub-folders of meshes, or a folder of meshes (datasets.mesh_folder)
"""

from __future__ import annotations

from pathlib import Path

from datasets import mesh_folder, pix3d, shapenet, sweethome3d_objects
from datasets.catalogue_object import CLASSES, DataError, RealObject

__all__ = ["DataError", "RealObject", "objects"]


def objects(path: Path, class_name: str | None = None) -> list[RealObject]:
    """The objects of one class, or of all, by class and then in the source's order; meshes are not read yet.

    Raises DataError when the path is nothing that is known, or holds no object of the class.
    """
    if class_name is not None and class_name not in CLASSES:
        raise DataError(f"the classes are {', '.join(CLASSES)}, not {class_name!r}")
    found = _list(path, class_name)
    kept = [o for o in found if class_name in (None, o.class_name)]
    if not kept:
        there = ", ".join(sorted({o.class_name for o in found})) or "no furniture of a known class"
        raise DataError(f"{path}: no {class_name or 'furniture'} in it; there is {there}")
    return sorted(kept, key=lambda o: CLASSES.index(o.class_name))


def _list(path: Path, class_name: str | None) -> list[RealObject]:
    if not path.exists():
        raise DataError(f"{path}: no such file or folder")
    if path.suffix.lower() == ".sh3f" and path.is_file():
        return sweethome3d_objects.in_catalogues([path])
    if path.is_dir():
        if catalogues := sorted(path.glob("*.sh3f")):
            return sweethome3d_objects.in_catalogues(catalogues)
        if (path / pix3d.RECORDS).is_file():
            return pix3d.in_folder(path)
        if shapenet.is_shapenet(path):
            return shapenet.in_folder(path)
        if mesh_folder.is_class_folders(path):
            return mesh_folder.in_class_folders(path)
        if mesh_folder.meshes(path):
            return mesh_folder.in_one_folder(path, class_name)
    raise DataError(
        f"{path} is not a layout that is known. Looked for: a .sh3f file or a folder of them; a folder with "
        "pix3d.json; ShapeNet's 03001627/MODEL/model.obj or 03001627/MODEL/models/model_normalized.obj; a folder with "
        "sub-folders bed, chair, shelf, sofa, table of OBJ, PLY, GLB, STL or OFF files; a folder of such files. "
        "Give the folder that looks like one of these"
    )
