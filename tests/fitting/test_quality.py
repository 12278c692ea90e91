"""A verdict on outlines: believed where they are met, denied where the object is something else, with words."""

from dataclasses import replace

import numpy as np
import pytest

from procmodels import load
from procmodels.parts.primitives import box
from procmodels.shape import normalised
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.fitting import beliefs, quality
from recon.fitting.refine import Refined
from recon.fitting.uncertainty import Certainty, Choice

PARAMS = {"width": 0.45, "depth": 0.5, "leg_height": 0.42, "legs": "support", "arms": "none", "back": "hbar"}
SURE = Certainty({}, {"arms": Choice(0.98, "basic", 0.02, 1.0, 0.0, ())}, {}, {"arms": 1.0})


def judged(seen, views=8, kind="masks"):
    model = load("paper/chair")
    cameras, place = orbit(8, seed=4)
    scene = drawn_scene(seen or model.build(PARAMS), cameras, place)
    scene = replace(scene, silhouettes=replace(scene.silhouettes, used=np.arange(8) < views))
    refined = Refined(PARAMS, place, 0.9, 0.5, (), SURE, next_front=0.5)
    return quality.run(model, scene, refined, 8, kind)


def test_outlines_that_are_met_are_believed():
    found = judged(None)
    assert found.belongs
    assert found.confidence >= beliefs.DOUBTED
    assert not found.warnings
    assert found.mean_iou == pytest.approx(1, abs=0.01)
    assert found.certainty.choices["arms"].rival == "basic"


def test_a_refrigerator_is_no_chair_and_no_choice_is_sure():
    fridge = normalised([box("fridge", (-0.3, -0.3, 0), (0.3, 0.3, 1.7))])
    found = judged(fridge)
    assert not found.belongs
    assert found.confidence < beliefs.DENIED
    assert "not a chair" in found.warnings[0]
    assert not any("explains the outlines only" in w for w in found.warnings), "it was said already"
    assert found.certainty.choices["arms"].chance < min(0.9, judged(None).certainty.choices["arms"].chance)


def test_few_views_are_believed_like_one():
    assert judged(None, views=3).confidence == judged(None, views=3, kind="image").confidence
