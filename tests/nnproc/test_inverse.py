"""The inverse half alone: mixed batches, a training that learns and resumes, weights and card, pieces of a training."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from datasets.synthetic import SyntheticOptions, generate, read
from nnproc import accuracy, inverse
from nnproc.accuracy import KINDS, reading
from nnproc.infer import load_network, params_from_grids
from nnproc.inverse import InverseOptions, InverseTrainer, main, train, training_set
from nnproc.network import NetworkConfig, NNProc, cells_from_grid
from procmodels import load

BENCH = """
from procmodels.conditions import when
from procmodels.parts.primitives import box
from procmodels.space import Choice, ParamSpace, Scalar
SPACE = ParamSpace("bench", (
    Scalar("height", 0.2, 1.0, 99),
    Choice("back", ("none", "board")),
    Scalar("back_height", 0.2, 1.0, 99, only_if=when("back").is_("board")),
))


def build(params):
    top = params["height"]
    parts = [box("block", (-0.5, -0.2, 0), (0.5, 0.2, top))]
    if params["back"] == "board":
        parts.append(box("back", (-0.5, 0.15, top), (0.5, 0.2, top + params["back_height"])))
    return parts
"""
NARROW = NetworkConfig(layers="patch", latent=32, hidden=64)
TINY = InverseOptions(steps=6, batch=8, network=NARROW, checkpoint_every=2)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    path = tmp_path_factory.mktemp("bench") / "bench.py"
    path.write_text(BENCH)
    return load(str(path))


@pytest.fixture(scope="module")
def name(bench):
    return str(bench.weights.with_suffix(".py"))


@pytest.fixture(scope="module")
def data(tmp_path_factory, bench):
    out = tmp_path_factory.mktemp("pairs")
    options = SyntheticOptions(train_on=0, train_off=48, test_on=0, test_off=8, train_hull=32, test_hull=8)
    generate(bench, out, options)
    return out


def test_batches_show_all_kinds_in_their_shares_and_depend_on_the_step_alone(data, bench, monkeypatch):
    store, seen = training_set(data, bench.space.hash), Counter()

    def counted(kind):
        def disturb(grid, rng):
            seen[kind] += 1
            return grid

        return disturb

    cells, vectors = store.batch(3, TINY)
    again = store.batch(3, TINY)
    assert torch.equal(cells, again[0])
    assert torch.equal(vectors, again[1])
    assert not torch.equal(cells, store.batch(4, TINY)[0])
    assert cells.shape == (8, 64, 16, 16, 16)
    assert cells.is_contiguous(memory_format=torch.channels_last_3d)

    for kind in KINDS:
        monkeypatch.setitem(KINDS, kind, counted(kind))
    for step in range(40):
        store.batch(step, TINY)
    assert [seen[k] / 320 for k in KINDS] == pytest.approx(TINY.mix, abs=0.08)
    alone = replace(TINY, mix=(1.0, 0.0, 0.0, 0.0))
    cells, vectors = store.batch(0, alone)
    own = {v.tobytes(): g for v, g in zip(store.clean.vectors, store.clean.grids(), strict=True)}
    grids = torch.from_numpy(np.stack([own[v.numpy().tobytes()] for v in vectors]))
    assert torch.equal(cells.bool(), cells_from_grid(grids)), "clean shapes with their own vectors"


def test_it_learns(data, bench, name, tmp_path):
    options = replace(TINY, steps=60, checkpoint_every=60, learning_rate=2e-3)
    store = training_set(data, bench.space.hash)
    probe = [store.batch(1000 + i, options) for i in range(4)]

    def loss(network):
        with torch.no_grad():
            scores = [network.score_params(network.encode_cells(c.float())[0]) for c, _ in probe]
        return float(torch.cat([network.codec.loss(s, v) for s, (_, v) in zip(scores, probe, strict=True)]).mean())

    before = loss(InverseTrainer(name, tmp_path / "new", options).network)
    trainer = train(name, data, tmp_path / "work", options)
    assert trainer.step == 60
    assert loss(trainer.network) < 0.5 * before
    untouched = InverseTrainer(name, tmp_path / "new", options).network.state_dict()
    for key, value in trainer.network.state_dict().items():
        if key.startswith(("shape_decoder", "param_encoder")):
            assert torch.equal(value, untouched[key]), "the forward half does not move"


def test_a_training_that_was_stopped_ends_as_one_that_was_not(data, name, tmp_path, monkeypatch):
    train(name, data, tmp_path / "straight", TINY)
    straight = load_file(tmp_path / "straight" / "checkpoint.safetensors")
    save = InverseTrainer.save

    def die(self):
        save(self)
        if self.step == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(InverseTrainer, "save", die)
        with pytest.raises(KeyboardInterrupt):
            train(name, data, tmp_path / "stopped", TINY)
    train(name, data, tmp_path / "stopped", TINY)
    resumed = load_file(tmp_path / "stopped" / "checkpoint.safetensors")
    assert set(resumed) == set(straight)
    for key, value in straight.items():
        assert torch.allclose(value, resumed[key], atol=2e-4, rtol=1e-2), key
    with pytest.raises(ValueError, match="other options"):
        train(name, data, tmp_path / "stopped", replace(TINY, seed=5))


def _command(name, data, work, *more):
    flags = ["--steps", "2", "--batch", "4", "--layers", "patch", "--hidden", "32"]
    return main([name, "--data", str(data), "--work", str(work), *flags, *more])


def test_weights_their_card_and_going_on(data, bench, name, tmp_path):
    first, second = tmp_path / "first.safetensors", tmp_path / "second.safetensors"
    assert _command(name, data, tmp_path / "a", "--out", str(first)) == 0
    network = load_network(bench.space, first)
    assert not network.has_decoder
    grids = read(data, "test_hull", bench.space.hash).grids()
    assert len([bench.build(p) for p in params_from_grids(network, grids)]) == 8
    card = json.loads(first.with_suffix(".json").read_text())
    assert card["halves"].startswith("inverse")
    assert set(card["held_out"]) == set(KINDS)
    for row in card["held_out"].values():
        assert 0 <= row["choices_right_percent"] <= 100
        assert 0 < row["scalar_error_percent"] < 100
        assert set(row["by_parameter"]) <= set(bench.space.by_name)
    assert card["data"] if "data" in card else card["trainings"][0]["data"]["shapes"]

    assert _command(name, data, tmp_path / "b", "--out", str(second), "--start", str(first)) == 0
    trainings = json.loads(second.with_suffix(".json").read_text())["trainings"]
    assert len(trainings) == 2
    assert trainings[0] == card["trainings"][0]
    begun = InverseTrainer(name, tmp_path / "c", replace(TINY, network=network.config), first).network
    for key, value in load_file(first).items():
        assert torch.equal(begun.state_dict()[key], value.float())


def test_what_cannot_be_gone_on_from_is_said(data, name, bench, tmp_path, capsys):
    weights = tmp_path / "bench.safetensors"
    assert _command(name, data, tmp_path / "a", "--out", str(weights)) == 0
    with pytest.raises(ValueError, match="hidden=48"):
        InverseTrainer(name, tmp_path, replace(TINY, network=replace(NARROW, hidden=48)), weights)
    assert _command(name, data, tmp_path / "b", "--start", str(tmp_path / "none")) == 2
    assert "none" in capsys.readouterr().err


def test_data_without_hulls_are_refused(bench, name, tmp_path):
    generate(bench, tmp_path / "data", SyntheticOptions(train_on=0, train_off=2, test_on=0, test_off=0))
    with pytest.raises(ValueError, match="train_hull"):
        train(name, tmp_path / "data", tmp_path / "work", TINY)
    with pytest.raises(ValueError, match=r"datasets\.synthetic"):
        train(name, tmp_path / "nothing", tmp_path / "work", TINY)


def test_accuracy_counts_what_is_active(bench):
    network = NNProc(bench.space, NARROW)
    params = [
        {"height": 0.6, "back": "none", "back_height": 0.6},
        {"height": 0.6, "back": "board", "back_height": 0.4},
    ]
    truth = network.codec.vectors(params)
    right = reading(network, truth, truth)
    assert (right["choices_right_percent"], right["scalar_error_percent"]) == (100, 0)
    values = truth.clone()
    values[0, bench.space.slices["back"]] = torch.tensor([0.4, 0.6])
    values[0, bench.space.slices["back_height"]] = 1.0  # inactive in the truth
    values[1, bench.space.slices["back_height"]] = 0.55  # 0.25 is true
    found = reading(network, values, truth)
    assert found["choices_right_percent"] == 50
    assert found["scalar_error_percent"] == pytest.approx(10)  # 0, 0 and 30
    assert found["by_parameter"] == pytest.approx({"height": 0, "back": 50, "back_height": 30})


def test_held_out_shapes_are_disturbed_alike_every_time(data, bench, monkeypatch):
    network = NNProc(bench.space, NARROW).eval()
    seen = []
    monkeypatch.setattr(accuracy, "values_from_grids", lambda n, g: seen.append(g) or torch.rand(len(g), n.codec.width))
    sets = [read(data, w, bench.space.hash) for w in ("test_off", "test_hull")]
    for _ in range(2):
        accuracy.accuracy(network, *sets)
    assert len(seen) == 2 * len(KINDS)
    for a, b in zip(seen[: len(KINDS)], seen[len(KINDS) :], strict=True):
        assert (a == b).all()
    assert (seen[0] == sets[0].grids()).all()
    assert inverse.KINDS is KINDS
