"""Bad parameters, data and weights are refused for every class, in words that say what is allowed."""

import json

import pytest

import procmodels
from datasets.synthetic import main as synthetic_main
from datasets.synthetic import read
from nnproc.infer import WeightsError, load_network, save_network
from nnproc.network import NNProc
from procmodels.space import Choice, Flag, Integer, ParameterError, Scalar

NAMES = procmodels.names()


@pytest.fixture(params=NAMES)
def model(request):
    return procmodels.load(request.param)


def _out_of_range(parameter):
    if isinstance(parameter, Scalar):
        width = parameter.high - parameter.low
        return [parameter.low - 0.01 * width, parameter.high + 0.01 * width, float("nan"), float("inf")]
    if isinstance(parameter, Integer):
        return [parameter.low - 1, parameter.high + 1]
    return ["wheels", ""] if isinstance(parameter, Choice) else []


def _of_the_wrong_kind(parameter):
    if isinstance(parameter, Scalar):
        return ["0.5", None, True, [0.5]]
    if isinstance(parameter, Integer):
        return [1.5, "1", None, True]
    return [0, None, "true"] if isinstance(parameter, Flag) else [0, None, True]


def test_the_five_classes_are_there():
    assert {"bed", "chair", "shelf", "sofa", "table"} <= set(NAMES)


def test_each_bad_value_is_named_with_its_range(model, rng):
    good = model.space.sample(rng)
    for parameter in model.space.parameters:
        for bad in [*_out_of_range(parameter), *_of_the_wrong_kind(parameter)]:
            with pytest.raises(ParameterError) as error:
                model.build({**good, parameter.name: bad})
            text = str(error.value)
            assert model.name in text
            assert f"{parameter.name} = {bad!r}" in text
            assert parameter.describe() in text


def test_each_missing_value_is_named_with_its_range(model, rng):
    good = model.space.sample(rng)
    for parameter in model.space.parameters:
        rest = {k: v for k, v in good.items() if k != parameter.name}
        with pytest.raises(ParameterError, match=f"{parameter.name}: missing") as error:
            model.build(rest)
        assert parameter.describe() in str(error.value)


def test_an_unknown_value_is_named_with_the_known_ones(model, rng):
    with pytest.raises(ParameterError, match="colour: unknown") as error:
        model.build({**model.space.sample(rng), "colour": "red"})
    assert all(p.name in str(error.value) for p in model.space.parameters)


def test_all_faults_are_told_at_once(model):
    with pytest.raises(ParameterError) as error:
        model.build({"colour": "red"})
    assert str(error.value).count("missing") == len(model.space.parameters)


def test_the_ends_of_every_range_are_allowed(model, rng):
    good = model.space.sample(rng)
    for parameter in model.space.parameters:
        for index in (0, parameter.grid_steps - 1):
            model.space.validate({**good, parameter.name: parameter.grid_value(index)})


def test_a_shard_cut_short_is_found_and_made_again(tmp_path, chair):
    command = ["paper/chair", "--out", str(tmp_path), "--train-on", "4", "--train-off", "3", "--test-on", "2"]
    command += ["--test-off", "2"]
    assert synthetic_main(command) == 0
    before = read(tmp_path, "train_on", chair.space.hash)
    shard, other = tmp_path / "train_on_000000.npz", tmp_path / "train_off_000000.npz"
    whole, untouched = shard.read_bytes(), other.stat().st_mtime_ns
    shard.write_bytes(whole[: len(whole) // 3])
    with pytest.raises(ValueError, match=r"train_on_000000.*damaged"):
        read(tmp_path, "train_on", chair.space.hash)
    assert synthetic_main(command) == 0
    again = read(tmp_path, "train_on", chair.space.hash)
    assert (again.vectors == before.vectors).all()
    assert (again.bits == before.bits).all()
    assert other.stat().st_mtime_ns == untouched, "a whole shard is kept"
    assert json.loads((tmp_path / "manifest.json").read_text())["shards"]["train_on_000000.npz"][0] == 4


def test_weights_of_another_class_are_refused(tmp_path, chair):
    path = tmp_path / "weights.safetensors"
    save_network(path, NNProc(chair.space))
    load_network(chair.space, path)
    for name in NAMES:
        space = procmodels.load(name).space
        if space.hash == chair.space.hash:
            continue
        with pytest.raises(WeightsError, match="trained for chair") as error:
            load_network(space, path)
        assert all(part in str(error.value) for part in (name, space.hash, chair.space.hash, "retrain"))
