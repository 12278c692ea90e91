"""Generated data and training: resumable, seeded, checked."""

import json
import shutil

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from datasets.synthetic import SyntheticOptions, generate, read, shape_params
from datasets.synthetic import main as synthetic_main
from nnproc import finetune
from nnproc.finetune import FinishOptions, finish_half, merge
from nnproc.infer import load_network, save_network
from nnproc.network import NetworkConfig
from nnproc.train import TrainOptions, learning_rate, train, write_card

TINY = SyntheticOptions(train_on=12, train_off=6, test_on=4, test_off=4)


@pytest.fixture(scope="module")
def data(tmp_path_factory, chair):
    out = tmp_path_factory.mktemp("pairs")
    generate(chair, out, TINY)
    return out


def test_pairs_are_what_their_parameters_build(data, chair):
    from datasets.voxels import surface_grid

    pairs = read(data, "train_off", chair.space.hash)
    assert len(pairs) == 6
    params = chair.space.decode(pairs.vectors[3])
    shape = chair.build(params)
    assert (surface_grid(shape.vertices(), shape.triangles()) ^ pairs.grids()[3]).mean() < 1e-4


def test_training_and_held_out_shapes_never_meet(chair):
    options = SyntheticOptions()
    train_on = {tuple(shape_params(chair, "train_on", i, options).items()) for i in range(0, 3000, 7)}
    test_on = {tuple(shape_params(chair, "test_on", i, options).items()) for i in range(300)}
    assert len(test_on) == 300
    assert not train_on & test_on


def test_a_damaged_shard_is_named_and_made_again(data, chair):
    path = data / "test_on_000000.npz"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="test_on_000000"):
        read(data, "test_on", chair.space.hash)
    generate(chair, data, TINY)
    assert len(read(data, "test_on", chair.space.hash)) == 4


def test_data_of_another_space_is_refused(data, chair, tmp_path):
    with pytest.raises(ValueError, match="f00"):
        read(data, "test_on", "f00")
    with pytest.raises(ValueError, match="synthetic"):
        read(tmp_path, "test_on", chair.space.hash)


def test_the_command_explains_bad_input(tmp_path, capsys):
    assert synthetic_main(["throne", "--out", str(tmp_path)]) == 2
    assert "paper/chair" in capsys.readouterr().err
    assert synthetic_main(["paper/chair", "--out", str(tmp_path), "--train-on", "9999"]) == 2
    assert "5760" in capsys.readouterr().err


def test_training_stopped_and_resumed_is_training_unstopped(data, tmp_path):
    options = TrainOptions(steps=4, batch=4, checkpoint_every=2)
    straight = train("paper/chair", data, tmp_path / "a", options).network.state_dict()
    # A run that dies after its first checkpoint: the checkpoint of step 2 is all that is left.
    calls = []

    def die(*_):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        from nnproc.train import Trainer

        save = Trainer.save
        patch.setattr(Trainer, "save", lambda self: (die(), save(self)))
        with pytest.raises(KeyboardInterrupt):
            train("paper/chair", data, tmp_path / "b", options)
    resumed = train("paper/chair", data, tmp_path / "b", options).network.state_dict()
    for name, value in straight.items():
        assert torch.allclose(value, resumed[name], atol=2e-4), name


def test_a_checkpoint_of_other_options_is_refused(data, tmp_path):
    train("paper/chair", data, tmp_path, TrainOptions(steps=1, batch=4))
    with pytest.raises(ValueError, match="other options"):
        train("paper/chair", data, tmp_path, TrainOptions(steps=1, batch=4, seed=5))


@pytest.fixture(scope="module")
def started(data, tmp_path_factory):
    """Weights after two joint steps, with their card."""
    out = tmp_path_factory.mktemp("started")
    options = TrainOptions(steps=2, batch=4, network=NetworkConfig(layers="product", octaves=2))
    trainer = train("paper/chair", data, out / "work", options)
    save_network(out / "chair.safetensors", trainer.network)
    write_card(trainer, data, out / "chair.json", "as tested")
    return out / "chair.safetensors"


@pytest.mark.parametrize("half", ["decode", "encode"])
def test_a_half_trains_its_own_part_and_goes_on_from_its_save(half, data, started, chair, tmp_path, monkeypatch):
    options = FinishOptions(decode_steps=4, encode_steps=4, batch=4, save_every=2)
    finish_half("paper/chair", half, data, tmp_path / "straight", options, started)
    straight = load_file(tmp_path / "straight" / f"{half}.safetensors")
    own = {"decode": {"param_encoder", "shape_decoder"}, "encode": {"shape_encoder", "param_decoder"}}[half]
    assert {k.split(".")[1] for k in straight if k.startswith("net.")} == own
    before = load_network(chair.space, started).state_dict()
    assert any((straight[f"net.{k}"] != v).any() for k, v in before.items() if f"net.{k}" in straight)

    save = finetune._save

    def die(path, trained, optimiser, step, *rest):
        if step == 4:
            raise KeyboardInterrupt
        save(path, trained, optimiser, step, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(finetune, "_save", die)
        with pytest.raises(KeyboardInterrupt):
            finish_half("paper/chair", half, data, tmp_path / "stopped", options, started)
    finish_half("paper/chair", half, data, tmp_path / "stopped", options, started)
    resumed = load_file(tmp_path / "stopped" / f"{half}.safetensors")
    for name, value in straight.items():
        assert torch.allclose(value, resumed[name], atol=2e-4, rtol=1e-2), name


def test_halves_merge_once(data, started, chair, tmp_path):
    path = tmp_path / "chair.safetensors"
    for suffix in (".safetensors", ".json"):
        shutil.copy(started.with_suffix(suffix), path.with_suffix(suffix))
    options = FinishOptions(decode_steps=1, encode_steps=1, batch=4)
    for half in ("decode", "encode"):
        finish_half("paper/chair", half, data, tmp_path / "work", options, path)
    merge("paper/chair", data, tmp_path / "work", options, path)
    merged, card = path.read_bytes(), path.with_suffix(".json").read_text()
    assert load_network(chair.space, path).config.layers == "product"
    assert len(json.loads(card)["finish"]) == 1
    merge("paper/chair", data, tmp_path / "work", options, path)
    assert (path.read_bytes(), path.with_suffix(".json").read_text()) == (merged, card)


def test_the_schedule_rises_then_falls():
    options = TrainOptions(steps=100)
    rates = np.array([learning_rate(i, options) for i in range(100)])
    assert rates.argmax() == pytest.approx(4, abs=1)
    assert (np.diff(rates[5:]) < 0).all()
    assert rates[-1] < rates.max() / 50


def test_the_manifest_holds_checksums(data):
    manifest = json.loads((data / "manifest.json").read_text())
    assert all(len(digest) == 16 for _, digest in manifest["shards"].values())
