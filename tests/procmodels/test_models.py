"""What every procedural model promises, asked of all of them: frame, closed parts, one-to-one, nothing floats."""

from collections import Counter

import numpy as np
import pytest

import procmodels
from datasets.voxels import surface_grid
from procmodels.space import Scalar
from tests.procmodels.touching import all_touch

SHAPES = 3  # random ones a class


@pytest.fixture(scope="module", params=procmodels.names())
def model(request):
    return procmodels.load(request.param)


@pytest.fixture(scope="module")
def built(model):
    """Random shapes and the two far corners of the space, each (params, Shape)."""
    rng = np.random.default_rng(21)
    params = [model.space.sample(rng) for _ in range(SHAPES)]
    params += [model.space.grid_point(0), model.space.grid_point(model.space.grid_size - 1)]
    return [(p, model.build(p)) for p in params]


def _grid(shape):
    return surface_grid(shape.vertices(), shape.triangles())


def test_shapes_stand_in_the_canonical_frame(model, built):
    for params, shape in built:
        low, high = shape.bounds()
        assert (high - low).max() == pytest.approx(1, abs=1e-6), params
        assert low + high == pytest.approx(0, abs=1e-6), params
        lowest = min(p.vertices[:, 2].min() for p in model.build_parts(model.space.validate(params)))
        assert lowest == pytest.approx(0, abs=1e-6), params


def test_parts_have_names_of_their_own(built):
    for params, shape in built:
        names = [p.name for p in shape.parts]
        assert len(set(names)) == len(names), params
        assert all(names)


def test_parts_are_closed_and_face_outwards(built):
    for params, shape in built:
        for part in shape.parts:
            edges = Counter((f[i - 1], f[i]) for f in part.faces for i in range(len(f)))
            assert set(edges.values()) == {1}, (params, part.name)
            assert all((b, a) in edges for a, b in edges), (params, part.name)
            a, b, c = (part.vertices[part.triangles()[:, i]] for i in range(3))
            assert (np.cross(a, b) * c).sum() > 0, (params, part.name)


def test_no_part_floats(built):
    for params, shape in built:
        assert all_touch(shape.parts), params


def test_vectors_and_parameters_are_one_to_one(model, rng):
    for on_grid in (True, False):
        for _ in range(20):
            params = model.space.sample(rng, on_grid)
            vector = model.space.encode(params)
            assert vector.shape == (model.space.width,)
            back = model.space.decode(vector)
            assert model.space.encode(back) == pytest.approx(vector, abs=1e-6)
            for p in model.space.parameters:
                if isinstance(p, Scalar):
                    assert back[p.name] == pytest.approx(params[p.name], abs=1e-5 * (p.high - p.low))
                else:
                    assert back[p.name] == params[p.name]


def _far(parameter, value):
    """The end of the parameter's grid that is farther from the value."""
    ends = [parameter.grid_value(0), parameter.grid_value(parameter.grid_steps - 1)]
    if isinstance(parameter, Scalar):
        return max(ends, key=lambda v: abs(parameter.unit_from_value(v) - parameter.unit_from_value(value)))
    return next(v for v in ends if v != value)


def test_every_parameter_changes_every_mesh_and_the_grid(model, built):
    """Where it is active. A thin member of a wide shape may stay within its voxels, so one of the shapes must tell by
    its grid, if there are several."""
    rng = np.random.default_rng(22)
    for p in model.space.parameters:
        changed = []
        shapes = [(params, shape) for params, shape in built[:SHAPES] if p.name in model.space.active(params)]
        while len(shapes) < SHAPES:
            if p.name in model.space.active(params := model.space.sample(rng)):
                shapes.append((params, model.build(params)))
        for params, shape in shapes:
            other = model.build({**params, p.name: _far(p, params[p.name])})
            a, b = shape.vertices(), other.vertices()
            assert a.shape != b.shape or np.abs(a - b).max() > 1e-3, (params, p.name)
            changed.append(int((_grid(other) ^ _grid(shape)).sum()))
        assert max(changed) > 20, (p.name, changed)


def test_the_same_parameters_build_the_same_shape(model, built):
    params, shape = built[0]
    again = model.build(params)
    assert (again.vertices() == shape.vertices()).all()
    assert (again.triangles() == shape.triangles()).all()
