"""Objects of Sweet Home 3D's furniture catalogues: their class from their title, their mesh in the canonical frame.

The class rule goes by the words of the title (of the file's name where there is no title), plurals included:

1. Left out when any word of EXCLUDED is there: other things that carry a furniture word (table lamp, pool table,
   desk lamp, bedside table, shelf cabinet), furniture of another build (bunk bed, day bed, ottoman).
2. chair: chair, armchair. Before table, so that a desk chair is a chair. Stools and benches have no back: left out.
3. sofa: sofa, couch.
4. bed: bed.
5. shelf: shelf, shelves, shelving, bookcase, bookshelf.
6. table: table, desk.

The models are Y up and face +Z once `modelRotation` is applied, but for those that datasets/axes/CATALOGUE.json names.
Their proportions are the file's: the few that a catalogue stretches to other sizes are not stretched.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import trimesh

from datasets import axes_tables, sweethome3d
from datasets.catalogue_object import RealObject, parse_mesh, with_unique_names

WORDS = {
    "chair": ("chair", "armchair"),
    "sofa": ("sofa", "couch"),
    "bed": ("bed",),
    "shelf": ("shelf", "shelves", "shelving", "bookcase", "bookshelf"),
    "table": ("table", "desk"),
}
EXCLUDED = (
    *("lamp", "fan", "light", "tennis", "bat", "pool", "football", "game", "cabinet", "rack", "ottoman", "cushion"),
    *(
        "bedside",
        "baby",
        "bunk",
        "day",
        "mezzanine",
        "hospital",
        "high",
        "opened",
        "changing",
        "dressing",
        "tablecloth",
    ),
)


def class_of(title: str) -> str | None:
    """The class that a title means by the rule above, or None."""
    words = set(re.findall(r"[a-z]+", title.lower()))
    words |= {word.removesuffix("s") for word in words}
    if words & set(EXCLUDED):
        return None
    return next((c for c, keys in WORDS.items() if words & set(keys)), None)


def in_catalogues(files: list[Path]) -> list[RealObject]:
    """The furniture of some catalogues. Raises CatalogueError for a damaged one."""
    objects = []
    for file in files:
        axes = axes_tables.find(file.stem)
        for model in sweethome3d.read_catalogue(file):
            class_name = class_of(model.title or re.sub(r"[-_]", " ", model.name))
            if class_name is not None:
                objects.append(
                    RealObject(
                        data=file.stem,
                        class_name=class_name,
                        name=model.name,
                        source=f"{file}:{model.member}",
                        mask=None,
                        canonical_from_file=axes.turn(model.name, "y", "z") @ np.array(model.rotation).reshape(3, 3),
                        read=partial(read_model, file, model),
                    )
                )
    return with_unique_names(objects)


def read_model(file: Path, model: sweethome3d.Model) -> trimesh.Trimesh:
    """All triangles of a catalogue's model, in its own axes. Raises DataError."""
    return parse_mesh(sweethome3d.read_obj(file, model), "obj", f"{file}:{model.member}")
