"""The measures, as pinned down in the README: D_chamfer with its floor, D_voxel, agreement of world frames."""

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


def d_voxel(a: np.ndarray, b: np.ndarray) -> float:
    """Differing voxels of two (..., R, R, R) bool grids, in percent of all."""
    return float(100 * np.mean(a ^ b))


def similarity_between(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(4, 4) similarity target_from_source that maps points (n, 3) best onto points (n, 3) (Umeyama 1991)."""
    mean_s, mean_t = source.mean(0), target.mean(0)
    s, t = source - mean_s, target - mean_t
    u, d, vt = np.linalg.svd(t.T @ s / len(s))
    sign = np.array([1, 1, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = u @ np.diag(sign) @ vt
    scale = (d * sign).sum() / s.var(0).sum()
    out = np.eye(4)
    out[:3, :3] = scale * rotation
    out[:3, 3] = mean_t - scale * rotation @ mean_s
    return out
