"""LIST as a whole data set: ShapeNet and meshes in folders by class; Pix3D's photos with masks and cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datasets import axes_tables, mesh_folder, pix3d, shapenet
from datasets.catalogues import CLASSES, DataError, RealObject, objects
from recon.scene import InputError


@dataclass(frozen=True)
class Listed:
    """An input of a data set with what the set knows of it, by flag."""

    source: Path
    options: dict[str, str]
    name: str


def listed(folder: Path, class_name: str | None) -> list[Listed] | None:
    """The inputs of a data set; None when the folder is none. `class_name`, if any, is the class that was named:
    a known one chooses the objects that are given, another (auto, a file) is tried on all.

    Raises InputError for a data set that cannot be used.
    """
    kind = (class_name or "").rpartition("/")[2]
    try:
        if (folder / pix3d.RECORDS).is_file():
            return _pictures(folder, _objects(folder, kind), class_name)
        if shapenet.is_shapenet(folder):
            return [_mesh(item, class_name, known=True) for item in _objects(folder, kind)]
        if mesh_folder.is_class_folders(folder):
            root = folder.resolve()
            known = axes_tables.find(root.name, root).where is not None  # else up and front are found
            return [_mesh(item, class_name, known) for item in _objects(folder, kind)]
    except OSError as error:
        raise InputError(f"LIST {folder} cannot be read ({error.strerror}); check its permissions") from error
    except DataError as error:
        raise InputError(str(error)) from error
    return None


def _objects(folder: Path, kind: str) -> list[RealObject]:
    return objects(folder, kind if kind in CLASSES else None)


def _mesh(item: RealObject, class_name: str | None, known: bool) -> Listed:
    options = {"class": class_name or item.class_name}
    if known:
        up, front = (_axis(item.canonical_from_file.T @ a) for a in ((0, 0, 1), (0, -1, 0)))
        options |= {"up": up, "front": front}
    return Listed(Path(item.source), options, f"{item.class_name}_{item.name}")


def _axis(direction: np.ndarray) -> str:
    """A file's axis as --up has it: "-y"."""
    number = int(np.abs(direction).argmax())
    return "-" * bool(direction[number] < 0) + "xyz"[number]


def _pictures(folder: Path, items: list[RealObject], class_name: str | None) -> list[Listed]:
    """Every photo of the objects."""
    shown, found = pix3d.pictures(folder), []
    for item in items:
        for picture in shown[item.source]:
            options = {"class": class_name or item.class_name, "pix3d": str(folder / pix3d.RECORDS)}
            if picture.mask.is_file():
                options["mask"] = str(picture.mask)
            found.append(Listed(picture.image, options, f"{item.class_name}_{picture.image.stem}"))
    return found
