"""Conditions: what they say, when they hold, what they hold still, and spaces that they make impossible."""

import itertools

import numpy as np
import pytest
import torch

from procmodels.conditions import when
from procmodels.space import Choice, Flag, Geometric, Integer, ParamSpace, Scalar

BACK = when("back").among("hbars", "vbars")
PARAMETERS = (
    # Asked about before the parameter that it depends on: the order in the vector is the people's.
    Integer("bars", 1, 4, only_if=BACK, usual=(1, 4, 2, 1), about="bars in the back", group="back"),
    Choice("back", ("none", "panel", "hbars", "vbars"), usual=(1, 6, 2, 1)),
    Geometric("bar_width", 0.01, 0.1, only_if=when("bars").above(1), usual=(0.02, 0.01)),
    Scalar("cushion", 0.0, 0.2, usual=(0.05, 0.05)),
    Flag("buttons", only_if=when("cushion").above(0.1) | when("back").is_("panel"), usual=0.7),
    Scalar("rake", 0.0, 30.0, only_if=when("back").not_("none") & when("cushion").below(0.15), usual=(8.0, 4.0)),
    Flag("piping", only_if=when("buttons").is_(True)),
)
SPACE = ParamSpace("seat", PARAMETERS)


def _expected(v):
    """Which parameters do something, written out."""
    on = {"back", "cushion"}
    bars = v["back"] in ("hbars", "vbars")
    buttons = v["cushion"] > 0.1 or v["back"] == "panel"
    on |= {"bars"} if bars else set()
    on |= {"bar_width"} if bars and v["bars"] > 1 else set()
    on |= {"buttons"} if buttons else set()
    on |= {"rake"} if v["back"] != "none" and v["cushion"] < 0.15 else set()
    return on | ({"piping"} if buttons and v["buttons"] else set())


def _all_values():
    for back, bars, cushion, buttons in itertools.product(
        ("none", "panel", "hbars", "vbars"), (1, 3), (0.02, 0.12, 0.18), (False, True)
    ):
        yield {
            "bars": bars,
            "back": back,
            "bar_width": 0.04,
            "cushion": cushion,
            "buttons": buttons,
            "rake": 20.0,
            "piping": True,
        }


def test_what_is_active_follows_the_values():
    for values in _all_values():
        assert SPACE.active(values) == _expected(values), values


def test_inactive_ones_are_held_at_what_is_usual():
    usual = {
        "bars": 2,
        "back": "panel",
        "bar_width": 0.02,
        "cushion": 0.05,
        "buttons": True,
        "rake": 8.0,
        "piping": False,
    }
    assert SPACE.usual == usual
    for values in _all_values():
        held, active = SPACE.held(values), _expected(values)
        assert list(held) == [p.name for p in PARAMETERS]
        assert held == {n: values[n] if n in active else usual[n] for n in held}
        assert SPACE.active(held) == active, "holding changes nothing that is asked about"
        assert SPACE.held(held) == held


def test_vectors_say_the_same_in_numpy_and_torch():
    values = list(_all_values())
    raw = np.stack([np.concatenate([p.encode(v[p.name]) for p in PARAMETERS]) for v in values]).astype(np.float32)
    masks = SPACE.active_in(raw)
    assert masks.dtype == bool
    assert masks.shape == (len(values), SPACE.width) == (len(values), 13)
    assert (SPACE.active_in(torch.from_numpy(raw)).numpy() == masks).all()
    for v, mask in zip(values, masks, strict=True):
        assert (mask == SPACE.active_slots(v)).all()
        assert {n for n, s in SPACE.slices.items() if mask[s].all()} == _expected(v)
        assert {n for n, s in SPACE.slices.items() if mask[s].any()} == _expected(v)


def test_samples_and_decoded_vectors_come_out_held(rng):
    for i in range(200):
        params = SPACE.sample(rng, on_grid=bool(i % 2))
        assert SPACE.held(params) == SPACE.validate(params) == params
        noise = rng.random(SPACE.width)
        assert SPACE.held(SPACE.decode(noise)) == SPACE.decode(noise)


def test_values_that_build_one_shape_have_one_vector():
    for values in _all_values():
        assert (SPACE.encode(values) == SPACE.encode(SPACE.held(values))).all()
        other = {**values, "bars": 4, "bar_width": 0.09}
        if values["back"] in ("none", "panel"):
            assert (SPACE.encode(values) == SPACE.encode(other)).all()


def test_a_condition_reads_as_a_sentence():
    said = {p.name: str(p.only_if) for p in PARAMETERS if p.only_if}
    assert said == {
        "bars": "back is hbars or vbars",
        "bar_width": "bars is above 1",
        "buttons": "cushion is above 0.1 or back is panel",
        "rake": "back is not none and cushion is below 0.15",
        "piping": "buttons is yes",
    }
    assert str((BACK | when("a").is_(1)) & when("b").not_(2, 3)) == (
        "(back is hbars or vbars or a is 1) and b is not 2 or 3"
    )


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ((Flag("a", only_if=when("b").is_(True)),), "a depends on b, which is no parameter"),
        (
            (Flag("a", only_if=when("b").is_(True)), Flag("b", only_if=when("a").is_(True))),
            "depend on each other: a, b",
        ),
        ((Choice("a", ("x", "y")), Flag("b", only_if=when("a").is_("z"))), "a is z, but a is one of x, y"),
        ((Choice("a", ("x", "y")), Flag("b", only_if=when("a").above(1))), "a is one of x, y"),
        ((Scalar("a", 0, 1), Flag("b", only_if=when("a").is_(1))), "a is a number: compare it"),
        ((Integer("a", 0, 3), Flag("b", only_if=when("a").among(4))), "a is a whole number from 0 to 3"),
        ((Flag("a"), Flag("b", only_if=when("a").is_("yes"))), "a is true or false"),
    ],
)
def test_impossible_conditions_are_refused(parameters, message):
    with pytest.raises(ValueError, match=message):
        ParamSpace("odd", parameters)


def test_conditions_and_the_prior_enter_the_hash_and_words_do_not():
    def changed(**fields):
        flag = Flag("b", **fields)
        return ParamSpace("s", (Scalar("a", 0.0, 1.0), flag)).hash

    plain = changed()
    assert changed(about="what it does", group="back") == plain
    conditions = [changed(only_if=when("a").above(0.5)), changed(only_if=when("a").below(0.5))]
    assert len({plain, *conditions, changed(usual=0.2), changed(usual=0.3)}) == 5
