"""ShapeNetCore v1 (SYNSET/MODEL/model.obj) and v2 (SYNSET/MODEL/models/model_normalized.obj).

Both are Y up. Their README files say where the front is: v1 "the front is the +X axis", v2 "the front is the -Z axis";
a quarter turn lies between them. They give no mask.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

from datasets.axis_rotations import turn
from datasets.catalogue_object import DataError, RealObject, read_mesh

CLASS_OF = {
    "02818832": "bed",
    "03001627": "chair",
    "02871439": "shelf",  # "bookshelf"
    "04256520": "sofa",
    "04379243": "table",
}
V1, V2 = "model.obj", "models/model_normalized.obj"
DATA = {V1: "ShapeNetCore.v1", V2: "ShapeNetCore.v2"}
FRONT = {V1: "x", V2: "-z"}


def is_shapenet(folder: Path) -> bool:
    """Whether the folder is a synset's or holds some: eight digits are their names."""
    return bool(_synset_like(folder) or any(_synset_like(f) for f in folder.iterdir()))


def in_folder(folder: Path) -> list[RealObject]:
    """The objects of ShapeNetCore's folder, or of one synset's. Model files are not looked into: `load` says which are
    missing or damaged. Raises DataError when no synset of furniture is there."""
    root = folder.resolve()
    synsets = [root] if _synset_like(root) else sorted(f for f in root.iterdir() if f.name in CLASS_OF)
    if not synsets or synsets[0].name not in CLASS_OF:
        wanted = ", ".join(f"{synset} ({name})" for synset, name in CLASS_OF.items())
        raise DataError(f"{folder} looks like ShapeNetCore but has none of {wanted}")
    return [item for synset in synsets for item in _synset(synset)]


def _synset_like(folder: Path) -> bool:
    return folder.is_dir() and re.fullmatch(r"\d{8}", folder.resolve().name) is not None


def _synset(folder: Path) -> list[RealObject]:
    models = sorted(f for f in folder.iterdir() if f.is_dir() and not f.name.startswith("."))
    # A model without its file belongs to the version that the others are of.
    usual = next((v for m in models for v in (V2, V1) if (m / v).is_file()), V2)
    found = [(m, next((v for v in (V2, V1) if (m / v).is_file()), usual)) for m in models]
    return [
        RealObject(
            data=DATA[version],
            class_name=CLASS_OF[folder.name],
            name=model.name,
            source=str(model / version),
            mask=None,
            canonical_from_file=turn("y", FRONT[version]),
            read=partial(read_mesh, model / version),
        )
        for model, version in found
    ]
