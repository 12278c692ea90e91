"""The network on another device than the rest: every path that a GPU would take, on a made-up device or a GPU."""

from contextlib import nullcontext

import numpy as np
import pytest
import torch

from datasets.voxels import surface_grid
from nnproc import on_device, parameter_search
from nnproc.infer import grids_from_params, load_network, params_from_grids
from nnproc.latent_fit import FitOptions, fit, grid_objective, hull_starts, silhouette_objective
from nnproc.parameter_search import SearchOptions, bank, draw_grid, draw_silhouettes
from nnproc.ray_operator import ray_operator
from nnproc.rays import look_at_cameras
from tests.nnproc.elsewhere import PLACE, Elsewhere, is_away, send

PLACES = ["elsewhere", pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU"))]


@pytest.fixture(params=PLACES)
def placed(request, chair, monkeypatch):
    """The chair's network on the device."""
    away = load_network(chair.space, chair.weights)
    if request.param == "cuda":
        yield away
        return
    for tensor in (*away.parameters(), *away.buffers()):
        send(tensor)
    monkeypatch.setattr(on_device, "device", lambda: PLACE)
    monkeypatch.setattr(torch, "autocast", lambda *_, **__: nullcontext())  # which knows no such device
    with Elsewhere():
        yield away


@pytest.fixture(scope="module")
def seen(chair):
    """A shape's grid, four cameras and its silhouettes at their rays."""
    shape = chair.build(chair.space.sample(np.random.default_rng(1)))
    grid = surface_grid(shape.vertices(), shape.triangles())
    operator = ray_operator(*look_at_cameras([20, 110, 200, 290], [20, 35, 20, 35], 2.2, 35, 24), 24, 24)
    return grid, operator, (operator.render(20.0 * torch.from_numpy(grid).float() - 10) > 0.5).float()


def test_tensors_that_meet_from_two_places_fail():
    with Elsewhere():
        away = torch.ones(3, requires_grad=True).to(PLACE)
        assert is_away(away)
        assert away.device == PLACE
        assert (away * 2).cpu().tolist() == [2, 2, 2]
        with pytest.raises(AssertionError, match="meet"):
            away + torch.ones(3)
        with pytest.raises(AssertionError, match="numpy"):
            away.detach().numpy()


def test_both_direct_tasks(placed, chair):
    params = [chair.space.sample(np.random.default_rng(s)) for s in range(3)]
    truth = np.stack([surface_grid(s.vertices(), s.triangles()) for s in map(chair.build, params)])
    grids = grids_from_params(placed, placed.codec.vectors(params))
    assert (grids != truth).mean() < 0.01
    for found, asked in zip(params_from_grids(placed, truth), params, strict=True):
        assert all(found[p.name] == asked[p.name] for p in chair.space.discrete)


def test_latent_fits(placed, seen):
    grid, operator, target = seen
    options = FitOptions(bank=6, starts=4, keep=2, steps=3, prune_at=2)
    starts = hull_starts(placed, grid, (0, 1))
    for objective in (silhouette_objective(operator, target), grid_objective(torch.from_numpy(grid).float())):
        fits = fit(placed, objective, options, (0, 1), starts)
        assert len(fits) == 2
        assert all(np.isfinite(f.loss) for f in fits)


def test_the_search_among_parameters(placed, chair, seen):
    grid, operator, target = seen
    rng = np.random.default_rng(3)
    params = [chair.space.sample(rng) for _ in range(8)]
    grids = [surface_grid(s.vertices(), s.triangles()) for s in map(chair.build, params)]
    options = SearchOptions(starts=2, keep=(2,), newton_steps=1)
    known = bank(placed.codec.vectors(params), [g.ravel() for g in grids])
    assert parameter_search.search(placed, draw_grid, torch.from_numpy(grid).float().flatten(), known, options)
    shown = [operator.render(20.0 * torch.from_numpy(g).float() - 10) > 0.5 for g in grids]
    known = bank(placed.codec.vectors(params), [s.numpy() for s in shown])
    assert parameter_search.search(placed, draw_silhouettes(operator), target, known, options)
