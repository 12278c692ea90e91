"""Labels are in the words of their class, and say of every object what can be said; broken ones are told."""

import json

import numpy as np
import pytest

from datasets import part_labels
from datasets.catalogue_object import DataError
from procmodels.classes import chair

LABELS = part_labels.parts("chair")
OTHERS = part_labels.others("chair")


def test_every_name_and_value_is_of_the_rich_chair():
    assert len(part_labels.fitting(LABELS, chair.SPACE)) >= 100


def test_there_are_enough_labels_to_measure_by():
    told = [choice for seen in LABELS.values() for choice, values in seen.items() if values is not None]
    assert len(told) >= 300
    assert {p.name for p in chair.SPACE.discrete} == set(told)


@pytest.mark.parametrize("name", sorted(LABELS))
def test_what_is_labelled_does_something_beside_the_other_labels(name):
    seen = LABELS[name]
    known = {p.name: p.values for p in chair.SPACE.discrete if hasattr(p, "values")}
    for choice, values in seen.items():
        condition = chair.SPACE.by_name[choice].only_if
        if condition is None or values is None:
            continue
        for asked in condition.comparisons():
            possible = seen.get(asked.name) or known.get(asked.name, (False, True))
            assert any(asked.allows(v) for v in possible), f"{choice} does nothing where {asked.name} is {possible}"


def test_no_object_is_both_a_chair_and_none():
    assert not set(LABELS) & set(OTHERS)
    assert len(OTHERS) >= 200
    assert {"fridge", "car", "plant", "lamp", "wheelchair", "table", "bed", "person"} <= set(OTHERS.values())


def test_objects_are_found_by_the_names_that_labels_have(tmp_path, box_file):
    folder = tmp_path / "things"
    box_file(folder / "fridge" / "cold.ply")
    found = part_labels.objects([folder])
    assert list(found) == ["things/fridge/cold"]
    assert np.isclose(found["things/fridge/cold"].load().extents.max(), 1)


@pytest.fixture
def box_file():
    import trimesh

    def write(path):
        path.parent.mkdir(parents=True)
        trimesh.creation.box((1, 2, 3)).export(path)

    return write


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("[", "not readable as JSON"),
        ("[]", "expected"),
        ('{"objects": {"a/b": "panel"}}', "a/b needs its choices"),
        ('{"objects": {"a/b": {"back": []}}}', "a value, a list of values or null"),
        ('{"objects": {"a/b": {"back": {"is": "panel"}}}}', "a value, a list of values or null"),
    ],
)
def test_a_broken_table_is_told_with_its_file(tmp_path, content, said):
    (tmp_path / "chair.json").write_text(content)
    with pytest.raises(DataError, match=said) as error:
        part_labels.parts("chair", tmp_path)
    assert "chair.json" in str(error.value)


@pytest.mark.parametrize(("choice", "value"), [("roof", "flat"), ("back", "thatched"), ("back_bars", 99)])
def test_words_that_the_class_does_not_have_are_told(tmp_path, choice, value):
    (tmp_path / "chair.json").write_text(json.dumps({"objects": {"a/b": {choice: value}}}))
    labels = part_labels.parts("chair", tmp_path)
    with pytest.raises(DataError, match=str(value) if choice != "roof" else choice):
        part_labels.fitting(labels, chair.SPACE)


def test_an_unknown_class_or_source_is_told(tmp_path):
    with pytest.raises(DataError, match="no labels of this class"):
        part_labels.parts("teapot")
    with pytest.raises(DataError, match="neither"):
        part_labels.objects([tmp_path / "nowhere"])
