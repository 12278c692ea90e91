"""A store damaged in any way: no result of it is used unless it is what was stored, nothing fails, all is said.

2,000 seeded damages of a store with all that the stages keep.
"""

import json
import logging
import shutil

import cv2
import numpy as np
import pytest

from recon import scene
from recon.fitting.refine import Refined
from recon.fitting.view_starts import Candidate, FitResult
from recon.geometry.visual_hull import Hull
from recon.pipelines import photos
from recon.pipelines.stages import Redo, Stages
from recon.scene import Cameras, Canonical, Frames, Poses, Silhouettes
from recon.store import Store, dataclasses_of

KNOWN = [*dataclasses_of(scene), Hull, FitResult, Candidate, Refined]
N = 3


def results(work, rng):
    """The result of every stage, with real pictures."""
    names = tuple(f"p{i}.jpg" for i in range(N))
    folders = [work / "frames", work / "undistorted"]
    for folder in folders:
        folder.mkdir(parents=True)
        for name in names:
            cv2.imwrite(str(folder / name), rng.integers(0, 255, (24, 32, 3)).astype(np.uint8))
    alpha = work / "frames" / "p0_alpha.png"
    cv2.imwrite(str(alpha), np.eye(24, 32, dtype=np.uint8))
    sizes = np.full((N, 2), (32, 24))
    cameras = Cameras(names, rng.random((N, 3, 3)), rng.random((N, 4, 4)), sizes)
    frames, undistorted = (tuple(folder / name for name in names) for folder in folders)
    masks = tuple(rng.random((24, 32)) > 0.5 for _ in names)
    params = {"width": 0.45, "legs": "support", "seats": 3, "round": True}
    return {
        "frames": Frames(
            names, frames, sizes, rng.random(N), rng.random(N), (alpha, None, None), (("x", "too small"),)
        ),
        "poses": Poses(cameras, undistorted, rng.random((9, 3)), rng.random((9, N)) > 0.5, ("q.jpg",), ("far off",)),
        "silhouettes": Silhouettes(names, masks, ("grabcut",) * N, np.ones(N, bool), rng.random(4)),
        "align": Canonical(np.diag([2.0, 2.0, 2.0, 1.0])),
        "hull": Hull(rng.random((16, 16, 16)) > 0.8),
        "fit": FitResult((Candidate(params, 2, 0.125), Candidate(params, 0, 0.25))),
        "refine": Refined(params, Canonical(np.eye(4)), 0.9, 0.8, (("front", 0.7),)),
    }


