"""Meshes and point clouds to 64^3 surface grids in the canonical frame, and grids packed as bits.

A surface grid marks every voxel that a triangle touches (REFERENCE: solid grids would lose 0.01-thin boards).
Voxel (i, j, k) is centred at ((i, j, k) + 0.5) / 64 - 0.5.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

RESOLUTION = 64
LARGE = 8.0  # voxels: larger balls are found by a distance transform


def surface_grid(
    vertices: np.ndarray, triangles: np.ndarray, resolution: int = RESOLUTION, scratch: Path | None = None
) -> np.ndarray:
    """(R, R, R) bool, voxels of the unit cube around the origin that any triangle touches.

    vertices (n, 3) float in canonical units, triangles (m, 3) int. Geometry outside the cube is ignored.
    scratch  a .ply file to write over: through it thousands of grids take half the time
    """
    import open3d as o3d

    # The mesh is shrunk by a hair: faces that lie exactly on a border of the cube (the longest side always does)
    # would otherwise fall outside, or on the next voxel, by rounding.
    points = np.asarray(vertices, float) * (1 - 1e-6)
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(points), o3d.utility.Vector3iVector(np.asarray(triangles, np.int32))
    )
    grid = o3d.geometry.VoxelGrid.create_from_triangle_mesh_within_bounds(
        mesh, 1 / resolution, np.full(3, -0.5), np.full(3, 0.5)
    )
    if scratch is not None and o3d.io.write_voxel_grid(scratch, grid, write_ascii=False, compressed=False):
        return _filled(_voxels_of_ply(scratch.read_bytes()), resolution)
    return _filled(np.array([v.grid_index for v in grid.get_voxels()]), resolution)


def point_grid(points: np.ndarray, resolution: int = RESOLUTION) -> np.ndarray:
    """(R, R, R) bool, voxels that hold any of the (n, 3) points, given in canonical units."""
    index = np.floor((np.asarray(points, float) * (1 - 1e-6) + 0.5) * resolution).astype(int)
    return _filled(index, resolution)


def splat_grid(points: np.ndarray, spacing: float, resolution: int = RESOLUTION) -> np.ndarray:
    """(R, R, R) bool, points (n, 3) in canonical units as a surface without gaps: balls, peeled back to their middles.

    spacing  of the points (see spacing_of): a ball's radius follows the cloud's own gaps, so that a sparse cloud
             becomes a surface, not dust
    """
    radius = 1.6 * spacing * resolution
    grid = point_grid(points, resolution)
    if radius < 1.5:
        return grid
    balls = _within(grid, radius)
    # What lies as near to an empty voxel is peeled off; nearest are those that touch a filled one.
    rim = ~balls & _within(balls, 1.8)
    return balls & ~_within(rim, 0.7 * radius) | grid


def spacing_of(points: np.ndarray) -> float:
    """Median distance of a point to its nearest neighbour, as a share of the longest side."""
    from scipy.spatial import cKDTree

    some = points[:: max(1, len(points) // 2000)]
    nearest = cKDTree(points).query(some, 2)[0][:, 1]
    return float(np.median(nearest) / np.ptp(points, axis=0).max())


def voxel_centres(resolution: int = RESOLUTION) -> np.ndarray:
    """(R, R, R, 3) float, canonical coordinates of every voxel's centre."""
    axis = (np.arange(resolution) + 0.5) / resolution - 0.5
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)


def pack(grid: np.ndarray) -> np.ndarray:
    """(..., R, R, R) bool to (..., R^3 / 8) uint8."""
    return np.packbits(grid.reshape(*grid.shape[:-3], -1), axis=-1)


def unpack(bits: np.ndarray, resolution: int = RESOLUTION) -> np.ndarray:
    """The inverse of pack."""
    flat = np.unpackbits(bits, axis=-1, count=resolution**3)
    return flat.reshape(*bits.shape[:-1], resolution, resolution, resolution).astype(bool)


def _voxels_of_ply(content: bytes) -> np.ndarray:
    """(n, 3) int, the indices in a file that open3d wrote: its last rows, each three doubles and a colour."""
    row = np.dtype([("index", "<f8", 3), ("colour", "u1", 3)])
    head, _, body = content.partition(b"end_header\n")
    count = next(int(line.split()[2]) for line in head.splitlines() if line.startswith(b"element vertex"))
    return np.frombuffer(body, row, count, len(body) - count * row.itemsize)["index"].astype(int)


def _within(grid: np.ndarray, radius: float) -> np.ndarray:
    """(R, R, R) bool, voxels whose centre lies at most `radius` voxels from a filled one's.

    Few voxels are filled: setting a small ball round each of them takes a tenth of a distance transform's time.
    """
    if radius > LARGE:
        from scipy.ndimage import distance_transform_edt

        return distance_transform_edt(~grid) <= radius
    reach = int(radius)
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    steps = steps[(steps**2).sum(1) <= radius**2]
    side = len(grid) + 2 * reach
    strides = np.array([side * side, side, 1])
    out = np.zeros(side**3, bool)
    middles = (np.argwhere(grid) + reach) @ strides
    for step in steps @ strides:
        out[middles + step] = True
    return out.reshape((side,) * 3)[(slice(reach, reach + len(grid)),) * 3]


def _filled(index: np.ndarray, resolution: int) -> np.ndarray:
    grid = np.zeros((resolution,) * 3, bool)
    index = index.reshape(-1, 3)
    grid[tuple(index[((index >= 0) & (index < resolution)).all(1)].T)] = True
    return grid
