"""What every rich class is asked: shapes all over its space, closed parts, parameters that do something or nothing."""

from collections import Counter

import numpy as np
import pytest
import trimesh

from procmodels.space import Scalar


def shape_params(space, i):
    """Shape number i: as usual, evenly over the space, or at its corners, in turn."""
    rng = np.random.default_rng([31, i])
    if i % 3 < 2:
        return space.sample(rng, uniform=float(i % 3))
    ends = {p.name: (p.low, p.high)[rng.integers(2)] for p in space.scalars}
    return space.held({**{p.name: p.sample_grid(rng) for p in space.discrete}, **ends})


def moved(parts, name, by):
    """The parts, one of them elsewhere."""
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return [p.moved(matrix) if p.name == name else p for p in parts]


def stands_canonically(model, numbers):
    for i in numbers:
        params = shape_params(model.space, i)
        low, high = model.build(params).bounds()
        assert (high - low).max() == pytest.approx(1)
        assert low + high == pytest.approx(0, abs=1e-9)
        vertices = np.concatenate([p.vertices for p in model.build_parts(params)])
        assert vertices[:, 2].min() == pytest.approx(0, abs=1e-9), params


def parts_are_closed(model, numbers):
    for i in numbers:
        parts = model.build(shape_params(model.space, i)).parts
        assert len({p.name for p in parts}) == len(parts), i
        for part in parts:
            edges = Counter((f[j - 1], f[j]) for f in part.faces for j in range(len(f)))
            assert set(edges.values()) == {1}, (i, part.name)
            assert all((b, a) in edges for a, b in edges), (i, part.name)
            mesh = trimesh.Trimesh(part.vertices, part.triangles(), process=False)
            assert mesh.volume > 0, (i, part.name)
            if part.convex:
                hull = mesh.convex_hull.volume
                assert mesh.volume == pytest.approx(hull, rel=1e-3, abs=1e-9), (i, part.name)


def change(model, params, name, value):
    """How far the shape's vertices move when one parameter does; infinite when it has others."""
    before, after = (model.build_parts(p) for p in (params, {**params, name: value}))
    a, b = (np.concatenate([p.vertices for p in parts]) for parts in (before, after))
    return np.abs(a - b).max() if a.shape == b.shape else np.inf


def active_ones_change_the_shape(model, numbers):
    seen = Counter()
    for i in numbers:
        params = shape_params(model.space, i)
        active = model.space.active(params)
        for p in model.space.parameters:
            if p.name not in active:
                continue
            seen[p.name] += 1
            if isinstance(p, Scalar):
                unit = p.unit_from_value(params[p.name])
                values = [p.value_from_unit(unit + 0.1 if unit < 0.5 else unit - 0.1)]
            else:
                values = [v for v in map(p.grid_value, range(p.grid_steps)) if v != params[p.name]]
            for value in values:
                assert change(model, params, p.name, value) > 1e-4, (i, p.name, value, params)
    assert all(seen[p.name] >= 3 for p in model.space.parameters), seen


def others_change_nothing(model, numbers):
    for i in numbers:
        params = shape_params(model.space, i)
        for p in model.space.parameters:
            if p.name not in model.space.active(params):
                for value in (p.grid_value(0), p.grid_value(p.grid_steps - 1)):
                    assert change(model, params, p.name, value) == 0, (i, p.name)
