"""What people saw in real objects: the parts of those of a class, and things that are not of it.

    labels/chair.json      {"note": "...", "objects": {ID: {CHOICE: VALUE, or [VALUE, VALUE], or null}}}
    labels/not_chair.json  {"note": "...", "objects": {ID: WORD}}

Choices, integers and flags have the names and values of the class's own space. A list holds all values that are right,
where eyes could not decide between them; null: none of the values is, or the object does not let one say. What does
nothing beside the object's other values (stretchers of a pedestal) is left out.

An ID is SOURCE/NAME: a furniture catalogue without its ending and the model's name ("Scopia/fridge"), or a folder of
class folders and the file in it without its ending ("ikea_dev/chair/agam").
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from datasets import axes_tables, sweethome3d
from datasets.catalogue_object import DataError, RealObject, read_mesh
from datasets.mesh_folder import meshes
from datasets.sweethome3d_objects import read_model
from procmodels.space import ParamSpace, Value

HERE = Path(__file__).with_name("labels")
DEBIAN = Path("/usr/share/sweethome3d/furniture")  # of the package sweethome3d-furniture

Seen = dict[str, tuple[Value, ...] | None]  # by name of a choice: the right values, None where none can be told


def parts(class_name: str, folder: Path = HERE) -> dict[str, Seen]:
    """What objects of the class have, by ID. Raises DataError."""
    file = folder / f"{class_name}.json"
    out: dict[str, Seen] = {}
    for name, said in _objects(file).items():
        if not isinstance(said, dict):
            raise DataError(f"{file}: {name} needs its choices, as in {{'back': 'panel'}}, not {said!r}")
        out[name] = {choice: _values(value, file, f"{name}, {choice}") for choice, value in said.items()}
    return out


def others(class_name: str, folder: Path = HERE) -> dict[str, str]:
    """Things that are not of the class, by ID, with a word for each. Raises DataError."""
    file = folder / f"not_{class_name}.json"
    things = _objects(file)
    if bad := [name for name, word in things.items() if not isinstance(word, str) or not word]:
        raise DataError(f"{file}: {bad[0]} needs a word for what it is, not {things[bad[0]]!r}")
    return things


def fitting(labels: dict[str, Seen], space: ParamSpace, what: str = "the labels") -> dict[str, Seen]:
    """The labels, which must be in the space's words. Raises DataError naming the first object, choice and value that
    are not."""
    known = {p.name: p for p in space.discrete}
    for name, seen in labels.items():
        for choice, values in seen.items():
            if choice not in known:
                raise DataError(f"{what}, {name}: {space.name} has no choice {choice!r}; it has {', '.join(known)}")
            for value in values or ():
                if problem := known[choice].problem(value):
                    raise DataError(f"{what}, {name}: {choice} {value!r} {problem}, {known[choice].describe()}")
    return labels


def _objects(file: Path) -> dict[str, Any]:
    try:
        table = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise DataError(f"{file}: there are no labels of this class; the known are in {HERE}") from error
    except (OSError, ValueError) as error:
        raise DataError(f"{file} is not readable as JSON ({error})") from error
    things = table.get("objects") if isinstance(table, dict) else None
    if not isinstance(things, dict):
        raise DataError(f'{file}: expected {{"objects": {{"Scopia/fridge": ...}}}}')
    return things


def _values(value: Any, file: Path, where: str) -> tuple[Value, ...] | None:
    if value is None:
        return None
    listed = value if isinstance(value, list) else [value]
    if not listed or not all(isinstance(v, str | int | bool) for v in listed):
        raise DataError(f"{file}: {where}: a value, a list of values or null is needed, not {value!r}")
    return tuple(listed)


def objects(sources: list[Path]) -> dict[str, RealObject]:
    """Every object of some catalogues (.sh3f files, folders of them) and folders of class folders, by ID, whatever it
    is. Their class is "" or the folder's name. Raises DataError for a source that is none of these."""
    out: dict[str, RealObject] = {}
    for source in sources:
        catalogues = [source] if source.suffix.lower() == ".sh3f" else sorted(source.glob("*.sh3f"))
        found = [o for f in catalogues for o in _in_catalogue(f)] or _in_folders(source)
        if not found:
            raise DataError(f"{source} is neither a .sh3f catalogue, a folder of them nor one of class folders")
        for item in found:
            out.setdefault("/".join(filter(None, (item.data, item.class_name, item.name))), item)
    return out


def _in_catalogue(file: Path) -> list[RealObject]:
    axes = axes_tables.find(file.stem)
    return [
        RealObject(
            data=file.stem,
            class_name="",
            name=model.name,
            source=f"{file}:{model.member}",
            mask=None,
            canonical_from_file=axes.turn(model.name, "y", "z") @ np.array(model.rotation).reshape(3, 3),
            read=partial(read_model, file, model),
        )
        for model in sweethome3d.read_catalogue(file)
    ]


def _in_folders(folder: Path) -> list[RealObject]:
    """The meshes of class folders, and masks (white = object) that have none."""
    root = folder.resolve()
    axes = axes_tables.find(root.name, root)
    out = []
    for sub in sorted(f for f in (root.iterdir() if root.is_dir() else ()) if f.is_dir()):
        known = {file.stem: file for file in meshes(sub)}
        for stem in sorted({*known, *(f.stem for f in sub.glob("*.png"))}):
            file, mask = known.get(stem), sub / f"{stem}.png"
            out.append(
                RealObject(
                    data=root.name,
                    class_name=sub.name,
                    name=stem,
                    source=str(file or mask),
                    mask=mask if mask.is_file() else None,
                    canonical_from_file=axes.turn(f"{sub.name}/{file.name if file else stem}", "y", "-z"),
                    read=partial(read_mesh, file) if file else partial(_no_mesh, mask),
                )
            )
    return out


def _no_mesh(mask: Path) -> trimesh.Trimesh:
    raise DataError(f"{mask} is a mask alone; there is no mesh of the object")
