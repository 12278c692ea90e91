"""The measures, as pinned down in docs/results.md: D_chamfer with its floor, D_voxel."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import cKDTree


def normalised(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A copy with its bounding box centred and its longest side 1."""
    out = trimesh.Trimesh(mesh.vertices - mesh.bounds.mean(0), mesh.faces, process=False)
    out.vertices /= out.extents.max()
    return out


def chamfer(a: trimesh.Trimesh, b: trimesh.Trimesh, samples: int = 10_000, seed: int = 0) -> float:
    """D_chamfer: mean squared nearest distance from a to b plus from b to a, of area-weighted surface samples.

    Both meshes are normalised first. Two sample sets of one mesh give the metric's floor, not 0.
    """
    points = [
        np.asarray(trimesh.sample.sample_surface(normalised(m), samples, seed=seed + i)[0])
        for i, m in enumerate((a, b))
    ]
    there, back = cKDTree(points[1]).query(points[0])[0], cKDTree(points[0]).query(points[1])[0]
    return float((there**2).mean() + (back**2).mean())


def quarter_turned(mesh: trimesh.Trimesh, turn: int) -> trimesh.Trimesh:
    """A copy turned about the vertical by so many quarter turns."""
    return mesh.copy().apply_transform(trimesh.transformations.rotation_matrix(turn * np.pi / 2, (0, 0, 1)))


def best_turn(a: trimesh.Trimesh, b: trimesh.Trimesh, samples: int = 10_000) -> tuple[float, int]:
    """The least D_chamfer of the four quarter turns of a, and that turn."""
    return min((chamfer(quarter_turned(a, turn), b, samples), turn) for turn in range(4))


def d_voxel(a: np.ndarray, b: np.ndarray) -> float:
    """Differing voxels of two (..., R, R, R) bool grids, in percent of all."""
    return float(100 * np.mean(a ^ b))
