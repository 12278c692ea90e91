"""The floor where printed sheets lie on it, which need no texture; and what to say of sheets that lie elsewhere."""

from __future__ import annotations

import numpy as np

from recon.geometry.room_planes import FloorOptions, floor_plane, look_point, up_direction
from recon.scene import Cameras, PrintedSheet, ReconstructionError

LEVEL = 3.0  # degrees between a sheet and the floor that points show, of a sheet that lies on it
RAISED = 0.05  # metres above the floor that points show: a sheet higher than that lies on something
_SIZE_ONLY = ": it tells the size, but not where the floor is"
STRONG = 300  # points on the floor: so many tell its slope better than one sheet, which may curl


def floor_of(
    sheets: tuple[PrintedSheet, ...],
    points: np.ndarray,
    cameras: Cameras,
    rng: np.random.Generator,
    options: FloorOptions = FloorOptions(),
) -> tuple[np.ndarray | None, list[str]]:
    """The floor (4,), n towards the cameras, or None where sheets do not tell it; and warnings about them.

    points  (n, 3) float, sparse points. Where many show a floor, its slope is theirs and its height the sheet's.
    """
    up = up_direction(cameras)
    lying = [s for s in sheets if s.plane[:3] @ up > np.cos(np.radians(options.lean))]
    warnings = [_hangs(s, up) for s in sheets if s not in lying]
    if not lying:
        return None, warnings
    found, support = _by_points(points, cameras, rng, options)
    if found is not None and support >= STRONG:
        on = [s for s in lying if _lies_on(s, found)]
        warnings += [_raised(s, found) for s in lying if s not in on]
        if not on:
            return None, warnings
        middle = np.mean([s.world_from_sheet[:3, 3] for s in on], axis=0)
        return np.array([*found[:3], -found[:3] @ middle]), warnings
    lowest = min(lying, key=lambda s: float(up @ s.world_from_sheet[:3, 3]))
    on = [s for s in lying if _lies_on(s, lowest.plane)]
    warnings += [_raised(s, lowest.plane) for s in lying if s not in on]
    return _through(on), warnings


def _by_points(
    points: np.ndarray, cameras: Cameras, rng: np.random.Generator, options: FloorOptions
) -> tuple[np.ndarray | None, int]:
    """The floor that points show, and how many lie on it."""
    try:
        plane = floor_plane(points, cameras, rng, options)
    except ReconstructionError:
        return None, 0
    distance = float(np.median(np.linalg.norm(cameras.centres() - look_point(cameras), axis=1)))
    return plane, int((np.abs(points @ plane[:3] + plane[3]) < options.tolerance * distance).sum())


def _through(sheets: list[PrintedSheet]) -> np.ndarray:
    """The plane of one sheet, or the one through the corners of several, which together are longer than one."""
    if len(sheets) == 1:
        return sheets[0].plane
    corners = [s.world_from_sheet @ [x, y, 0, 1] for s in sheets for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    places = np.array(corners)[:, :3]
    middle = places.mean(0)
    normal = np.linalg.svd(places - middle)[2][2]
    normal *= np.sign(normal @ sheets[0].plane[:3])
    return np.array([*normal, -normal @ middle])


def _degrees(sheet: PrintedSheet, normal: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(sheet.plane[:3] @ normal, -1, 1))))


def _metres_above(sheet: PrintedSheet, floor: np.ndarray) -> float:
    return float(floor[:3] @ sheet.world_from_sheet[:3, 3] + floor[3]) * sheet.metres_per_unit


def _lies_on(sheet: PrintedSheet, floor: np.ndarray) -> bool:
    return _degrees(sheet, floor[:3]) <= LEVEL and abs(_metres_above(sheet, floor)) <= RAISED


def _hangs(sheet: PrintedSheet, up: np.ndarray) -> str:
    return f"the printed {sheet.name} leans by {_degrees(sheet, up):.0f} degrees{_SIZE_ONLY}"


def _raised(sheet: PrintedSheet, floor: np.ndarray) -> str:
    high, lean = 100 * _metres_above(sheet, floor), _degrees(sheet, floor[:3])
    where = f"lies {high:.0f} cm above the floor" if abs(high) > 100 * RAISED else f"leans by {lean:.0f} degrees"
    return f"the printed {sheet.name} {where}{_SIZE_ONLY}"
