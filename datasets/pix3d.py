"""Pix3D (Sun et al. 2018): pix3d.json, a list of records, one a photo, with "img", "mask", "model", "category".

An object is a distinct model; several photos may show it. Models are y up and face -z. The camera of a record is read
by recon.files.pix3d_camera.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from datasets.catalogue_object import DataError, RealObject, read_mesh, with_unique_names

RECORDS = "pix3d.json"
CLASS_OF = {"bed": "bed", "bookcase": "shelf", "chair": "chair", "desk": "table", "sofa": "sofa", "table": "table"}
# Model: y up, front towards -z. Canonical: z up, front towards -y.
PIX3D_FROM_CANONICAL = np.array([(-1, 0, 0), (0, 0, 1), (0, 1, 0)], float)


@dataclass(frozen=True)
class Picture:
    """A photo of an object and its mask (white = object); the files need not be there."""

    image: Path
    mask: Path


def in_folder(folder: Path) -> list[RealObject]:
    """One object a distinct model of a class that is known; its mask is that of the first photo that has one."""
    records = _records(folder)
    models = {str(r["model"]): str(r["category"]) for r in records if r["category"] in CLASS_OF}
    parents = [PurePosixPath(m).parent for m in models]
    shown = pictures(folder)
    objects = []
    for model, category in models.items():
        path = PurePosixPath(model)
        file = folder / model
        objects.append(
            RealObject(
                data="pix3d",
                class_name=CLASS_OF[category],
                name=path.parent.name if parents.count(path.parent) == 1 else f"{path.parent.name}_{path.stem}",
                source=str(file),
                mask=next((p.mask for p in shown[str(file)] if p.mask.is_file()), None),
                canonical_from_file=PIX3D_FROM_CANONICAL.T,
                read=partial(read_mesh, file),
            )
        )
    return with_unique_names(objects)


def pictures(folder: Path) -> dict[str, tuple[Picture, ...]]:
    """The photos of every object, by RealObject.source."""
    found: dict[str, list[Picture]] = {}
    for record in _records(folder):
        picture = Picture(folder / str(record["img"]), folder / str(record["mask"]))
        found.setdefault(str(folder / str(record["model"])), []).append(picture)
    return {source: tuple(all_of_it) for source, all_of_it in found.items()}


def _records(folder: Path) -> list[dict[str, Any]]:
    file = folder / RECORDS
    try:
        records = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{file} cannot be read as Pix3D's list of records ({error})") from error
    if not isinstance(records, list):
        raise DataError(f"{file} is not Pix3D's: a list of records is expected")
    for i, record in enumerate(records):
        keys = ("img", "mask", "model", "category")
        missing = [k for k in keys if not isinstance(record, dict) or not isinstance(record.get(k), str)]
        if missing:
            raise DataError(f"{file}: record {i} has no {', '.join(missing)}")
        if ".." in PurePosixPath(record["model"]).parts or PurePosixPath(record["model"]).is_absolute():
            raise DataError(f"{file}: record {i} names a model outside the folder, {record['model']}")
    return records
