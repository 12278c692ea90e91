"""Differences of colours, and a look beside the truth."""

from __future__ import annotations

import numpy as np
import pytest

from procmodels.look import Look, linear
from recon.appearance.atlas import unwrapped
from recon.appearance.fill import picture
from recon.appearance.texels import Texels
from recon.evaluate.colours import compared, delta_e
from recon.files.painted import PaintedMesh, Piece
from tests.appearance.made_photos import stool


def test_delta_e_of_known_colours():
    """Black to white is 100 in lightness; sRGB red is (53.2, 80.1, 67.2) in CIELAB."""
    black, white, red = np.zeros((1, 3)), np.ones((1, 3)), np.array([(1.0, 0, 0)])
    assert delta_e(black, white) == pytest.approx([100], abs=0.1)
    assert delta_e(red, black) == pytest.approx([np.linalg.norm((53.24, 80.09, 67.20))], abs=0.2)
    greys = linear(np.array([[0.5] * 3, [0.6] * 3]))
    assert delta_e(greys[:1], greys[1:]) == pytest.approx([9.87], abs=0.1)


def test_a_true_look_differs_by_nothing_and_another_by_its_difference():
    shape, atlas = stool(), unwrapped(stool(), 256)
    colours = np.array([(0.5, 0.1, 0.08), (0.1, 0.12, 0.5), (0.4, 0.32, 0.1)])
    count = len(atlas.corners)
    piece = Piece(colours[atlas.part][:, None] * np.ones((count, 3, 3)), np.zeros((count, 3, 2)), None)
    source = PaintedMesh(atlas.corners, (piece,))
    texels = Texels.of(atlas)
    true = Look(colours, picture(texels, colours[atlas.part[texels.triangle]]), atlas.uv)
    same = compared(shape, true, source)
    assert same.share.sum() == pytest.approx(1)
    assert np.median(same.places) < 6, "places where boards and seat touch may take either"
    assert same.base.max() < 12
    grey = compared(shape, Look(np.full((3, 3), 0.2)), source)
    assert grey.base.min() > 20
