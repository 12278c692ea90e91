"""Confidence: intervals that widen with what is not seen, chances that grow with the gap, calibration that is sound."""

import json
from dataclasses import replace

import numpy as np
import pytest

from procmodels import load
from recon.evaluate import calibration
from recon.evaluate.calibration import Sample
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.fitting import refine, uncertainty
from recon.fitting.mask_target import Masks
from recon.fitting.problem import Problem
from recon.fitting.refine import RefineOptions
from recon.fitting.search import Search
from recon.fitting.uncertainty import Calibration, chance


@pytest.fixture(scope="module")
def scene():
    model = load("paper/chair")
    params = model.space.sample(np.random.default_rng(8))
    cameras, place = orbit(8, seed=3)
    return model, params, drawn_scene(model.build(params), cameras, place)


def search_of(scene, views=8):
    model, params, seen = scene
    seen = replace(seen, silhouettes=replace(seen.silhouettes, used=np.arange(8) < views))
    options = RefineOptions(size=96)
    problem = refine.problem_of(model, seen, options)
    return Search(problem, options.schedule), problem.state(params, seen.canonical.world_from_canonical)


def test_the_truth_lies_in_its_intervals_and_fewer_views_widen_them(scene):
    model, params = scene[:2]
    many, few = (uncertainty.run(*search_of(scene, views)) for views in (8, 2))
    for s in model.space.scalars:
        low, high = many.intervals[s.name]
        assert s.low <= low <= float(params[s.name]) <= high <= s.high
        assert many.spreads[s.name] < few.spreads[s.name]
    assert set(many.choices) == {p.name for p in model.space.discrete}
    assert all(c.rival != params[n] for n, c in many.choices.items())
    assert all(c.gap > 0 for c in many.choices.values())


def test_what_is_not_seen_keeps_its_whole_range(scene):
    search, state = search_of(scene)
    target = search.problem.target
    nothing = Masks(target.masks, np.zeros_like(target.valid), target.looks)
    blind = Search(Problem(search.problem.model, nothing, search.problem.placement), search.schedule)
    sure = uncertainty.run(blind, state, Calibration(1.0, 0.0, 1.0, 0.0))
    assert all(spread == pytest.approx(12**-0.5) for spread in sure.spreads.values())


def test_chance_grows_with_the_gap():
    use = Calibration(1.0, 0.0, 1.5, 3.0)
    chances = [chance(g, use) for g in (0.0, 0.01, 0.1, 1.0)]
    assert chances == sorted(chances)
    assert 0 < chances[0] < 0.1
    assert chances[-1] > 0.95


def test_calibration_recovers_a_known_truth():
    """Errors twice the stated spread and choices that follow a logistic curve: both are found again."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(1500):
        gaps = np.exp(rng.uniform(-6, 1, 3))
        right = rng.random(3) < 1 / (1 + np.exp(-(1.2 * np.log(gaps) + 4)))
        errors = np.abs(rng.normal(size=4) * 2 * 0.03)
        found.append(
            Sample(tuple((float(e), 0.03) for e in errors), tuple(zip(right.tolist(), gaps.tolist(), strict=True)))
        )
    use = calibration.fitted(found[::2])
    assert np.hypot(use.floor, use.spread * 0.03) == pytest.approx(0.06, rel=0.06)
    assert use.slope == pytest.approx(1.2, rel=0.25)
    covered = calibration.coverage(found[1::2], use)
    assert all(abs(level - share) < 0.05 for level, share in covered.items())
    for stated, measured, count in calibration.reliability(found[1::2], use):
        assert count > 100
        assert stated == pytest.approx(measured, abs=0.08)
    picture = calibration.plot(covered, calibration.reliability(found, use))
    assert picture.shape == (460, 920, 3)


def test_samples_are_kept(tmp_path, monkeypatch):
    options = calibration.CalibrationOptions(classes=("paper/chair",), shapes=1, views=(4, 4), work=tmp_path)
    first = calibration.samples(options)
    assert len(first) == 1
    assert len(first[0].scalars) == 3
    assert len(first[0].choices) == 3
    monkeypatch.setattr(refine, "run", lambda *_: pytest.fail("measured again"))
    assert calibration.samples(options) == first


def test_shipped_calibration_is_of_held_out_shapes():
    values = json.loads(uncertainty.FILE.read_text())
    assert values["spread"] > 0
    assert values["slope"] > 0
    assert values["shapes"] >= 12
    assert values["classes"]
