"""What may be stated: less the more is unexplained, no more than was measured; "not a chair" for what is none."""

from dataclasses import replace

import numpy as np
import pytest

from procmodels.classes import chair
from procmodels.parts.primitives import box
from procmodels.shape import Part, Shape, normalised
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.fitting import beliefs, evidence
from recon.fitting.beliefs import DENIED, DOUBTED, Beliefs
from recon.fitting.evidence import Evidence
from recon.fitting.uncertainty import Certainty, Choice
from recon.geometry.object_windows import object_crops
from recon.geometry.triangles import Triangles

SPACE = chair.SPACE
GOOD = Evidence(0.01, 0.0, 0.0, 0.0, 0.15, 0.5, 0.0, {"arm": 0.0})
CHOICE = Choice(0.9, "none", 0.02, 0.5, 0.0, ("arm",))
WORSE = {"misfit": 0.3, "missing": 0.3, "idle": 0.3, "part": 0.9, "plain": 1.5, "unusual": 4.0, "edge": 0.4}


def shape_of(**changed):
    params = {p.name: p.usual_value() for p in SPACE.parameters} | changed
    params = SPACE.held(SPACE.validate(params))
    return params, normalised(chair.build(params))


def without(shape, word):
    return Shape(tuple(p for p in shape.parts if word not in p.name))


def outlines(shape, seen, params):
    cameras, place = orbit(6, seed=1)
    crops = object_crops(drawn_scene(seen, cameras, place), evidence.WINDOW, evidence.VIEWS)
    return evidence.of_outlines(SPACE, params, shape, crops, place)


def surfaces(shape, seen, params, spacing=0.0):
    triangles = Triangles.of(seen)
    return evidence.of_surfaces(SPACE, params, shape, triangles.at(triangles.places(8000))[0], spacing)


@pytest.fixture(scope="module")
def armchair():
    return shape_of(arms="posts")


@pytest.mark.parametrize("look", [outlines, surfaces])
def test_an_exact_answer_has_nothing_against_it(look, armchair):
    params, shape = armchair
    found = look(shape, shape, params)
    assert found.misfit < 0.02
    assert (found.missing, found.idle, found.part) == pytest.approx((0, 0, 0), abs=0.01)


@pytest.mark.parametrize("look", [outlines, surfaces])
def test_parts_where_nothing_is_seen_count_against_it(look, armchair):
    params, shape = armchair
    found = look(shape, without(shape, "arm"), params)
    assert found.part > 0.5
    assert found.part == max(found.parts[p.name] for p in shape.parts if "arm" in p.name)
    assert max(v for n, v in found.parts.items() if "arm" not in n) < 0.2 * found.part
    assert found.idle > 0.01
    assert found.missing == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("look", [outlines, surfaces])
def test_what_is_seen_without_a_part_counts_against_it(look, armchair):
    params, shape = armchair
    found = look(without(shape, "arm"), shape, params)
    assert found.missing > 0.01
    assert (found.idle, found.part) == pytest.approx((0, 0), abs=0.01)


@pytest.mark.parametrize("look", [outlines, surfaces])
def test_a_box_explained_by_a_chair_is_plain_and_a_chair_is_not(look, armchair):
    """A convex hull explains a box; of a chair it leaves much."""
    params, shape = armchair
    bulk = normalised([box("box", (-0.3, -0.3, 0), (0.3, 0.3, 1))])
    nearest, low = shape_of(base="panel", arms="panel", apron=0.9)
    assert look(low, bulk, nearest).plain == evidence.PLAINEST
    assert look(shape, shape, params).plain < 0.3


def test_what_a_lathe_could_make_is_plain(armchair):
    """A bottle, however well a chair from behind covers it."""
    params, _ = armchair
    rings = [(0.2, 0.0, 0.6), (0.08, 0.6, 0.8), (0.1, 0.8, 1.0)]
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    plan = np.stack([np.cos(around), np.sin(around)], 1)
    parts = []
    for r, low, high in rings:
        ends = [np.column_stack([r * plan, np.full(24, z)]) for z in (low, high)]
        sides = tuple((i, (i + 1) % 24, 24 + (i + 1) % 24, 24 + i) for i in range(24))
        parts.append(
            Part(f"{low}", np.concatenate(ends), (tuple(range(23, -1, -1)), tuple(range(24, 48)), *sides), True)
        )
    bottle = normalised(parts)
    stacked = normalised([box(f"{i}", (-r, -r, low), (r, r, high)) for i, (r, low, high) in enumerate(rings)])
    assert outlines(stacked, bottle, params).plain > 0.9


def test_gaps_of_a_sparse_cloud_say_nothing(armchair):
    params, shape = armchair
    triangles = Triangles.of(shape)
    points = triangles.at(triangles.places(300))[0]
    apart = [evidence.of_surfaces(SPACE, params, shape, points, spacing).misfit for spacing in (0.0, 0.06)]
    assert apart[1] < 0.5 * apart[0]


def test_unusual_values_are_told_from_usual_ones():
    usual, _ = shape_of()
    odd, _ = shape_of(base="fold", back="cross", seat_height=0.88, width=1.6, back_flare=0.35)
    assert evidence.looks(SPACE, usual)[0] < 0.1
    assert evidence.looks(SPACE, odd)[0] > 1
    assert evidence.looks(SPACE, odd)[1] > evidence.looks(SPACE, usual)[1] == 0


