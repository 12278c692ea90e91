"""Folders of meshes: OBJ, PLY, GLB, STL or OFF in class-named sub-folders, with masks beside them where there are any.

    FOLDER/chair/NAME.ply    FOLDER/chair/NAME.png (white = object, optional)    FOLDER/table/...

Class folders are bed, chair, shelf (or bookcase), sofa (or couch), table (or desk), also in the plural; others are left
out with a note. The axes are those of datasets.axes_tables, else Y up facing -Z, for STL Z up facing -Y. A single class
folder uses the axes of the folder above it.
"""

from __future__ import annotations

import logging
from functools import partial
from pathlib import Path

from datasets import axes_tables
from datasets.catalogue_object import CLASSES, DataError, RealObject, read_mesh, with_unique_names

log = logging.getLogger(__name__)

MESHES = (".obj", ".ply", ".glb", ".stl", ".off")
CLASS_OF = {**{c: c for c in CLASSES}, "bookcase": "shelf", "couch": "sofa", "desk": "table"}
CLASS_OF |= {word + "s": c for word, c in CLASS_OF.items() if word != "shelf"} | {"shelves": "shelf"}


def class_of(folder: str) -> str | None:
    """The class that a folder's name means, or None."""
    return CLASS_OF.get(folder.lower())


def is_class_folders(folder: Path) -> bool:
    """Whether any class-named sub-folder holds a mesh."""
    return any(class_of(f.name) and meshes(f) for f in folder.iterdir() if f.is_dir())


def meshes(folder: Path) -> list[Path]:
    """The mesh files right in a folder, by name."""
    return sorted(f for f in folder.iterdir() if f.suffix.lower() in MESHES and f.is_file())


def in_class_folders(folder: Path) -> list[RealObject]:
    """Objects of all class-named sub-folders."""
    objects = []
    for sub in sorted(f for f in folder.iterdir() if f.is_dir()):
        class_name, files = class_of(sub.name), meshes(sub)
        if class_name is None or not files:
            why = "not a class that is known" if class_name is None else "no meshes in it"
            log.info("%s is left out: %s", sub, why)
            continue
        objects += _objects(files, folder, class_name)
    return with_unique_names(objects)


def in_one_folder(folder: Path, class_name: str | None = None) -> list[RealObject]:
    """Objects of a folder of meshes; the class comes from its name unless it is given."""
    named = class_of(folder.resolve().name)
    chosen = class_name or named
    if chosen is None:
        raise DataError(f"{folder} holds meshes, but of which class? Its name does not say; give --class")
    return with_unique_names(_objects(meshes(folder), folder.parent if named else folder, chosen))


def _objects(files: list[Path], root: Path, class_name: str) -> list[RealObject]:
    """`root` is the folder that gives the data their name and their axes."""
    root = root.resolve()
    axes = axes_tables.find(root.name, root)
    return [
        RealObject(
            data=root.name,
            class_name=class_name,
            name=file.stem,
            source=str(file),
            mask=mask if (mask := file.with_suffix(".png")).is_file() else None,
            canonical_from_file=axes.turn(
                (file.parent.resolve() / file.name).relative_to(root).as_posix(),
                *(("z", "-y") if file.suffix.lower() == ".stl" else ("y", "-z")),
            ),
            read=partial(read_mesh, file),
        )
        for file in files
    ]
