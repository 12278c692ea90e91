"""A shape from a file as a target to fit: cleaned surface points, and the ways in which it may stand and face.

Every hypothesis is a rotation canonical_from_input; with it come the points in that canonical frame (box centred,
longest side 1) and the similarity back to the file's own axes and units.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.ndimage

from datasets.axis_rotations import turn
from datasets.voxels import spacing_of, splat_grid, surface_grid
from recon.files.shape import Kind, Surface
from recon.files.shape_files import read_cloud, read_mesh, read_splat, read_voxels, ups_of
from recon.scene import InputError
from recon.shapes.outlier_removal import CleaningOptions, cleaned

log = logging.getLogger("recon")
AXES = ("x", "y", "z", "-x", "-y", "-z")


@dataclass(frozen=True)
class ShapeOptions:
    """How a shape is read and cleaned."""

    up: str = "auto"  # axis of the file that points up; auto tries y and z
    front: str = "auto"  # axis of the file that the object faces; auto tries all four
    samples: int = 20_000  # points drawn from a mesh, and kept of a dense cloud
    max_faces: int = 1_000_000  # larger meshes are voxelised from points
    opacity: float = 0.3  # Gaussians below are not seen
    seed: int = 0
    cleaning: CleaningOptions = field(default_factory=CleaningOptions)


@dataclass(frozen=True)
class Target:
    """What is to be met.

    points    (n, 3) float, surface points in the file's axes and units
    spacing   median distance of a point to its nearest neighbour, share of the longest side
    complete  False for sparse clouds, whose gaps say little
    triangles (m, 3, 3) float corners of the mesh; (0, 3, 3) when points are all that is known
    ups       axes that may point up, the format's convention first
    level_from_input  (3, 3) rotation that sets upright what stood on a floor that leans; the axes are those after it
    kind      Kind, and what in words
    """

    points: np.ndarray
    spacing: float
    complete: bool
    triangles: np.ndarray
    ups: tuple[str, ...]
    fronts: tuple[str, ...]
    kind: str
    what: str
    warnings: tuple[str, ...] = ()
    level_from_input: np.ndarray = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class Hypothesis:
    """One way to stand: the words, input_from_canonical (4, 4) similarity, and the points (n, 3) in canonical units."""

    name: str
    input_from_canonical: np.ndarray
    points: np.ndarray


def run(path: Path, kind: str, what: str, options: ShapeOptions = ShapeOptions()) -> Target:
    """Read and clean. Raises InputError saying what is wrong with the file and what to do."""
    triangles = np.zeros((0, 3, 3))
    if kind == Kind.MESH:
        surface = read_mesh(path)
        points = sampled(surface, options.samples, options.seed)
        what = _counted(path, what, "a mesh", f"{len(surface.triangles):,} faces")
        if len(surface.triangles) <= options.max_faces:
            triangles = surface.vertices[surface.triangles]
    elif kind == Kind.VOXELS:
        points = _voxel_points(read_voxels(path))
    else:
        points = read_splat(path, options.opacity) if kind == Kind.SPLAT else read_cloud(path)
        what = _counted(path, what, "a point cloud", f"{len(points):,} points")
    ups = ups_of(path) if options.up == "auto" else (_axis(options.up, "--up"),)
    noisy = kind in (Kind.CLOUD, Kind.SPLAT)
    left = cleaned(points, path, ups, noisy, options.samples, options.seed, options.cleaning)
    clean, warnings = left.points, left.said
    ups = ups if left.up is None else (left.up,)
    if len(warnings):
        triangles = triangles[:0]  # what was left out of the points must not come back
        log.warning("%s", "; ".join(warnings))
    fronts = () if options.front == "auto" else (_axis(options.front, "--front"),)
    if fronts and not any(up.strip("-") != fronts[0].strip("-") for up in ups):
        raise InputError(f"--up {options.up} and --front {options.front} are the same line; they must differ")
    complete = kind in (Kind.MESH, Kind.VOXELS)
    level = left.level_from_input
    return Target(clean, spacing_of(clean), complete, triangles, ups, fronts, str(kind), what, tuple(warnings), level)


def _counted(path: Path, what: str, kind: str, number: str) -> str:
    """The same words with a number in them, when the format cannot be counted before it is read."""
    if not what.startswith(f"{kind} ("):
        return what
    log.info("%s is %s of %s", path, kind, number)
    return what.replace(kind, f"{kind} of {number}", 1)


def of_triangles(
    triangles: np.ndarray, ups: tuple[str, ...], what: str, samples: int = 20_000, seed: int = 0
) -> Target:
    """A clean closed surface (m, 3, 3) as a target; its front is unknown."""
    corners = triangles.reshape(-1, 3)
    points = sampled(Surface(corners, np.arange(len(corners)).reshape(-1, 3)), samples, seed)
    return Target(points, spacing_of(points), True, triangles, ups, (), str(Kind.MESH), what)


def _axis(name: str, option: str) -> str:
    if name not in AXES:
        raise InputError(f"{option} is one of auto, {', '.join(AXES)}; got {name!r}")
    return name


def hypotheses(target: Target) -> list[Hypothesis]:
    """Every way to stand that the options leave open, the format's convention first."""
    out = []
    for up in target.ups:
        for front in target.fronts or [a for a in ("-y", "z", "y", "x", "-x", "-z") if a.strip("-") != up.strip("-")]:
            if front.strip("-") != up.strip("-"):
                rotation, said = turn(up, front) @ target.level_from_input, f"up {up}, front {front}"
                if not target.fronts and (yaw := _askew(target.points @ rotation.T)):
                    rotation, said = _yaw(-yaw) @ rotation, f"{said} turned by {yaw:.0f} degrees"
                points, back = canonical(target.points, rotation)
                out.append(Hypothesis(said, back, points))
    return out


