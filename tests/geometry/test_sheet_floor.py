"""The floor by sheets: on it, on a rug, on a table, on a wall."""

import numpy as np
import pytest

from recon.geometry.sheet_floor import floor_of
from recon.scene import Cameras, PrintedSheet
from tests.made_up_sheets import intrinsics, look_at, lying

UNIT = 1.7  # world units a metre; the world's z is up


def cameras():
    eyes = [2.2 * np.array([np.cos(a), np.sin(a), 0.5]) for a in np.linspace(0, 2 * np.pi, 10, endpoint=False)]
    poses = np.array([look_at(e) for e in eyes])
    poses[:, :3, 3] *= UNIT
    return Cameras(
        tuple(map(str, range(10))), np.tile(intrinsics(800, 600, 700), (10, 1, 1)), poses, np.tile([800, 600], (10, 1))
    )


def sheet(place, name="sheet 1"):
    return PrintedSheet(name, np.diag([UNIT, UNIT, UNIT, 1]) @ place, ("0", "1"), 0.2)


def at(x, y, z, degrees=0.0, lean=0.0):
    c, s = np.cos(np.radians(lean)), np.sin(np.radians(lean))
    turn = np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
    out = turn @ lying(0, 0, degrees)
    out[:3, 3] = x, y, z
    return out


def floor_points(count, z=0.0, seed=0):
    rng = np.random.default_rng(seed)
    return UNIT * np.column_stack([rng.uniform(-1, 1, (count, 2)), z + rng.normal(0, 1e-3, count)])


def floor(sheets, points=None):
    points = np.zeros((0, 3)) if points is None else points
    return floor_of(tuple(sheets), points, cameras(), np.random.default_rng(0))


def lean(plane):
    """Degrees from level."""
    return np.degrees(np.arccos(np.clip(plane[2], -1, 1)))


def level(plane, metres):
    """Whether a plane is level at a height."""
    assert lean(plane) < 0.3
    assert -plane[3] / UNIT == pytest.approx(metres, abs=2e-3)


def test_a_plain_floor_has_no_points_and_the_sheet_tells_it():
    plane, warnings = floor([sheet(at(0.5, 0.2, 0.0, 40))])
    level(plane, 0.0)
    assert not warnings


def test_two_sheets_together():
    plane, _ = floor([sheet(at(0.5, 0.2, 0.002, 40)), sheet(at(-0.5, -0.4, -0.002, 10), "sheet 2")])
    assert lean(plane) < 0.4
    assert abs(plane[3]) / UNIT < 3e-3


def test_many_points_tell_the_slope_and_the_sheet_the_height():
    """A curled sheet that leans by two degrees, on a rug of one centimetre."""
    plane, warnings = floor([sheet(at(0.5, 0.2, 0.01, 40, lean=2.0))], floor_points(800))
    level(plane, 0.01)
    assert not warnings


def test_a_sheet_on_a_table_does_not_lift_the_floor():
    plane, warnings = floor([sheet(at(0.1, 0.1, 0.45))], floor_points(800))
    assert plane is None, "the points' floor stands"
    assert "45 cm above the floor" in warnings[0]
    plane, warnings = floor([sheet(at(0.1, 0.1, 0.45)), sheet(at(0.6, 0, 0), "sheet 2")])
    level(plane, 0.0)
    assert "45 cm above" in warnings[0]


def test_a_sheet_on_a_wall_tells_no_floor():
    plane, warnings = floor([sheet(at(0.1, 1.0, 0.5, lean=90))])
    assert plane is None
    assert "leans by 90 degrees: it tells the size" in warnings[0]


def test_a_sheet_that_leans_where_the_floor_is_known():
    plane, warnings = floor([sheet(at(0.5, 0.2, 0.0, lean=12))], floor_points(800))
    assert plane is None
    assert "leans by 12 degrees" in warnings[0]
