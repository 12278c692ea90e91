"""Meshes, point clouds, Gaussian splats and voxel grids from files of any format, as the kind that is asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from datasets.mesh_reader import MeshError, usable
from recon.files import formats
from recon.files.head import head_of
from recon.files.shape import Cloud, Gaussians, Grid, Surface
from recon.scene import InputError


def ups_of(path: Path) -> tuple[str, ...]:
    """Axes of a shape's file that may point up, its format's convention first."""
    form = formats.format_of(head_of(path))
    return form.ups if form else ("z", "y")


def read_mesh(path: Path) -> Surface:
    """All triangles of a mesh file. Raises InputError for damage and for a mesh without faces."""
    shape, form = formats.read(path, "OBJ")
    if isinstance(shape, Gaussians | Grid):
        raise InputError(f"{path} is no mesh ({form.name}); leave --input out")
    found = shape if isinstance(shape, Surface) else Surface(shape.points, np.zeros((0, 3), int))
    try:
        return Surface(*usable(found.vertices, found.triangles, str(path)))
    except MeshError as error:
        raise InputError(str(error)) from error


def read_cloud(path: Path) -> np.ndarray:
    """(n, 3) float points, with whatever is wrong with single points.

    A mesh's vertices and a splat's centres are points too. Raises InputError for damage.
    """
    shape, _ = formats.read(path, "text")
    if isinstance(shape, Grid):
        raise InputError(f"{path} is a voxel grid; leave --input out")
    if isinstance(shape, Cloud):
        return shape.points
    return shape.vertices if isinstance(shape, Surface) else shape.centres


def read_splat(path: Path, least_opacity: float) -> np.ndarray:
    """(n, 3) float, centres of the Gaussians that can be seen: of at least this opacity.

    Raises InputError for a splat without opacity.
    """
    splat = read_gaussians(path)
    if splat.opacity is None:
        raise InputError(
            f"{path} is a Gaussian splat without opacity, so floaters cannot be told from the object; export it with "
            "opacity, or take its points as they are with --input cloud"
        )
    points = splat.centres[splat.opacity >= least_opacity]
    if len(points) < len(splat.opacity) / 1000 or not len(points):
        raise InputError(
            f"{path}: only {len(points)} of {len(splat.opacity):,} Gaussians are opaque; train the splat longer"
        )
    return points


def read_gaussians(path: Path) -> Gaussians:
    """All Gaussians of a splat. Raises InputError for what is none."""
    shape, form = formats.read(path)
    if not isinstance(shape, Gaussians):
        raise InputError(f"{path} holds no Gaussians ({form.name}); leave --input out")
    return shape


def read_voxels(path: Path) -> np.ndarray:
    """(X, Y, Z) bool. Raises InputError for what is no grid, or an empty one."""
    shape, form = formats.read(path)
    if not isinstance(shape, Grid):
        raise InputError(f"{path} holds no voxel grid ({form.name}); leave --input out")
    if not shape.filled.any():
        raise InputError(f"{path} is a voxel grid with nothing in it")
    return shape.filled
