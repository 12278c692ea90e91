"""The network: layouts, losses against the library and by hand, both layer lists, training that resumes."""

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from nnproc.codec import Codec
from nnproc.infer import WeightsError, load_network, params_from_grids, save_network
from nnproc.losses import PAPER, LossWeights, kl_divergence, losses, similarity_loss
from nnproc.network import (
    NetworkConfig,
    NNProc,
    occupancy_loss,
    occupancy_slope,
    parameter_count,
)
from nnproc.shape_nets import ProductDecoder, cells_from_grid, grid_from_cells
from procmodels import load, paper_names
from procmodels.conditions import when
from procmodels.space import Choice, Flag, Integer, ParamSpace, Scalar

SPACE = ParamSpace(
    "stool", (Scalar("depth", 0.4, 0.6, 3), Integer("bars", 0, 2), Choice("legs", ("a", "b")), Flag("round"))
)


def test_cells_and_grids_are_inverse():
    grid = torch.rand(2, 64, 64, 64)
    cells = cells_from_grid(grid)
    assert cells.shape == (2, 64, 16, 16, 16)
    assert torch.equal(grid_from_cells(cells), grid)
    # Channel (a, b, c) of cell (i, j, k) is voxel (4 i + a, 4 j + b, 4 k + c).
    assert cells[1, 16 * 3 + 4 * 1 + 2, 5, 6, 7] == grid[1, 23, 25, 30]


def test_occupancy_loss_is_cross_entropy():
    logits = torch.randn(3, 10, dtype=torch.float64, requires_grad=True)
    target = (torch.rand(3, 10) < 0.5).double()
    expected = torch.nn.functional.binary_cross_entropy_with_logits(logits, target, reduction="none").sum(1)
    assert torch.allclose(occupancy_loss(logits, target), expected)
    assert torch.autograd.gradcheck(lambda x: occupancy_loss(x, target), logits)


def test_occupancy_slope_is_the_gradient_of_the_loss():
    logits = torch.randn(3, 10, requires_grad=True)
    target = (torch.rand(3, 10) < 0.5).float()
    occupancy_loss(logits, target).sum().backward()
    assert torch.allclose(occupancy_slope(logits.detach(), target), logits.grad, atol=1e-6)


def test_a_product_decoder_is_a_sum_of_products_of_profiles():
    decoder = ProductDecoder(128)
    z = torch.randn(2, 128)
    grid = decoder.grid(z)
    assert torch.equal(grid_from_cells(decoder(z)), grid)
    profiles = decoder.profiles(decoder.trunk(z)).reshape(2, 3, decoder.TERMS, 64)
    x, y, zs = profiles[1, 0, :, 5].tanh(), profiles[1, 1, :, 17].tanh(), profiles[1, 2, :, 40]
    assert grid[1, 5, 17, 40].item() == pytest.approx((x * y * zs).sum().item(), abs=1e-4)
    assert grid.mean() < -2  # few voxels are occupied


def test_octaves_tell_near_values_apart():
    """PE sees sin and cos of 2^k pi u; without octaves it is as it was."""
    network = NNProc(SPACE, NetworkConfig(octaves=2))
    plain = NNProc(SPACE)
    scalars = len(network.codec.scalars)
    assert network.param_encoder[0].in_features == plain.param_encoder[0].in_features + 4 * scalars
    seen = []
    network.param_encoder.register_forward_pre_hook(lambda _, args: seen.append(args[0]))
    vector = network.codec.vectors([{"depth": 0.45, "bars": 1, "legs": "a", "round": True}])  # u = 1/4
    network.encode_params(vector)
    assert torch.allclose(seen[0][0, -4:], torch.tensor([1.0, 0.0, 0.0, -1.0]), atol=1e-5)


def test_codec_activates_by_kind(rng):
    codec = Codec(SPACE)
    values = codec.activate(torch.randn(5, codec.width))
    assert ((values >= 0) & (values <= 1)).all()
    for block in codec.blocks:
        assert torch.allclose(values[:, block].sum(1), torch.ones(5))
    vectors = codec.vectors([SPACE.sample(rng) for _ in range(20)])
    assert torch.equal(codec.snap(vectors), vectors)
    assert codec.discrete_right(vectors, vectors).all()
    assert codec.discrete_right(vectors, vectors).shape == (20, 3)


