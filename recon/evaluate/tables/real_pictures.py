"""Pictures of a real object beside what was made of it, and sheets of the worst."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import trimesh

from procmodels import Model
from procmodels.shape import Part, Shape
from procmodels.space import Params
from recon.outputs.previews import ShadeOptions, render_previews
from recon.system.whole_files import write_picture

if TYPE_CHECKING:
    from recon.evaluate.tables.table2_rows import Table2Row

SIDE, LINE = 190, 38  # px of a picture and of the words below it
MOST_FACES = 60_000  # larger meshes are thinned for the picture: shading is slow
LOOKS = ShadeOptions(supersample=1, sky_lamps=16, sun_lamps=6)


def shaded(shape: Shape) -> np.ndarray:
    """(SIDE, SIDE, 3) uint8 BGR, the front from the right."""
    return cv2.cvtColor(render_previews(shape, 1, (SIDE, SIDE), LOOKS)[0], cv2.COLOR_RGB2BGR)


def shape_of(mesh: trimesh.Trimesh) -> Shape:
    """A mesh in the canonical frame as one part."""
    faces = np.asarray(mesh.faces)
    if len(faces) > MOST_FACES:
        faces = faces[np.argsort(-mesh.area_faces)[:MOST_FACES]]
    return Shape((Part("object", np.asarray(mesh.vertices), tuple(map(tuple, faces.tolist()))),))


def object_picture(model: Model, mesh: trimesh.Trimesh, rows: list[Table2Row], best: Params, file: Path) -> None:
    """The object, the oracle's answer and the answer from each input in a line, each with its D_chamfer."""
    tiles = [_tile(shaded(shape_of(mesh)), rows[0].object, rows[0].data)]
    if best:
        tiles.append(_tile(shaded(model.build(best)), "oracle", f"{rows[0].oracle:.4f}"))
    for row in rows:
        if row.d_chamfer is None:
            tiles.append(_tile(np.full((SIDE, SIDE, 3), 230, np.uint8), row.input, "no answer"))
        else:
            words = f"{row.d_chamfer:.4f}" + (f", front {90 * row.turn} off" if row.turn else "")
            tiles.append(_tile(shaded(model.build(row.params)), row.input, words))
    file.parent.mkdir(parents=True, exist_ok=True)
    write_picture(file, np.hstack(tiles))


def _tile(picture: np.ndarray, first: str, second: str) -> np.ndarray:
    words = np.full((LINE, SIDE, 3), 255, np.uint8)
    for i, text in enumerate((first, second)):
        cv2.putText(words, text, (4, 14 + 17 * i), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (40, 40, 40), 1, cv2.LINE_AA)
    return np.vstack([picture, words])


def worst_sheet(pictures: list[Path], file: Path) -> Path | None:
    """The pictures of objects below each other; None when there are none."""
    lines = [p for p in (cv2.imread(str(f)) for f in pictures) if p is not None]
    if not lines:
        return None
    width = max(p.shape[1] for p in lines)
    padded = [cv2.copyMakeBorder(p, 0, 6, 0, width - p.shape[1], cv2.BORDER_CONSTANT, value=(255,) * 3) for p in lines]
    write_picture(file, np.vstack(padded))
    return file
