"""The colours of meshes and point clouds, where a file has any: materials, pictures, colours of vertices or faces.

Shapes are read by their own readers; this is a second look, which may find nothing. What it finds is used only when it
is the same shape.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procmodels.look import linear

log = logging.getLogger("recon")
ENDINGS = (".obj", ".glb", ".gltf", ".ply", ".off", ".dae", ".3mf")
LARGEST = 300_000_000  # bytes: larger files stay without colours
_LINEAR = (".glb", ".gltf")  # whose colours without a picture are linear


@dataclass(frozen=True)
class Piece:
    """Colours (k, 3, 3) linear at the corners of k triangles, times a picture (h, w, 3) uint8 sRGB at uv (k, 3, 2)."""

    colours: np.ndarray
    uv: np.ndarray
    picture: np.ndarray | None


@dataclass(frozen=True)
class PaintedMesh:
    """corners (m, 3, 3) float in the file's axes and units, and the colours of m triangles piece by piece."""

    corners: np.ndarray
    pieces: tuple[Piece, ...]

    def at(self, triangle: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(n, 3) linear colours on n triangles, whose corners have these weights (n, 3)."""
        out, start = np.empty((len(triangle), 3)), 0
        for piece in self.pieces:
            end = start + len(piece.colours)
            mine = np.flatnonzero((triangle >= start) & (triangle < end))
            if len(mine):
                at, share = triangle[mine] - start, weights[mine]
                out[mine] = np.einsum("ni,nij->nj", share, piece.colours[at])
                if piece.picture is not None:
                    out[mine] *= _looked_up(piece.picture, np.einsum("ni,nij->nj", share, piece.uv[at]))
            start = end
        return out


@dataclass(frozen=True)
class PaintedPoints:
    """points (n, 3) float in the file's axes and units, colours (n, 3) linear."""

    points: np.ndarray
    colours: np.ndarray


def painted(path: Path) -> PaintedMesh | PaintedPoints | None:
    """The colours in a file; None when it has none, or they cannot be read."""
    if path.suffix.lower() not in ENDINGS or path.stat().st_size > LARGEST:
        return None
    import trimesh

    try:
        found = trimesh.load_scene(path).dump()
        meshes = [g for g in found if isinstance(g, trimesh.Trimesh) and len(g.faces)]
        if meshes:
            pieces = [_piece(g, path.suffix.lower() in _LINEAR) for g in meshes]
            told = sum(g.area for g, p in zip(meshes, pieces, strict=True) if p is not None)
            if told < 0.5 * sum(g.area for g in meshes):
                return None
            usual = np.mean([p.colours.mean((0, 1)) for p in pieces if p is not None], axis=0)
            filled = [p or _even(len(g.faces), usual) for g, p in zip(meshes, pieces, strict=True)]
            return PaintedMesh(np.concatenate([g.triangles for g in meshes]), tuple(filled))
        clouds = [g for g in found if isinstance(g, trimesh.PointCloud) and len(g.colors) == len(g.vertices)]
        if clouds:
            colours = np.concatenate([np.asarray(g.colors)[:, :3] for g in clouds])
            return PaintedPoints(np.concatenate([g.vertices for g in clouds]), linear(colours / 255))
    except MemoryError:
        raise
    except Exception as error:  # colours are an extra: whatever is wrong with them, the shape stays
        log.warning("the colours in %s cannot be read (%s): the result stays without", path, error)
    return None


def _piece(mesh: Any, told_linear: bool) -> Piece | None:
    """The colours of a mesh of trimesh, None when it has none."""
    count, visual = len(mesh.faces), mesh.visual
    if visual.kind == "texture":
        material = visual.material
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        factor = getattr(material, "baseColorFactor", None)
        if image is not None and visual.uv is not None:
            colour = np.ones(3) if factor is None else np.asarray(factor, float)[:3] / 255
            picture = np.asarray(image.convert("RGB"))
            return Piece(np.tile(colour, (count, 3, 1)), np.asarray(visual.uv)[mesh.faces], picture)
        colour = np.asarray(material.main_color, float)[:3] / 255
        return _even(count, colour if told_linear else linear(colour))
    if visual.kind == "vertex":
        colours = np.asarray(visual.vertex_colors, float)[mesh.faces][..., :3] / 255
    elif visual.kind == "face":
        colours = np.repeat(np.asarray(visual.face_colors, float)[:, None, :3] / 255, 3, axis=1)
    else:
        return None
    return Piece(colours if told_linear else linear(colours), np.zeros((count, 3, 2)), None)


def _even(count: int, colour: np.ndarray) -> Piece:
    return Piece(np.tile(colour, (count, 3, 1)), np.zeros((count, 3, 2)), None)


def _looked_up(picture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(n, 3) linear of a picture that repeats, at uv (n, 2): u to the right, v up."""
    height, width = picture.shape[:2]
    uv = np.nan_to_num(uv) % 1.0
    column = np.minimum((uv[:, 0] * width).astype(int), width - 1)
    row = np.minimum(((1 - uv[:, 1]) * height).astype(int), height - 1)
    return linear(picture[row, column] / 255)
