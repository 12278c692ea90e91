"""params.json is what its schema in docs/ says, for every class; and a file that is not is told apart."""

import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import procmodels
from recon.outputs import write
from tests.made_up import made_up

SCHEMA = json.loads((Path(__file__).parents[2] / "docs" / "params.schema.json").read_text())
CLASSES = [*procmodels.names(), *(f"paper/{n}" for n in procmodels.paper_names() if n != "sofa")]


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return made_up(tmp_path_factory.mktemp("photos"))


def content(result, name, height, seed=0):
    model = procmodels.load(name)
    params = model.space.sample(np.random.default_rng(seed))
    told = replace(result, class_name=name, params=params, height_m=height)
    return json.loads(json.dumps(write.params_content(told, write.asset_of(told, model)), allow_nan=False))


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("height", [0.9, None])
def test_what_is_written_fits(result, name, height):
    made = content(result, name, height)
    jsonschema.validate(made, SCHEMA)
    assert set(made) == set(SCHEMA["properties"]), "the schema knows every entry"


def test_what_build_needs_is_enough():
    jsonschema.validate({"class": "chair", "values": {"width": 0.5, "legs": "round", "filled": True}}, SCHEMA)


@pytest.mark.parametrize(
    "change",
    [
        {"values": {"width": [1]}},
        {"class": 3},
        {"height_metres": -1},
        {"obj_up": "x"},
        {"world_from_canonical": [[1, 0], [0, 1]]},
        {"hieght_metres": 1.0},
    ],
)
def test_what_does_not_fit(result, change):
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content(result, "paper/chair", 0.9) | change, SCHEMA)