def _askew(points: np.ndarray, gain: float = 0.88) -> float:
    """Degrees, -45..45, by which the object's ground plan is turned; 0 unless turning it back makes its box smaller.

    points (n, 3), z up; the box must shrink to this share, as that of a round seat or a five-star base never does.
    """
    some = points[:: max(1, len(points) // 1500), :2]
    degrees = np.arange(-44, 46)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y = np.outer(c, some[:, 0]) + np.outer(s, some[:, 1]), np.outer(c, some[:, 1]) - np.outer(s, some[:, 0])
    area = np.ptp(x, axis=1) * np.ptp(y, axis=1)
    best = int(area.argmin())
    return float(degrees[best]) if area[best] < gain * area[44] else 0.0


def _yaw(degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)])


def canonical(points: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points turned, box centred, longest side 1; and input_from_canonical (4, 4)."""
    turned = points @ rotation.T
    low, high = turned.min(0), turned.max(0)
    scale = float((high - low).max())
    back = np.eye(4)
    back[:3, :3] = scale * rotation.T
    back[:3, 3] = rotation.T @ (low + high) / 2
    return (turned - (low + high) / 2) / scale, back


def grid_of(target: Target, hypothesis: Hypothesis) -> np.ndarray:
    """(64, 64, 64) bool surface grid for the network: of the triangles when known, else of splatted points."""
    if len(target.triangles):
        forward = np.linalg.inv(hypothesis.input_from_canonical)
        corners = target.triangles.reshape(-1, 3) @ forward[:3, :3].T + forward[:3, 3]
        return surface_grid(corners, np.arange(len(corners)).reshape(-1, 3))
    return splat_grid(hypothesis.points, target.spacing)


def grids_of(target: Target, ways: list[Hypothesis]) -> np.ndarray:
    """(len(ways), 64, 64, 64) bool; ways that differ by quarter turns share one grid with its axes exchanged."""
    made: list[tuple[np.ndarray, np.ndarray]] = []  # turn, grid
    out = []
    for way in ways:
        turn = _turn_of(way)
        for known, grid in made:
            relative = turn @ known.T
            if np.allclose(np.abs(relative).max(1), 1, atol=1e-6):
                order = np.abs(relative).argmax(1)
                out.append(np.flip(grid.transpose(order), [i for i in range(3) if relative[i, order[i]] < 0]))
                break
        else:
            made.append((turn, grid_of(target, way)))
            out.append(made[-1][1])
    return np.stack(out)


def _turn_of(way: Hypothesis) -> np.ndarray:
    """(3, 3) canonical_from_input without scale."""
    scaled = way.input_from_canonical[:3, :3].T
    return scaled / np.linalg.norm(scaled[0])


def sampled(surface: Surface, count: int, seed: int) -> np.ndarray:
    """(count, 3) float, area-weighted points. Raises InputError when all faces are degenerate."""
    ends = np.cumsum(_areas(surface))
    if not np.isfinite(ends[-1]) or ends[-1] <= 0:
        raise InputError("the mesh has no area: all its faces are lines or points; export it again")
    rng = np.random.default_rng(seed)
    chosen = np.minimum(np.searchsorted(ends, (np.arange(count) + rng.random(count)) / count * ends[-1]), len(ends) - 1)
    u, v = rng.random((2, count, 1))
    root = np.sqrt(u)
    a, b, c = surface.vertices[surface.triangles[chosen]].transpose(1, 0, 2)
    return (1 - root) * a + root * (1 - v) * b + root * v * c


def _areas(surface: Surface, portion: int = 1_000_000) -> np.ndarray:
    """(m,) float, twice the triangles' areas in units of the longest side squared, so that no unit is too small.

    In portions: the corners of all triangles of a large mesh would take gigabytes.
    """
    size = float(np.ptp(surface.vertices, axis=0).max()) or 1.0
    out = []
    for start in range(0, len(surface.triangles), portion):
        a, b, c = (surface.vertices[surface.triangles[start : start + portion]] / size).transpose(1, 0, 2)
        out.append(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    return np.concatenate(out)


def _voxel_points(grid: np.ndarray) -> np.ndarray:
    """(n, 3) float, centres of filled voxels with an empty neighbour, in voxel units."""
    padded = np.pad(grid, 1)
    inner = scipy.ndimage.binary_erosion(padded)
    return np.argwhere(padded & ~inner) - 0.5
