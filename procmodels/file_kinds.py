"""Which files a shape can be written to, by their endings."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from procmodels.export import Asset, export_glb, export_obj, save_blend
from procmodels.params_file import ParamsError
from procmodels.stl import export_stl
from procmodels.usd import ENDINGS, export_usd

UP_AXES = ("y", "z")  # of an OBJ file


def _usd(asset: Asset, path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        save_blend(asset, Path(folder) / "scene.blend")
        export_usd(path)


# Each writes a file of its kind, and perhaps others beside it.
WRITERS: dict[str, Callable[[Asset, Path], None]] = {
    ".glb": export_glb,
    ".obj": export_obj,
    ".stl": export_stl,
    ".blend": save_blend,
    **dict.fromkeys(ENDINGS, _usd),
}
KINDS = tuple(WRITERS)


def write_new(asset: Asset, path: Path, obj_up: str = "y") -> None:
    """Write an asset by the file's ending; whole or not at all, and never over a file.

    Raises ParamsError for an ending that is not known and for a file that is there, OSError when writing fails.
    """
    if (ending := path.suffix.lower()) not in WRITERS:
        raise ParamsError(
            f"--out {path}: files ending in {ending or 'nothing'} are not written; {', '.join(KINDS)} are"
        )
    _free(path)
    if not path.parent.is_dir():
        raise ParamsError(f"--out {path}: the folder {path.parent} does not exist; make it first")
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.stem[:40]}-") as folder:
        draft = Path(folder) / path.name
        if ending == ".obj":
            export_obj(asset, draft, up=obj_up)
        else:
            WRITERS[ending](asset, draft)
        made = sorted(Path(folder).iterdir())  # an OBJ may bring materials and a picture
        for file in made:
            _free(path.parent / file.name)
        for file in made:
            shutil.move(file, path.parent / file.name)


def _free(path: Path) -> None:
    if os.path.lexists(path):
        raise ParamsError(f"{path} is there and is not replaced; choose another --out")
