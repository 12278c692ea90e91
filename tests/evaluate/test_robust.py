"""Wrong and half-hidden masks: grey areas are unknown, and neither they nor wrong views change the result."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from procmodels import load
from recon.evaluate import robust
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.files.mask_images import read_mask, read_unknown
from recon.geometry import align
from recon.geometry.object_windows import object_crops
from recon.scene import Silhouettes


@pytest.fixture(scope="module")
def scene():
    model = load("paper/chair")
    shape = model.build(model.space.sample(np.random.default_rng(3)))
    cameras, place = orbit(16, seed=2)
    return drawn_scene(shape, cameras, place)


def test_grey_areas_are_unknown_and_soft_edges_are_not(tmp_path):
    mask = np.zeros((120, 160), np.uint8)
    mask[20:100, 30:110] = 255
    mask[60:100, 80:140] = 128
    mask[19, 30:110] = mask[20:100, 29] = 128  # a soft edge
    file = tmp_path / "mask.png"
    cv2.imwrite(str(file), mask)
    unknown = read_unknown(file, (160, 120))
    assert unknown[60:100, 80:140].all()
    assert unknown.sum() == 40 * 60
    assert read_mask(file, (160, 120))[30:50, 40:100].all()
    half = read_unknown(file, (80, 60))
    assert half.shape == (60, 80)
    assert half[32:48, 42:68].all()


def test_unknown_pixels_are_out_of_the_comparison(scene):
    masks = scene.silhouettes
    hidden = robust.cut_off(masks, np.random.default_rng(0))
    views = [v for v, u in enumerate(hidden.unknown) if u is not None]
    assert len(views) == 5
    crops = object_crops(replace(scene, silhouettes=hidden), 64)
    whole = object_crops(scene, 64)
    for v in range(16):
        fewer = whole.valid[v] & ~crops.valid[v]
        assert fewer.any() == (v in views)
        assert np.array_equal(crops.masks[v][crops.valid[v]] > 0.5, whole.masks[v][crops.valid[v]] > 0.5)
        assert (hidden.possible(v) >= masks.masks[v]).all()


def test_alignment_does_not_cut_where_masks_say_nothing(scene):
    poses, masks = scene.poses, scene.silhouettes
    before = align.run(poses, masks).world_from_canonical
    after = align.run(poses, robust.cut_off(masks, np.random.default_rng(0))).world_from_canonical
    size = np.cbrt(np.linalg.det(before[:3, :3]))
    assert np.cbrt(np.linalg.det(after[:3, :3])) == pytest.approx(size, rel=0.03)
    assert np.linalg.norm(after[:3, 3] - before[:3, 3]) < 0.03 * size


def test_replaced_masks_are_put_aside(scene):
    poses, masks = scene.poses, scene.silhouettes
    spoilt = robust.replaced(0.2)(masks, np.random.default_rng(1))
    changed = {n for n, a, b in zip(masks.names, masks.masks, spoilt.masks, strict=True) if not np.array_equal(a, b)}
    found = robust.judged(poses, spoilt)
    assert len(changed) == 3
    assert {n for n, u in zip(found.names, found.used, strict=True) if not u} == changed
    assert {n for n, _ in found.reasons} == changed


def test_grown_masks_grow_and_shrink(scene):
    masks = scene.silhouettes
    rng = np.random.default_rng(0)
    wide, narrow = robust.grown(2)(masks, rng), robust.grown(-2)(masks, rng)
    for exact, w, n in zip(masks.masks, wide.masks, narrow.masks, strict=True):
        assert n.sum() < exact.sum() < w.sum()
        assert (n <= exact).all()
        assert (exact <= w).all()


def test_unknown_must_belong_to_the_masks(scene):
    masks = scene.silhouettes
    with pytest.raises(ValueError, match="unknown"):
        replace(masks, unknown=(None,))
    assert isinstance(masks, Silhouettes)
