"""What outlines say of the kind of thing, whatever was fitted to it."""

from __future__ import annotations

import numpy as np
import pytest

from datasets import outlines
from datasets.camera_rings import look_at
from datasets.hulls import silhouette
from datasets.outline_frame import framed
from datasets.outlines import OutlineOptions
from nnproc import learn_outlines, outline_net
from nnproc.infer import WeightsError
from nnproc.learn_outlines import LearnOptions
from procmodels import load
from recon.fitting import likeness
from recon.geometry.triangles import Triangles


def drawn(seed: int, views: int = 6) -> list[np.ndarray]:
    """Pictures of a random chair."""
    model, rng = load("chair"), np.random.default_rng(seed)
    shape = model.build(model.space.sample(rng))
    cameras = [outlines.camera(shape.vertices(), rng, OutlineOptions()) for _ in range(views)]
    return [silhouette(shape, P, outlines.PIXELS) > 0 for P in cameras]


def ball() -> np.ndarray:
    u = np.linspace(-1, 1, 128)
    return np.hypot(*np.meshgrid(u, u)) < 0.7


def test_framed_outlines_know_neither_size_nor_place() -> None:
    mask = drawn(0, 1)[0]
    large = np.zeros((900, 1100), bool)
    large[100 : 100 + 6 * 128, 300 : 300 + 6 * 128] = np.kron(mask, np.ones((6, 6), bool))
    small, big = framed(mask), framed(large)
    assert (small ^ big).sum() <= 0.05 * small.sum()
    assert not framed(np.zeros((20, 30), bool)).any()
    line = np.zeros((50, 2000), bool)
    line[10] = True
    assert framed(line).any()


def test_chairs_look_like_chairs_and_a_ball_does_not() -> None:
    odds = [likeness.of_masks("chair", drawn(seed)) for seed in range(12)]
    assert np.mean(np.array(odds) < 0) >= 0.8
    assert likeness.of_masks("chair", [ball()] * 3) > 1
    assert likeness.of_masks("plant", [ball()]) == 0  # of kinds that are not known nothing is said
    assert likeness.of_masks("chair", [np.zeros((9, 9), bool)]) == 0


@pytest.mark.parametrize("count", [2000, 20_000])
def test_points_show_the_outlines_of_their_surface(count: int) -> None:
    model = load("chair")
    shape = model.build(model.space.sample(np.random.default_rng(5)))
    surface = Triangles.of(shape)
    points = surface.at(surface.places(count))[0]
    middle = (points.min(0) + points.max(0)) / 2
    for picture, (azimuth, elevation) in zip(likeness.pictures(points)[:4], likeness.VIEWS, strict=False):
        assert picture.any()
        true = framed(_view(shape, middle, azimuth, elevation))
        found = framed(picture)
        assert (true & found).sum() >= 0.8 * (true | found).sum()


def _view(shape, middle: np.ndarray, azimuth: float, elevation: float) -> np.ndarray:
    """The silhouette from there, in a window of 256 px."""
    a, e = np.radians([azimuth, elevation])
    way = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    pose = look_at(middle + likeness.DISTANCE * way, middle)[:3]
    K = np.array([(400.0, 0, 128), (0, 400.0, 128), (0, 0, 1)])
    return silhouette(shape, K @ pose, 256) > 0


def test_other_kinds_are_learnt_and_the_same_seed_gives_the_same_network(tmp_path) -> None:
    rng = np.random.default_rng(0)
    bits, kinds = [], []
    for i in range(60):
        picture = np.zeros((64, 64), bool)
        if i % 2:
            picture[5:59, 20 : 30 + int(rng.integers(0, 10))] = True
        else:
            picture[20 : 30 + int(rng.integers(0, 10)), 5:59] = True
        bits.append(np.packbits(picture))
        kinds.append(i % 2)
    found = outlines.Outlines(np.stack(bits), np.array(kinds), np.full(60, -1), ())
    few = LearnOptions(steps=30, batch=16, real=0.0)
    first, second = (learn_outlines.train(found, None, few) for _ in range(2))
    said = learn_outlines.accuracy(first, found, np.ones(60, bool))
    assert min(said.values()) > 0.95
    for a, b in zip(first.parameters(), second.parameters(), strict=True):
        assert a.equal(b)
    outline_net.save(first, tmp_path / "net.safetensors")
    again = outline_net.load(tmp_path / "net.safetensors")
    pictures = [p for p in found.pictures(np.arange(8))]
    np.testing.assert_allclose(
        outline_net.log_chances(again, pictures), outline_net.log_chances(first, pictures), atol=0.05
    )
    outlines.save(tmp_path / "outlines.npz", found)
    kept = outlines.read(tmp_path / "outlines.npz")
    assert np.array_equal(kept.bits, found.bits)
    assert kept.names == ()


def test_a_damaged_network_is_said(tmp_path) -> None:
    (tmp_path / "net.safetensors").write_bytes(b"no weights")
    with pytest.raises(WeightsError, match=r"net\.safetensors"):
        outline_net.load(tmp_path / "net.safetensors")
