"""LIST as a folder of folders and files: every photo set, mesh, scan, splat or video in it is an input."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from datasets.mesh_folder import MESHES
from recon.files import camera_table
from recon.files.photo import looks_like_photo
from recon.files.shape import Kind
from recon.scene import InputError
from recon.system.folders import entries

log = logging.getLogger("recon")
ASIDE = (".mtl", ".md", ".txt", ".log", ".csv", ".json", ".html", ".pdf", ".py", ".bin")  # beside inputs, none itself
PHOTO_SET = 8  # pictures beside a single mesh that make its folder a photo set: fewer are its textures


def inputs(folder: Path, common: Mapping[str, Any], out: Path) -> list[Path]:
    """The inputs in a folder, by name. Pictures right in it count only with --input image or masks, which says so.

    Raises InputError when there is nothing but pictures, or nothing at all.
    """
    try:
        found = [p for p in entries(folder) if p.absolute() != out.absolute()]
    except OSError as error:
        raise InputError(f"LIST {folder} cannot be read ({error.strerror}); check its permissions") from error
    pictures = [p for p in found if p.is_file() and looks_like_photo(p)]
    others = [p for p in found if p not in pictures and (p.is_dir() or p.suffix.lower() not in ASIDE)]
    if common.get("input") in (Kind.IMAGE, Kind.MASKS):
        return [p for p in found if p in pictures or p in others]
    if not others:
        what = f"{len(pictures)} pictures" if pictures else "no folders, meshes or videos"
        raise InputError(
            f"LIST {folder} holds {what}: a photo set is given to run_recon.py, or with others in a folder of folders; "
            "if every picture shows an object of its own, add --input image"
        )
    if pictures:
        log.info("%s: %d pictures beside the inputs are none themselves", folder, len(pictures))
    return [_of_one(p) if p.is_dir() else p for p in others]


def _of_one(folder: Path) -> Path:
    """The mesh in a folder that holds one with its textures; else the folder itself."""
    try:
        files = [p for p in entries(folder) if p.is_file()]
    except OSError:  # whoever reads it says so
        return folder
    meshes = [p for p in files if p.suffix.lower() in (*MESHES, ".gltf", ".fbx", ".dae", ".3mf")]
    few = sum(map(looks_like_photo, files)) < PHOTO_SET
    return meshes[0] if len(meshes) == 1 and few and camera_table.find(folder) is None else folder