def test_param_loss_vanishes_only_at_the_truth(rng):
    codec = Codec(SPACE)
    vectors = codec.vectors([SPACE.sample(rng) for _ in range(10)])
    sure = torch.logit(vectors.clamp(1e-4, 1 - 1e-4)) * 1.0
    for block in codec.blocks:
        sure[:, block] = vectors[:, block] * 40
    assert codec.loss(sure, vectors).max() < 1e-2
    assert (codec.loss(-sure, vectors) > 0.2).all()


CONDITIONAL = ParamSpace(
    "conditional",
    (
        Choice("back", ("none", "bars"), usual=(1, 3)),
        Integer("bars", 1, 3, only_if=when("back").is_("bars"), usual=(1, 0, 0)),
        Scalar("width", 0.2, 1.0, only_if=when("bars").above(1), usual=(0.4, 0.1)),
        Flag("ring", only_if=when("back").is_("none"), usual=0.9),
        Scalar("depth", 0.2, 1.0),
    ),
)


def test_what_does_nothing_counts_neither_in_the_loss_nor_in_the_accuracy():
    codec = Codec(CONDITIONAL)
    bare = {"back": "none", "bars": 1, "width": 0.4, "ring": False, "depth": 0.6}
    target = codec.vectors([bare, {**bare, "back": "bars", "bars": 3, "width": 0.8, "ring": True}])
    other = codec.vectors([bare, {**bare, "back": "bars", "bars": 3, "width": 0.8, "ring": True}])
    other[0, codec.space.slices["bars"]] = torch.tensor([0.0, 0.0, 1.0])
    other[0, codec.space.slices["width"]] = 0.9
    other[1, codec.space.slices["ring"]] = 0.0
    scores = torch.logit(other.clamp(1e-6, 1 - 1e-6))
    assert codec.loss(scores, target).max() < 1e-3
    assert codec.scalar_error(other, target).tolist() == [0, 0]
    assert codec.discrete_right(other, target).all()
    assert codec.discrete_accuracy(other, target) == 1
    assert torch.equal(codec.snap(other), target), "held at what is usual"

    wrong = other.clone()
    wrong[1, codec.space.slices["width"]] = 0.0
    wrong[1, codec.space.slices["bars"]] = torch.tensor([1.0, 0.0, 0.0])
    assert codec.scalar_error(wrong, target).tolist() == pytest.approx([0, 0.75 / 2])
    # Of back and ring, back and bars one is wrong.
    assert codec.discrete_accuracy(wrong, target) == 3 / 4
    assert codec.loss(torch.logit(wrong.clamp(1e-6, 1 - 1e-6)), target)[1] > 1


def test_the_loss_gives_no_gradient_to_what_does_nothing():
    codec = Codec(CONDITIONAL)
    target = codec.vectors([{"back": "none", "bars": 1, "width": 0.4, "ring": False, "depth": 0.6}])
    scores = torch.randn(1, codec.width, requires_grad=True)
    codec.loss(scores, target).sum().backward()
    assert scores.grad is not None
    assert torch.equal(scores.grad[0] != 0, codec.active(target)[0])
    assert codec.active(target)[0].tolist() == [True] * 2 + [False] * 4 + [True] * 2


def test_kl_of_the_prior_is_zero():
    assert kl_divergence(torch.zeros(2, 8), torch.zeros(2, 8)).abs().max() == 0
    assert kl_divergence(torch.full((1, 1), 2.0), torch.zeros(1, 1)).item() == pytest.approx(2.0)


def test_similarity_loss_is_zero_for_equal_angles():
    x = torch.randn(6, 5)
    assert similarity_loss(3 * x, x).item() == pytest.approx(0, abs=1e-5)
    assert similarity_loss(torch.randn(6, 5), x).item() > 0.1


@pytest.mark.parametrize("layers", ["patch", "product", "paper", "planes"])
def test_every_weight_gets_a_gradient(layers, rng):
    network = NNProc(SPACE, NetworkConfig(layers=layers))
    vectors = network.codec.vectors([SPACE.sample(rng) for _ in range(4)])
    cells = (torch.rand(4, 64, 16, 16, 16) < 0.05).float()
    terms = losses(network, cells, vectors, LossWeights())
    assert set(terms) == {"total", "shape", "param", "kl", "sim", "latent"}
    terms["total"].backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().sum() > 0, name


def test_the_papers_weights_are_all_one():
    assert (PAPER.shape, PAPER.param, PAPER.kl, PAPER.sim, PAPER.latent) == (1, 1, 1, 1, 1)


