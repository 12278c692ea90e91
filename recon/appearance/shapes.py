"""The look of a shape from the colours of the mesh or the point cloud that it was fitted to."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from procmodels.look import Look
from procmodels.shape import Shape
from recon.appearance import fill
from recon.appearance.atlas import Atlas, unwrapped
from recon.appearance.cell_images import CellImages
from recon.appearance.materials import base_colours
from recon.appearance.photos import Appearance, LookOptions
from recon.appearance.texels import Texels
from recon.files.painted import PaintedMesh, PaintedPoints, painted
from recon.scene import Canonical

log = logging.getLogger("recon")
SIZE = 1024  # px: the colours of a whole mesh have no finer grain than this, or seldom
ABOVE, BELOW = 0.04, 0.06  # canonical units: the input's surface is looked for so far outside and inside the result's
NEIGHBOURS = 4  # points of a cloud that make a colour
OFF = 0.01  # share of the box: colours of another shape are not used


def run(
    path: Path, points: np.ndarray, shape: Shape, canonical: Canonical, options: LookOptions = LookOptions()
) -> Appearance:
    """Hand the colours of a file over to the shape that was fitted to it.

    points     (n, 3) float, what of the file was fitted, in its axes and units
    canonical  where the shape stands in these
    """
    found = None if options.plain else painted(path)
    if found is None:
        return Appearance(None)
    places = found.corners.reshape(-1, 3) if isinstance(found, PaintedMesh) else found.points
    if not _same(points, places):
        log.warning("the colours in %s lie elsewhere than its shape: the result stays without", path)
        return Appearance(None)
    forward = np.linalg.inv(canonical.world_from_canonical)
    moved = places @ forward[:3, :3].T + forward[:3, 3]
    atlas = unwrapped(shape, min(options.size, SIZE))
    texels = Texels.of(atlas)
    if isinstance(found, PaintedMesh):
        colour = of_mesh(texels, atlas, replace(found, corners=moved.reshape(-1, 3, 3)))
    else:
        colour = _of_points(texels, replace(found, points=moved))
    cells = texels.cells()
    means = CellImages(cells, texels).means(colour, np.ones(len(colour)))
    base, _ = base_colours(shape.parts, atlas.part[cells.triangle], means, np.ones(len(means)))
    return Appearance(Look(np.clip(base, 0, 1), fill.picture(texels, colour), atlas.uv), 1.0)


def _same(points: np.ndarray, places: np.ndarray) -> bool:
    """Whether the fitted points lie within the box of what has colours."""
    low, high = places.min(0), places.max(0)
    slack = OFF * float((high - low).max())
    return bool(((points >= low - slack) & (points <= high + slack)).all(1).mean() > 0.98)


def of_mesh(texels: Texels, atlas: Atlas, source: PaintedMesh) -> np.ndarray:
    """(n, 3) linear: what a texel meets on its way in from outside, else what lies nearest."""
    import open3d as o3d

    tensor: Any = o3d.core.Tensor
    scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
    flat = np.ascontiguousarray(source.corners.reshape(-1, 3), np.float32)
    scene.add_triangles(tensor(flat), tensor(np.arange(len(flat), dtype=np.uint32).reshape(-1, 3)))
    normals = atlas.normals.astype(np.float32)[texels.triangle]
    rays = np.concatenate([texels.places + np.float32(ABOVE) * normals, -normals], 1)
    hit = scene.cast_rays(tensor(rays), nthreads=1)
    triangle, uv = hit["primitive_ids"].numpy().astype(np.int64), hit["primitive_uvs"].numpy()
    missed = np.flatnonzero(~(hit["t_hit"].numpy() <= ABOVE + BELOW))
    if len(missed):
        near = scene.compute_closest_points(tensor(np.ascontiguousarray(texels.places[missed])), nthreads=1)
        triangle[missed] = near["primitive_ids"].numpy().astype(np.int64)
        uv[missed] = near["primitive_uvs"].numpy()
    return source.at(triangle, np.stack([1 - uv.sum(1), uv[:, 0], uv[:, 1]], 1))


def _of_points(texels: Texels, source: PaintedPoints) -> np.ndarray:
    """(n, 3) linear: the mean of the nearest points, nearer ones counting more."""
    count = min(NEIGHBOURS, len(source.points))
    distance, which = cKDTree(source.points).query(texels.places, k=list(range(1, count + 1)))
    weight = 1 / (distance**2 + 1e-8)
    return (weight[..., None] * source.colours[which]).sum(1) / weight.sum(1, keepdims=True)
