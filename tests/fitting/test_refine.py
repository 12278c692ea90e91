"""The exact search recovers known parameters and places, and never makes things worse."""

import numpy as np
import pytest

from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.fitting import refine
from recon.fitting.view_starts import Candidate, FitResult
from recon.geometry import align
from recon.scene import Canonical

CHAIR = {"width": 0.62, "depth": 0.47, "leg_height": 0.41, "legs": "round", "arms": "solid", "back": "hbar"}


@pytest.fixture(scope="module")
def scene(chair):
    cameras, truth = orbit(14, seed=1)
    return (*drawn_scene(chair.build(CHAIR), cameras, truth), truth)


def _nudged(truth, seed=0):
    rng = np.random.default_rng(seed)
    move = np.eye(4)
    angle = np.radians(4)
    move[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    move[:3, :3] *= 1.04
    move[:3, 3] = rng.uniform(-0.03, 0.03, 3)
    return Canonical(truth.world_from_canonical @ move)


def test_known_parameters_are_recovered_from_a_wrong_start(scene, chair):
    poses, masks, truth = scene
    start = {**CHAIR, "width": 0.5, "depth": 0.55, "leg_height": 0.35, "arms": "none", "back": "vbar"}
    found = refine.run(chair, poses, masks, _nudged(truth), FitResult((Candidate(start, 0, 1.0),)))
    assert {k: v for k, v in found.params.items() if isinstance(v, str)} == {
        k: v for k, v in CHAIR.items() if isinstance(v, str)
    }
    for s in chair.space.scalars:
        assert found.params[s.name] == pytest.approx(CHAIR[s.name], abs=0.02 * (s.high - s.low) + 0.003)
    assert found.mean_iou > 0.97 > found.start_iou
    turn = np.linalg.inv(found.canonical.world_from_canonical) @ truth.world_from_canonical
    assert turn == pytest.approx(np.eye(4), abs=0.01)


def test_a_wrong_front_is_turned(scene, chair):
    poses, masks, truth = scene
    behind = Canonical(truth.world_from_canonical @ align.quarter_turn(2))
    found = refine.run(chair, poses, masks, behind, FitResult((Candidate(CHAIR, 0, 1.0),)))
    turn = np.linalg.inv(found.canonical.world_from_canonical) @ truth.world_from_canonical
    assert abs(np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))) < 2
    assert found.alternatives[0][1] < found.mean_iou


def test_a_perfect_start_is_not_made_worse(scene, chair):
    poses, masks, truth = scene
    found = refine.run(chair, poses, masks, truth, FitResult((Candidate(CHAIR, 0, 0.0),)))
    assert found.mean_iou >= found.start_iou > 0.97


def test_the_same_input_gives_the_same_result(scene, chair):
    poses, masks, truth = scene
    fitted = FitResult((Candidate({**CHAIR, "width": 0.7}, 0, 0.0),))
    a, b = (refine.run(chair, poses, masks, _nudged(truth), fitted) for _ in range(2))
    assert a.params == b.params
    assert (a.canonical.world_from_canonical == b.canonical.world_from_canonical).all()