def test_unknown_layers_are_refused():
    with pytest.raises(ValueError, match="patch, product, paper"):
        NNProc(SPACE, NetworkConfig(layers="huge"))


def test_weights_round_trip_and_are_refused_for_another_space(tmp_path):
    path = tmp_path / "stool.safetensors"
    network = NNProc(SPACE, NetworkConfig(layers="product", octaves=2)).eval()
    save_network(path, network)
    loaded = load_network(SPACE, path)
    z = torch.randn(2, 128)
    assert torch.allclose(network.decode_params(z), loaded.decode_params(z), atol=1e-3)
    other = ParamSpace("stool", SPACE.parameters, version=2)
    with pytest.raises(WeightsError) as error:
        load_network(other, path)
    assert SPACE.hash in str(error.value)
    assert other.hash in str(error.value)
    with pytest.raises(WeightsError, match=r"nnproc\.train"):
        load_network(SPACE, tmp_path / "none.safetensors")
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(WeightsError, match="restore or retrain"):
        load_network(SPACE, path)


def test_a_rich_classes_whole_network_stays_below_12_mb():
    """Half precision; the widest layers and heads for the chair's 70 slots."""
    space = ParamSpace("wide", (*SPACE.parameters, Choice("more", tuple(str(i) for i in range(60)))))
    assert 2 * parameter_count(NNProc(space, NetworkConfig(layers="planes", hidden=512))) < 12e6


@pytest.mark.parametrize("name", paper_names())
def test_shipped_weights_load_as_they_are(name):
    model = load(f"paper/{name}")
    network = load_network(model.space, model.weights, decoder=True)
    assert network.has_decoder
    stored = load_file(model.weights)
    state = network.state_dict()
    assert set(stored) == set(state)
    assert all(torch.equal(state[k].cpu(), v.float()) for k, v in stored.items())


def test_an_inverse_half_is_stored_alone_and_refuses_to_draw(tmp_path):
    path = tmp_path / "stool.safetensors"
    network = NNProc(SPACE, NetworkConfig(layers="planes", hidden=32)).eval()
    network.has_decoder = False
    save_network(path, network)
    assert {k.split(".")[0] for k in load_file(path)} == {"shape_encoder", "param_decoder"}
    loaded = load_network(SPACE, path)
    assert not loaded.has_decoder
    grid = torch.rand(1, 64, 64, 64).round()
    found, expected = (n.decode_params(n.encode_grid(grid)[0]) for n in (loaded, network))
    assert torch.allclose(found, expected, atol=1e-2)
    z, vector = torch.zeros(1, 128), torch.zeros(1, loaded.codec.width)
    for ask in (
        lambda: loaded.decode_grid(z),
        lambda: loaded.decode_cells(z),
        lambda: loaded.encode_params(vector),
        lambda: losses(loaded, cells_from_grid(grid), vector, LossWeights()),
    ):
        with pytest.raises(RuntimeError, match="stool"):
            ask()
    with pytest.raises(WeightsError, match=r"inverse half alone.*needs a decoder"):
        load_network(SPACE, path, decoder=True)
    # A file that lacks what it should hold is refused.
    state = load_file(path)
    with safe_open(path, framework="pt") as file:
        metadata = file.metadata()
    save_file({k: v for k, v in state.items() if not k.startswith("param_decoder.0")}, path, metadata)
    with pytest.raises(WeightsError, match=r"param_decoder\.0"):
        load_network(SPACE, path)


def test_shipped_weights_know_the_chair(chair):
    """Shapes that the shipped network has never seen, direct prediction."""
    from datasets.voxels import surface_grid

    rng = np.random.default_rng(987)
    params = [chair.space.sample(rng) for _ in range(24)]
    shapes = [chair.build(p) for p in params]
    found = params_from_grids(
        load_network(chair.space, chair.weights), np.stack([surface_grid(s.vertices(), s.triangles()) for s in shapes])
    )
    names = [p.name for p in chair.space.discrete]
    right = np.mean([[f[n] == p[n] for n in names] for f, p in zip(found, params, strict=True)])
    assert right >= 0.95
    for s in chair.space.scalars:
        error = np.mean([abs(f[s.name] - p[s.name]) for f, p in zip(found, params, strict=True)]) / (s.high - s.low)
        assert error < 0.05, s.name