def same(a, b):
    """Whether two results are equal in every bit."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f), getattr(b, f)) for f in a.__dataclass_fields__)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b


# ---- kinds of damage: (path, its content, the paths of all files, random numbers) ----


def bit(path, data, files, rng):
    changed = bytearray(data)
    changed[rng.integers(len(data))] ^= 1 << rng.integers(8)
    path.write_bytes(changed)


def byte(path, data, files, rng):
    at = rng.integers(len(data))
    path.write_bytes(data[:at] + bytes([(data[at] + rng.integers(1, 256)) % 256]) + data[at + 1 :])


def cut_short(path, data, files, rng):
    path.write_bytes(data[: rng.integers(len(data))])


def emptied(path, data, files, rng):
    path.write_bytes(b"")


def zeros(path, data, files, rng):
    """As after a power loss: the size is right, the content is not there."""
    at = rng.integers(len(data))
    path.write_bytes(data[:at] + bytes(len(data) - at))


def removed(path, data, files, rng):
    path.unlink()


def longer(path, data, files, rng):
    path.write_bytes(data + rng.bytes(int(rng.integers(1, 50))))


def another(path, data, files, rng):
    """The content of another file of the store."""
    others = sorted(f for f in files if f != path)
    path.write_bytes(others[rng.integers(len(others))].read_bytes())


def noise(path, data, files, rng):
    path.write_bytes(rng.bytes(len(data)))


def other_number(path, data, files, rng):
    """A digit changed where there is one: what decodes, with another value."""
    digits = [i for i, c in enumerate(data) if chr(c).isdigit()] or [0]
    at = rng.choice(digits)
    path.write_bytes(data[:at] + (b"7" if data[at : at + 1] != b"7" else b"3") + data[at + 1 :])


def not_utf8(path, data, files, rng):
    at = rng.integers(len(data))
    path.write_bytes(data[:at] + b"\xff\xfe\xe4" + data[at:])


def a_folder(path, data, files, rng):
    path.unlink()
    path.mkdir()
    (path / "inside").write_text("x")


def twice(path, data, files, rng):
    path.write_bytes(data + data)


def rewritten(path, data, files, rng):
    """A whole archive of another shape, or JSON of another type."""
    if path.suffix == ".npz":
        np.savez(path, a0=np.zeros((2, 2)), a1=np.array(["text"]))
    else:
        path.write_text(json.dumps(([], "text", 3.5, None, {})[rng.integers(5)]))


DAMAGES = (bit, bit, bit, byte, cut_short, emptied, zeros, removed, longer, another, noise, other_number, not_utf8)
DAMAGES += (a_folder, twice, rewritten)


@pytest.fixture
def stored(tmp_path, rng):
    """A store, its results by stage, and the files that belong to each stage."""
    work = tmp_path / ".recon"
    store, made = Store(work, KNOWN), results(work, rng)
    for name, result in made.items():
        store.save(name, f"key of {name}", result, 1.5)
    belong = {name: [work / f"{name}.json", work / f"{name}.npz"] for name in made}
    belong["frames"] += sorted((work / "frames").iterdir())
    belong["poses"] += sorted((work / "undistorted").iterdir())
    return store, made, belong


def test_two_thousand_damages(stored, caplog):
    store, made, belong = stored
    files = [f for group in belong.values() for f in group]
    rng, failures = np.random.default_rng(2000), []
    caplog.set_level(logging.WARNING, "recon")
    for i in range(2000):
        path = files[i % len(files)]
        name, kind, data = next(n for n, g in belong.items() if path in g), rng.choice(DAMAGES), path.read_bytes()
        kind(path, data, files, rng)
        whole = path.is_file() and path.read_bytes() == data  # "zeros" where there were zeros
        caplog.clear()
        found = store.load(name, f"key of {name}")
        gone = not path.exists() and path.suffix == ".json"  # as if the stage was never run
        if (found is not None) != whole or len(caplog.records) != (0 if whole or gone else 1):
            failures.append((path.name, kind.__name__, caplog.text))
        elif not (whole or gone):
            assert f"the stored result of {name} is computed anew: " in caplog.text
            assert str(path) in caplog.text
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        path.write_bytes(data)
    assert not failures, failures[:5]
    for name, result in made.items():
        back = store.load(name, f"key of {name}")
        assert same(back.result, result), f"{name} as before, once all is whole again"


def staged(work, values):
    """The pipeline's own run of two stages that give arrays of these values; what they gave, and who was computed."""
    stages, computed = Stages(work, photos.STAGES, dataclasses_of(*photos.KNOWN), ["inputs"], Redo()), []

    def stage(name, value):
        return stages.run(name, [], lambda: computed.append(name) or Hull(np.full((2, 2, 2), value)))

    return [stage(name, value) for name, value in zip(("frames", "poses"), values, strict=True)], computed


@pytest.mark.parametrize("kind", [bit, emptied, removed, a_folder])
def test_what_is_damaged_is_computed_again_and_what_follows_stays(tmp_path, rng, caplog, kind):
    first, computed = staged(tmp_path, (0.5, 1.0))
    assert computed == ["frames", "poses"]
    assert staged(tmp_path, (0.5, 1.0))[1] == []
    path = tmp_path / "frames.npz"
    kind(path, path.read_bytes(), [path], rng)
    again, computed = staged(tmp_path, (0.5, 1.0))
    assert same(again, first)
    assert computed == ["frames"]
    assert "frames is computed anew" in caplog.text


def test_a_stage_that_gives_something_else_has_what_follows_computed_again(tmp_path):
    staged(tmp_path, (0.5, 1.0))
    (tmp_path / "frames.npz").write_bytes(b"")
    assert staged(tmp_path, (0.75, 1.0))[1] == ["frames", "poses"]


def test_one_stage_in_the_place_of_another(stored, caplog):
    store, _, _ = stored
    for ending in ("json", "npz"):
        shutil.copy(store.folder / f"refine.{ending}", store.folder / f"align.{ending}")
    assert store.load("align", "key of align") is None
    assert "align is computed anew: " in caplog.text
    assert "align.json is that of refine" in caplog.text


def test_a_moved_store_is_still_whole(stored, tmp_path):
    store, made, _ = stored
    store.folder.rename(tmp_path / "moved")
    moved = Store(tmp_path / "moved", KNOWN)
    back = moved.load("frames", "key of frames").result
    assert back.paths == tuple(tmp_path / "moved" / "frames" / p.name for p in made["frames"].paths)
