"""The optimiser: orthogonal updates, a problem it must solve, and a state that can be put away and taken up."""

import pytest
import torch

from nnproc.muon import Muon, orthogonalised


@pytest.mark.parametrize("shape", [(64, 32), (32, 64), (128, 16), (8, 24)])
def test_singular_values_come_to_about_one(shape):
    matrix = torch.randn(shape, generator=torch.Generator().manual_seed(1))
    for scale in (1e-4, 1.0, 1e3):
        values = torch.linalg.svdvals(orthogonalised(scale * matrix).float())
        assert values.min() > 0.6
        assert values.max() < 1.3


def test_singular_vectors_are_kept():
    left, _ = torch.linalg.qr(torch.randn(16, 4, generator=torch.Generator().manual_seed(2)))
    right, _ = torch.linalg.qr(torch.randn(8, 4, generator=torch.Generator().manual_seed(3)))
    matrix = left @ torch.diag(torch.tensor([4.0, 3.0, 2.0, 1.0])) @ right.T
    core = left.T @ orthogonalised(matrix).float() @ right
    assert (core.diagonal() > 0.6).all()
    assert (core - torch.diag(core.diagonal())).abs().max() < 0.05


@pytest.mark.parametrize("shape", [(256, 32), (32, 2000), (64, 64)])
def test_a_matrix_of_low_rank_does_not_grow(shape):
    """A batch of four gives gradients of rank four."""
    generator = torch.Generator().manual_seed(6)
    matrix = torch.randn(shape[0], 4, generator=generator) @ torch.randn(4, shape[1], generator=generator)
    values = torch.linalg.svdvals(orthogonalised(matrix).float())
    assert values[0] < 1.3
    assert values[3] > 0.6


def test_long_matrices_are_treated_as_square_ones_are():
    """Padded to a square with zeros, a long matrix takes the other path and must come out the same."""
    long = torch.randn(8, 64, generator=torch.Generator().manual_seed(5))
    square = torch.cat([long, torch.zeros(56, 64)])
    assert torch.allclose(orthogonalised(long).float(), orthogonalised(square)[:8].float(), atol=0.02)


def _problem():
    generator = torch.Generator().manual_seed(4)
    x = torch.randn(200, 6, generator=generator)
    target = x @ (0.5 * torch.randn(6, 8, generator=generator)) + torch.linspace(-0.2, 0.2, 8)
    layer = torch.nn.Linear(6, 8)
    torch.nn.init.zeros_(layer.weight)
    torch.nn.init.zeros_(layer.bias)
    return layer, x, target


def _advance(layer, optimiser, x, target, steps, total=400):
    loss = torch.zeros(())
    for step in steps:
        for group in optimiser.param_groups:
            group["lr"] = 2e-3 * (1 - step / total)
        optimiser.zero_grad()
        loss = (layer(x) - target).square().mean()
        loss.backward()
        optimiser.step()
    return float(loss.detach())


def test_least_squares_converges():
    layer, x, target = _problem()
    start = float(target.square().mean())
    assert _advance(layer, Muon(layer.parameters()), x, target, range(400)) < 1e-3 * start


def test_convolutions_are_seen_as_matrices():
    layer = torch.nn.Conv3d(3, 16, 3)
    before = layer.weight.detach().clone()
    layer(torch.randn(2, 3, 5, 5, 5)).square().mean().backward()
    Muon(layer.parameters(), lr=1e-3).step()
    values = torch.linalg.svdvals((before - layer.weight.detach()).flatten(1)) / (1e-3 * Muon.MATRIX_RATE)
    assert values.min() > 0.6
    assert values.max() < 1.3


def test_parameters_without_a_gradient_stay():
    layer = torch.nn.Linear(3, 3)
    before = layer.weight.detach().clone()
    Muon(layer.parameters()).step()
    assert torch.equal(before, layer.weight)


def test_a_state_put_away_and_taken_up_goes_on_as_if_unstopped():
    straight, x, target = _problem()
    _advance(straight, Muon(straight.parameters()), x, target, range(40))
    stopped, *_ = _problem()
    optimiser = Muon(stopped.parameters())
    _advance(stopped, optimiser, x, target, range(20))
    resumed = torch.nn.Linear(6, 8)
    resumed.load_state_dict(stopped.state_dict())
    taken_up = Muon(resumed.parameters())
    taken_up.load_state_dict(optimiser.state_dict())
    _advance(resumed, taken_up, x, target, range(20, 40))
    assert torch.allclose(straight.weight, resumed.weight, atol=1e-6)
    assert torch.allclose(straight.bias, resumed.bias, atol=1e-6)
