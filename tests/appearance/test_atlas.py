"""A surface laid flat: all of it, nowhere twice, and back again."""

from __future__ import annotations

import numpy as np
import pytest

import procmodels
from recon.appearance.atlas import unwrapped
from recon.appearance.charts import charts

SIZE = 512


@pytest.fixture(scope="module", params=["chair", "bed", "shelf", "table", "sofa"])
def shape(request):
    model = procmodels.load(request.param)
    return model.build(model.space.sample(np.random.default_rng(7)))


def test_every_polygon_is_in_one_chart(shape):
    found = charts(shape)
    for i, part in enumerate(shape.parts):
        faces = np.concatenate([c.faces for c in found if c.part == i])
        assert sorted(faces) == list(range(len(part.faces)))


def test_nothing_lies_on_top_of_another(shape):
    """The pixel at a random place of every triangle shows that place, or one beside it."""
    atlas = unwrapped(shape, SIZE)
    shown = atlas.triangle_of_pixels()
    assert atlas.pixels.min() >= 0
    assert atlas.pixels.max() <= SIZE
    rng = np.random.default_rng(0)
    weights = rng.dirichlet((1, 1, 1), len(atlas.pixels))
    at = np.einsum("mi,mij->mj", weights, atlas.pixels)
    found = shown[tuple(at.astype(int).T[::-1])]
    covered = found >= 0  # not so where a pixel's middle is beyond the border
    assert covered.mean() > 0.95
    found, at, weights, corners = found[covered], at[covered], weights[covered], atlas.corners[covered]
    # A pixel at an edge may belong to either side; both then lie at the same place in space.
    x, y = np.floor(at).T + 0.5
    there = np.einsum("mij,mj->mi", atlas.surface_from_pixels[found], np.stack([x, y, np.ones_like(x)], 1))
    here = np.einsum("mi,mij->mj", weights, corners)
    assert np.linalg.norm(there - here, axis=1).max() < 4 / atlas.scale


def test_places_lead_to_pixels_and_back(shape):
    atlas = unwrapped(shape, SIZE)
    big = np.linalg.norm(np.cross(*(atlas.pixels[:, k] - atlas.pixels[:, 0] for k in (1, 2)))[:, None], axis=1) > 1
    middle = atlas.corners.mean(1)
    back = np.einsum("mij,mj->mi", atlas.pixels_from_surface, np.concatenate([middle, np.ones((len(middle), 1))], 1))
    assert back[big] == pytest.approx(atlas.pixels.mean(1)[big], abs=1e-3)


def test_uv_are_the_pixels_with_v_up(shape):
    atlas = unwrapped(shape, SIZE)
    first = atlas.uv[0][: len(shape.parts[0].faces[0])]
    assert first[:3] * (SIZE, -SIZE) + (0, SIZE) == pytest.approx(atlas.pixels[0])
    assert [len(u) for u in atlas.uv] == [sum(map(len, p.faces)) for p in shape.parts]


def test_a_picture_without_room_is_refused(shape):
    with pytest.raises(ValueError, match="no room"):
        unwrapped(shape, 16)
