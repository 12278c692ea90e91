"""Which class a name means: the paper's until a richer one has a network."""

import pytest

import procmodels
from procmodels import registry


@pytest.mark.parametrize("name", ["shelf", "table"])
def test_a_name_means_the_richer_class_once_that_has_weights(name, tmp_path, monkeypatch):
    rich = procmodels.load(f"procmodels/classes/{name}.py").space
    paper = procmodels.load(f"paper/{name}").space
    assert rich.hash != paper.hash
    monkeypatch.setattr(registry, "weights_of", lambda file: tmp_path / f"{file.stem}.safetensors")
    assert procmodels.load(name).space == paper
    assert procmodels.names().count(name) == 1
    (tmp_path / f"{name}.safetensors").touch()
    assert procmodels.load(name).space == rich
    assert procmodels.names().count(name) == 1
    assert procmodels.load(f"paper/{name}").space == paper
