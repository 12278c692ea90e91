"""Which size is believed: what the user says, else what sheets tell; both disagreeing is said."""

import numpy as np
import pytest

import procmodels
from recon.pipelines.real_size import GIVEN, SHEET, check_ruler, decide
from recon.scene import Canonical, InputError, PrintedSheet
from tests.made_up import CHAIR
from tests.made_up_sheets import lying

MODEL = procmodels.load("paper/chair")  # this chair is as high as a canonical unit
UNIT = 2.0  # world units a metre


def sheet(size=1.0, views=5, name="sheet 1"):
    """One that was printed at `size`."""
    return PrintedSheet(name, np.diag([UNIT, UNIT, UNIT, 1]) @ lying(size=size), tuple("abcdefgh"[:views]), 0.1)


def size(given=None, ruler=None, sheets=(), height=0.9):
    place = np.diag([UNIT * height] * 3 + [1.0])
    return decide(given, ruler, tuple(sheets), Canonical(place), MODEL, dict(CHAIR))


def test_nothing_is_known():
    assert size() == decide(None, None, (), Canonical(np.eye(4)), MODEL, dict(CHAIR))
    assert size().height is None
    assert size().source == ""


def test_the_sheet_tells():
    found = size(sheets=[sheet()])
    assert found.height == pytest.approx(0.9)
    assert found.source == SHEET
    assert not found.warnings


def test_height_wins_and_a_difference_is_said():
    near = size(given=0.91, sheets=[sheet()])
    assert (near.height, near.source, near.warnings) == (0.91, GIVEN, ())
    far = size(given=0.80, sheets=[sheet()])
    assert far.height == 0.80
    assert "--height says 0.800 m and the printed sheet 0.900 m (+12.5 %)" in far.warnings[0]
    assert "--ruler" in far.warnings[0]


def test_a_print_of_97_per_cent_with_its_ruler_measured():
    """The sheet is smaller than it says, so the object seems larger; the ruler of 145.5 mm puts it right."""
    small = sheet(size=0.97)
    assert size(sheets=[small]).height == pytest.approx(0.9 / 0.97)
    assert size(sheets=[small], ruler=145.5).height == pytest.approx(0.9)
    assert "--ruler" in size(given=0.9, sheets=[small]).warnings[0]
    assert not size(given=0.9, sheets=[small], ruler=145.5).warnings


def test_sheets_that_differ():
    found = size(sheets=[sheet(), sheet(0.97, name="sheet 2")])
    assert "sheet 1" in found.warnings[0]
    assert "sheet 2" in found.warnings[0]
    assert 0.9 < found.height < 0.9 / 0.97
    assert not size(sheets=[sheet(), sheet(0.995, name="sheet 2")]).warnings


def test_a_ruler_without_a_sheet_and_one_that_is_none():
    assert "no printed sheet was found" in size(ruler=147.0).warnings[0]
    check_ruler(None)
    check_ruler(145.5)
    with pytest.raises(InputError, match="150 mm"):
        check_ruler(14.5)
