"""Stored stage results: exact round trips, stale and damaged ones made anew, nothing unpickled."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.fitting.refine import Refined
from recon.scene import Canonical
from recon.store import Store
from recon.system.digests import digest, folder_digest


@dataclass(frozen=True)
class Thing:
    numbers: np.ndarray
    files: tuple[Path, ...]
    inner: tuple[tuple[str, float], ...]
    nothing: None = None


def _thing(tmp_path):
    (tmp_path / "a.txt").write_text("a")
    return Thing(np.arange(6.0).reshape(2, 3), (tmp_path / "a.txt",), (("x", 0.5), ("y", 1.0)))


def test_results_round_trip(tmp_path):
    store, thing = Store(tmp_path / "s", [Thing]), _thing(tmp_path)
    store.save("thing", "k", thing, 1.5)
    stored = store.load("thing", "k")
    back, seconds = stored.result, stored.seconds
    assert (back.numbers == thing.numbers).all()
    assert (back.files, back.inner, back.nothing, seconds) == (thing.files, thing.inner, None, 1.5)


def test_nested_results_round_trip(tmp_path):
    store = Store(tmp_path, [Refined, Canonical])
    refined = Refined({"width": 0.5, "legs": "round"}, Canonical(np.eye(4)), 0.9, 0.8, (("front", 0.7),))
    store.save("refine", "k", refined, 0.0)
    back = store.load("refine", "k").result
    assert back.params == refined.params
    assert (back.canonical.world_from_canonical == np.eye(4)).all()


def test_another_key_a_lost_file_or_damage_means_again(tmp_path):
    store, thing = Store(tmp_path / "s", [Thing]), _thing(tmp_path)
    store.save("thing", "k", thing, 0.0)
    assert store.load("thing", "other") is None
    assert store.load("nothing", "k") is None
    archive = tmp_path / "s" / "thing.npz"
    whole = archive.read_bytes()
    archive.write_bytes(whole[:50])
    assert store.load("thing", "k") is None
    archive.write_bytes(whole)
    assert store.load("thing", "k") is not None
    (tmp_path / "a.txt").unlink()
    assert store.load("thing", "k") is None


def test_types_that_are_not_known_are_not_built(tmp_path):
    Store(tmp_path, [Thing]).save("thing", "k", _thing(tmp_path), 0.0)
    assert Store(tmp_path, []).load("thing", "k") is None


def test_pickled_arrays_are_refused(tmp_path):
    store = Store(tmp_path, [Thing])
    store.save("thing", "k", _thing(tmp_path), 0.0)
    np.savez(tmp_path / "thing.npz", a0=np.array([{"x": 1}], dtype=object))
    assert store.load("thing", "k") is None


def test_digests_follow_content_not_dates(tmp_path):
    (tmp_path / "a").write_text("1")
    first = folder_digest(tmp_path)
    (tmp_path / "a").write_text("1")
    assert folder_digest(tmp_path) == first
    (tmp_path / "a").write_text("2")
    assert folder_digest(tmp_path) != first
    assert folder_digest(None) == "none"
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1}) != digest({"a": 2, "b": 1})
