"""Which model a name means: a class without a network of its own goes on to be the paper's."""

import pytest

import procmodels
from procmodels import registry

BOTH = sorted({f.stem for f in (registry.HERE / "classes").glob("*.py")} & set(procmodels.paper_names()))


@pytest.mark.parametrize("name", BOTH)
def test_a_class_without_weights_is_the_papers(name, monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "weights_of", lambda file: tmp_path / file.parent.name / f"{file.stem}.safetensors")
    paper, rich = procmodels.load(f"paper/{name}"), procmodels.load(f"{registry.HERE}/classes/{name}.py")
    assert rich.space.hash != paper.space.hash
    assert procmodels.load(name).space.hash == paper.space.hash
    (tmp_path / "classes").mkdir()
    (tmp_path / "classes" / f"{name}.safetensors").touch()
    assert procmodels.load(name).space.hash == rich.space.hash
    assert procmodels.load(f"paper/{name}").space.hash == paper.space.hash
    assert procmodels.names().count(name) == 1


def test_there_are_classes_of_both_kinds():
    assert {"bed", "chair", "sofa"} <= set(BOTH)