def test_what_does_nothing_is_not_unusual():
    here = shape_of(base="pedestal", stretchers="H", splay_rear=25.0)[0]
    there = shape_of(base="pedestal")[0]
    assert evidence.looks(SPACE, here) == evidence.looks(SPACE, there)


@pytest.fixture(params=beliefs.KINDS)
def use(request):
    return beliefs.table(SPACE, request.param)


@pytest.mark.parametrize("what", ["misfit", "missing"])
def test_no_chance_grows_with_what_is_unexplained(use, what):
    worse = [replace(GOOD, **{what: x}) for x in np.linspace(0.005, 0.5, 12)]
    chances = [beliefs.chance("arms", CHOICE, e, use) for e in worse]
    assert all(a >= b - 1e-12 for a, b in zip(chances, chances[1:], strict=False))


def test_a_choices_own_parts_in_the_empty_lower_its_chance(use):
    idle = replace(GOOD, parts={"arm": 0.9})
    assert beliefs.chance("arms", CHOICE, idle, use) <= beliefs.chance("arms", CHOICE, GOOD, use)
    other = replace(GOOD, parts={"arm": 0.0, "leg": 0.9})
    assert beliefs.chance("arms", CHOICE, other, use) == beliefs.chance("arms", CHOICE, GOOD, use)


def test_a_third_unexplained_is_never_98_percent_sure(use):
    lost = replace(GOOD, misfit=0.3, missing=0.3)
    assert beliefs.chance("arms", replace(CHOICE, share=50.0), lost, use) < 0.9


def test_chances_grow_with_the_gap_and_stay_below_the_cap(use):
    capped = replace(use, caps=((0.005, 0.8), (0.1, 0.6), (0.4, 0.3)))
    chances = [beliefs.chance("arms", replace(CHOICE, share=s), GOOD, capped) for s in (0.0, 0.01, 0.1, 1.0, 100.0)]
    assert chances == sorted(chances)
    assert 0.6 < beliefs.cap(0.05, capped) < 0.8
    assert beliefs.cap(1.0, capped) == pytest.approx(0.3)
    assert max(chances) <= beliefs.cap(GOOD.misfit, capped)


@pytest.mark.parametrize("what", WORSE)
def test_no_confidence_grows_with_what_is_wrong(use, what):
    levels = np.linspace(getattr(GOOD, what), WORSE[what], 8)
    sure = [beliefs.confidence(replace(GOOD, **{what: x}), {"arms": 0.9}, use) for x in levels]
    assert all(a >= b - 1e-12 for a, b in zip(sure, sure[1:], strict=False))


def test_a_good_answer_is_believed_and_a_lost_one_denied(use):
    assert beliefs.confidence(GOOD, {"arms": 0.95}, use) >= DOUBTED
    assert beliefs.confidence(replace(GOOD, **WORSE), {"arms": 0.4}, use) < DENIED


def test_doubts_are_said():
    assert not beliefs.words("chair", 0.5, GOOD)
    (maybe,) = beliefs.words("chair", 0.25, GOOD)
    assert "may not be a chair" in maybe
    (denied,) = beliefs.words("armchair", 0.1, replace(GOOD, missing=0.3))
    assert "is not an armchair" in denied
    assert "30%" in denied
    assert "any plain body" in beliefs.words("chair", 0.1, replace(GOOD, plain=1.5))[0]


def test_stated_chances_replace_those_of_exact_outlines(use):
    sure = Certainty({"width": (0.4, 0.5)}, {"arms": CHOICE}, {"width": 0.01}, {"arms": 0.5})
    told = beliefs.stated(sure, replace(GOOD, misfit=0.4, missing=0.4), use)
    assert told.certainty.choices["arms"].chance < CHOICE.chance
    assert told.certainty.intervals == sure.intervals
    assert told.certainty.choices["arms"].rival == "none"
    assert beliefs.stated(None, GOOD, use).certainty is None


def test_a_class_without_a_table_goes_by_the_default(tmp_path):
    from recon.evaluate.beliefs import command, fit

    file = tmp_path / "beliefs.json"
    mine, rest = fit.fitted([], "mesh"), replace(fit.fitted([], "mesh"), objects=7)
    command.write(file, beliefs.DEFAULT, "default", {k: rest for k in beliefs.KINDS})
    command.write(file, SPACE.hash, "chair", {"mesh": mine})
    assert beliefs.table(SPACE, "mesh", file).objects == 0
    assert beliefs.table(SPACE, "image", file).objects == 7
    assert beliefs.table(replace(SPACE, version=99), "mesh", file).objects == 7


def test_the_shipped_table_is_whole():
    for kind in beliefs.KINDS:
        found = beliefs.table(replace(SPACE, version=99), kind)
        assert isinstance(found, Beliefs)
        assert set(found.choices) == {"base", *beliefs.OF_CHOICES}
        assert set(found.answers) == {"base", *beliefs.OF_ANSWERS}
        for weights in (found.choices, found.answers):
            for name, weight in weights.items():
                assert name == "base" or (weight >= 0 if name in beliefs.HELPS else weight <= 0)


def test_a_part_is_a_name_that_may_come_twice():
    part = Part("leg", np.eye(4)[:, :3], ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)), convex=True)
    away = part.moved(np.array([(1, 0, 0, 5.0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)]))
    params, _ = shape_of()
    found = evidence.of_surfaces(SPACE, params, Shape((part, away)), part.vertices.repeat(3, 0))
    assert found.parts["leg"] == pytest.approx(1.0)
