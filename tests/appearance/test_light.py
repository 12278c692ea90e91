"""Light that is known is found again from the colours that it makes."""

from __future__ import annotations

import numpy as np
import pytest

from recon.appearance.atlas import unwrapped
from recon.appearance.light import believed, light
from recon.appearance.materials import alike, base_colours
from recon.appearance.texels import Texels
from recon.appearance.views import Rays
from tests.appearance.made_photos import stool

ALBEDO = np.array([0.5, 0.2, 0.35])
SUN = np.array([0.5, -0.6, 0.62])


@pytest.fixture(scope="module")
def cells():
    atlas = unwrapped(stool(), 256)
    return Texels.of(atlas).cells(), atlas, Rays(atlas)


def _lit(cells, atlas, rays) -> np.ndarray:
    """(m,): a sun that casts shadows, and light from all round."""
    normals = atlas.normals[cells.triangle]
    cosine = np.maximum(normals @ SUN, 0)
    free = rays.free(cells.places + 2e-3 * normals.astype(np.float32), SUN.astype(np.float32))
    return 0.8 * cosine * free + 0.3 + 0.15 * normals[:, 2]


def test_shading_is_told_from_colour(cells):
    texels, atlas, rays = cells
    lit = _lit(*cells)
    colour = (ALBEDO[atlas.part[texels.triangle]] * lit)[:, None] * np.ones(3)
    found = light(texels, atlas, rays, colour, np.ones(len(lit)), np.arange(3)).shade
    flat = np.log(lit / found)
    assert np.std(flat) < 0.6 * np.std(np.log(lit)), "most of the shading is gone"
    brightness = [np.median((colour[:, 0] / found)[atlas.part[texels.triangle] == p]) for p in range(3)]
    assert np.array(brightness) / brightness[0] == pytest.approx(ALBEDO / ALBEDO[0], rel=0.2)


def test_nothing_seen_is_even_light(cells):
    texels, atlas, rays = cells
    n = len(texels.flat)
    found = light(texels, atlas, rays, np.full((n, 3), np.nan), np.zeros(n), np.zeros(3, int)).shade
    top = (atlas.normals[texels.triangle, 2] > 0.9) & (texels.places[:, 2] > 0.3)
    assert found[top] == pytest.approx(np.ones(top.sum()), abs=0.02)
    assert found[atlas.normals[texels.triangle, 2] < -0.9].max() < 0.7


def test_parts_of_one_material_share_it_and_a_darker_one_does_not(cells):
    """All of one hue; one board is painted five times as dark."""
    texels, atlas, rays = cells
    part = atlas.part[texels.triangle]
    colour = (np.array([0.5, 0.1, 0.5])[part] * _lit(*cells))[:, None] * (1.2, 1.0, 0.7)
    weight = np.ones(len(part))
    assert alike(part, 3, colour, weight).tolist() == [0, 0, 0]
    found = light(texels, atlas, rays, colour, weight, alike(part, 3, colour, weight))
    assert found.material[0] == found.material[2] != found.material[1]
    base, _ = base_colours(stool().parts, part, colour / found.shade[:, None], weight, found.material)
    assert base[0] == pytest.approx(base[2], rel=0.15)
    assert base[1] / base[0] == pytest.approx(np.full(3, 0.2), rel=0.3)


def test_hues_are_told_apart():
    part = np.arange(3).repeat(10)
    colour = np.array([(0.4, 0.3, 0.2), (0.2, 0.25, 0.4), (0.8, 0.6, 0.42)])[part]
    assert alike(part, 4, colour, np.ones(30)).tolist() == [0, 1, 0, 2], "the last is not seen"


def test_light_that_leads_away_from_a_colour_is_not_believed():
    shade, bright = np.array([0.5, 0.5, 0.5, 2.0, 2.0, 0.5]), np.array([0.1, 0.14, 0.2, 0.2, 0.9, np.nan])
    found = believed(shade, bright, np.full(6, 0.2))
    assert found == pytest.approx([0.5, 0.7, 1.0, 1.0, 2.0, 1.0])
