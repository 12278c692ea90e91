"""The gather keeps rows as they come and goes on; the fit finds what is there, and states no more than it found."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from procmodels import load
from recon.evaluate.beliefs import command, fit, gather, rows
from recon.evaluate.beliefs.rows import BeliefRow, Told
from recon.fitting import beliefs
from recon.fitting.beliefs import DENIED, DOUBTED
from recon.fitting.evidence import Evidence
from recon.fitting.uncertainty import Choice
from recon.scene import InputError


def made_up(rng, i, belongs):
    """An object whose choices are right the less often the more is unexplained, and others that fit worse."""
    misfit = float(np.exp(rng.normal(-4.2 if belongs else -2.8, 0.4)))
    off = 0.02 if belongs else 0.2
    share = float(np.exp(rng.uniform(-5, 1)))
    odds = 0.8 * np.log(share) - 1.0 * np.log(misfit) - 2
    right = bool(rng.random() < 1 / (1 + np.exp(-odds)))
    found = Evidence(misfit, abs(rng.normal(0, off)), abs(rng.normal(0, off)), 0.1, 0.4, 0.5, 0.0)
    told = Told(Choice(0.5, "none", 0.01, share), "posts", right if belongs else None)
    return BeliefRow(f"a/{i}", "chair" if belongs else "car", "mesh", belongs, found, {"arms": told}, (), 1.0)


@pytest.fixture(scope="module")
def many():
    rng = np.random.default_rng(0)
    return [made_up(rng, i, i % 2 == 0) for i in range(600)]


def test_stated_chances_are_as_often_right(many):
    stated = [(c["arms"], r.choices["arms"].right) for r, c, _ in fit.checked(many) if r.belongs]
    stated.sort()
    for part in np.array_split(np.array(stated, float), 4):
        assert part[:, 0].mean() == pytest.approx(part[:, 1].mean(), abs=0.12)


def test_others_are_denied_and_the_class_is_kept(many):
    sure = [(s, r.belongs) for r, _, s in fit.checked(many)]
    assert np.mean([s < DENIED for s, belongs in sure if not belongs]) > 0.9
    assert np.mean([s >= DOUBTED for s, belongs in sure if belongs]) > 0.85


def test_caps_never_grow_with_the_misfit(many):
    caps = fit.fitted(many, "mesh").caps
    assert len(caps) == fit.BINS + 1
    assert [m for m, _ in caps] == sorted(m for m, _ in caps)
    assert [c for _, c in caps] == sorted((c for _, c in caps), reverse=True)


def test_few_objects_stay_near_what_was_thought_before(many):
    few, none = fit.fitted(many[:4], "mesh"), fit.fitted([], "mesh")
    assert few.choices["share"] == pytest.approx(none.choices["share"], abs=0.3)
    assert none.choices["share"] == fit.CHOICES["share"][0]


def test_own_shapes_alone_teach_no_chances(many):
    own = [replace(r, name=f"own/{i}") if r.belongs else r for i, r in enumerate(many[:200])]
    use, none = fit.fitted(own, "mesh"), fit.fitted([], "mesh")
    assert use.choices == none.choices
    assert use.caps == none.caps
    assert use.answers != none.answers


def test_wrong_signs_are_not_learnt():
    """Better fits that are wrong more often are chance; they must not make bad fits surer."""
    rng = np.random.default_rng(1)
    upside_down = []
    for i in range(200):
        row = made_up(rng, i, i % 2 == 0)
        told = replace(row.choices["arms"], right=bool(row.evidence.misfit > 0.015))
        upside_down.append(replace(row, choices={"arms": told}))
    use = fit.fitted(upside_down, "mesh")
    assert use.choices["misfit"] <= 0
    assert all(w <= 0 for n, w in use.answers.items() if n not in (*beliefs.HELPS, "base"))


def test_rows_come_back_as_they_were_kept(many, tmp_path):
    file = tmp_path / "rows.jsonl"
    for row in many[:5]:
        rows.append(file, [replace(row, scalars=((0.1, 0.2),))])
    assert rows.read(file) == [replace(r, scalars=((0.1, 0.2),)) for r in many[:5]]


def test_a_line_that_a_killed_run_left_is_no_row(many, tmp_path):
    file = tmp_path / "rows.jsonl"
    rows.append(file, many[:2])
    file.write_bytes(file.read_bytes() + b'{"name": "a/3", "wo')
    assert rows.read(file) == many[:2]
    rows.append(file, many[2:3])
    assert rows.read(file) == many[:3]
    file.write_text(file.read_text().replace('"word"', '"wort"', 1))
    with pytest.raises(InputError, match="line 1"):
        rows.read(file)


@pytest.fixture
def things(tmp_path):
    """A folder of a chair that was labelled and a thing that is none."""
    from procmodels.classes import chair

    folder = tmp_path / "ikea_dev"
    params = {p.name: p.usual_value() for p in chair.SPACE.parameters}
    mesh = load("procmodels/classes/chair.py").build(chair.SPACE.held(params)).to_trimesh()
    for name, what in (("chair/agam", mesh), ("table/lunnarp", trimesh.creation.icosphere(2, 0.5))):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        what.export(folder / f"{name}.ply")
    return folder


def test_the_gather_goes_on_where_it_stopped(things, tmp_path, monkeypatch):
    model = load("procmodels/classes/chair.py")
    options = gather.GatherOptions((things,), ("mesh",), own=1, work=tmp_path)
    asked = []

    def answer(model, mesh, seed):
        asked.append(len(mesh.faces))
        if len(asked) == 3:
            raise KeyboardInterrupt
        params = {p.name: p.usual_value() for p in model.space.parameters}
        return params, None, Evidence(0.01, 0.0, 0.0, 0.0, 0.2, 0.5, 0.0)

    monkeypatch.setitem(gather.ANSWERS, "mesh", answer)
    with pytest.raises(KeyboardInterrupt):
        gather.run(model, options)
    assert len(rows.read(gather.file_of(model, options))) == 2
    found = gather.run(model, options)
    assert len(asked) == 4
    assert {(r.name, r.belongs, r.own) for r in found} == {
        ("ikea_dev/chair/agam", True, False),
        ("ikea_dev/table/lunnarp", False, False),
        ("own/0", True, True),
    }
    assert len(gather.run(model, replace(options, limit=2))) == 2
    assert len(asked) == 4


def test_what_is_learnt_of_one_class_leaves_others_alone(many, tmp_path):
    file = tmp_path / "beliefs.json"
    command.write(file, "first", "one", {"mesh": fit.fitted(many[:40], "mesh")})
    before = json.loads(file.read_text())["classes"]["first"]
    command.write(file, "second", "two", {"mesh": fit.fitted(many[40:80], "mesh")})
    after = json.loads(file.read_text())["classes"]
    assert after["first"] == before
    assert after["second"]["name"] == "two"


def test_the_summary_is_of_objects_that_did_not_teach_it(many):
    told = {row.what: row for row in command.summary("mesh", many)}
    assert told["mesh: choices with a label that were stated"].value == 300
    (denied,) = (row for what, row in told.items() if "that are none" in what)
    assert denied.bound == ">= 0.95"
