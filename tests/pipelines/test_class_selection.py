"""--class auto: all classes get a short fit, the best a full one, and the report says what each could explain."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from procmodels import registry
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.fitting.mask_target import Level
from recon.fitting.refine import Refined, RefineOptions
from recon.fitting.view_starts import Candidate, FitOptions, FitResult
from recon.geometry.visual_hull import HullOptions
from recon.geometry.visual_hull import run as hull_run
from recon.outputs.report import words
from recon.outputs.result import tried
from recon.outputs.write import asset_of, report_content
from recon.pipelines import class_selection
from recon.pipelines.class_selection import AutoOptions, Finals, FirstRound
from recon.scene import Canonical, InputError
from tests.made_up import made_up

SCENE = (None, None, None)


def _models(*names, weights=Path()):
    space = SimpleNamespace
    return [SimpleNamespace(name=n, space=space(hash=n), code=n, weights=weights / f"{n}.safetensors") for n in names]


def _refined(iou):
    return Refined({}, Canonical(np.eye(4)), iou, iou, ())


@pytest.fixture
def world(monkeypatch, tmp_path):
    """Three classes whose short and full fits agree by given amounts; what was asked of whom is noted."""
    asked = SimpleNamespace(fits=[], keys=[], short={"bed": 0.4, "chair": 0.8, "sofa": 0.85})
    asked.full = {"bed": 0.5, "chair": 0.93, "sofa": 0.88}

    def fit(model, poses, masks, place, hull, options):
        asked.fits.append((model.name, options))
        return FitResult((Candidate({}, 0, 0.0),))

    monkeypatch.setattr(class_selection.view_starts, "run", fit)
    monkeypatch.setattr(class_selection.refine, "run", lambda model, *_: _refined(asked.full[model.name]))
    monkeypatch.setattr(class_selection.refine, "quick_iou", lambda model, *_: asked.short[model.name])
    for name in asked.short:
        (tmp_path / f"{name}.safetensors").write_text(name)

    def stage(name, options, compute):
        asked.keys.append((name, str(options)))
        return compute()

    asked.run = lambda: class_selection.run(
        stage, _models("bed", "chair", "sofa", weights=tmp_path), SCENE, None, FitOptions(), RefineOptions()
    )
    asked.weights = tmp_path
    return asked


def test_all_get_a_short_fit_and_the_best_two_a_full_one(world):
    chosen = world.run()
    assert [name for name, _ in world.fits] == ["bed", "chair", "sofa", "sofa", "chair"]
    costs = [options.random for _, options in world.fits]
    assert max(costs[:3]) < min(costs[3:]) / 3
    assert [options for _, options in world.fits[3:]] == [FitOptions()] * 2, "as if it had been named"
    assert chosen.model.name == "chair", "the refined result decides, not the short fit"
    assert chosen.classes == (("chair", 0.93), ("sofa", 0.88), ("bed", 0.4))
    assert chosen.warnings == ()


def test_a_tie_is_said(world):
    world.full["sofa"] = 0.925
    assert "chair and sofa" in world.run().warnings[0]
    assert "--class" in world.run().warnings[0]


def test_the_stages_keys_follow_the_weights(world):
    world.run()
    before = dict(world.keys)
    world.run()
    assert dict(world.keys) == before
    (world.weights / "bed.safetensors").write_text("trained again")
    world.run()
    assert dict(world.keys)["fit"] != before["fit"]


def test_a_class_without_weights_is_left_out(monkeypatch, tmp_path, caplog):
    monkeypatch.setattr(registry, "weights_of", lambda file: tmp_path / file.with_suffix(".safetensors").name)
    with pytest.raises(InputError, match=r"nnproc\.train"):
        class_selection.known_models()
    assert "chair is not tried" in caplog.text


def test_classes_are_listed_best_first():
    first = FirstRound((("sofa", 0.7), ("chair", 0.6), ("bed", 0.5), ("table", 0.45)), (FitResult(()),))
    chosen = class_selection.choose(
        _models("sofa", "chair"), Finals((_refined(0.4), _refined(0.8))), first, AutoOptions()
    )
    assert [name for name, _ in chosen.classes] == ["chair", "bed", "table", "sofa"]


def test_words():
    assert tried((("chair", 0.912), ("table", 0.6))) == "tried 2 classes: chair 0.91, table 0.60"
    assert tried((("chair", 0.9),)) == "tried 1 class: chair 0.90"


def test_the_report_says_what_was_tried(tmp_path, chair):
    named = made_up(tmp_path)
    result = replace(named, classes=(("chair", 0.91234), ("table", 0.6)))
    assert report_content(named, 1.0)["classes"] == []
    assert report_content(result, 1.0)["classes"] == [
        {"class": "chair", "iou": 0.9123},
        {"class": "table", "iou": 0.6},
    ]
    assert "tried 2 classes: chair 0.91, table 0.60" in words(result, asset_of(result, chair)).sentence
    assert "tried" not in words(named, asset_of(named, chair)).sentence


def test_a_chair_is_taken_for_a_chair(chair):
    """The real thing, as short as it can be."""
    models = [m for m in class_selection.known_models() if m.name in ("bed", "chair", "table")]
    assert len(models) == 3
    cameras, place = orbit(5, seed=2)
    shape = {"width": 0.5, "depth": 0.5, "leg_height": 0.4, "legs": "basic", "arms": "basic", "back": "vbar"}
    poses, masks = drawn_scene(chair.build(shape), cameras, place)
    hull = hull_run(poses, masks, place, HullOptions(size=64))
    brief = AutoOptions(random=8, kept=1, finalists=1)
    chosen = class_selection.run(
        lambda name, options, compute: compute(),
        models,
        (poses, masks, place),
        hull,
        FitOptions(size=48, max_views=4, random=24, kept=2),
        RefineOptions(size=48, levels=(Level(2, blur=1),), steps=(2, 2, 2), candidates=1, sweeps=0),
        brief,
    )
    assert chosen.model.name == "chair"
    assert len(chosen.classes) == len(models)
    assert chosen.classes[0][1] > max(iou for _, iou in chosen.classes[1:]) + 0.05


def test_an_answer_moved_to_the_objects_place_is_still_compared_by_its_overlap():
    moved = replace(_refined(0.5), overlap=0.8)
    first = FirstRound((("sofa", 0.6), ("chair", 0.6)), ())
    chosen = class_selection.choose(_models("sofa", "chair"), Finals((moved, _refined(0.7))), first, AutoOptions())
    assert chosen.model.name == "sofa"
    assert chosen.classes[0] == ("sofa", 0.8)
