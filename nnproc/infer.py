"""Trained networks: saving, loading with checks, and the two direct tasks.

Task 1, parameters to shape: SD(PE(p)). Task 2, shape to parameters: PD(SE(s)) (paper, sections 4.2.1 and 4.2.2).
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from nnproc.network import HALVES, NetworkConfig, NNProc
from nnproc.on_device import device, latents_of_grids, logits_of_vectors, values_of_latents
from nnproc.shape_nets import channels_last
from procmodels.space import Params, ParamSpace


class WeightsError(ValueError):
    """Weights that are missing, damaged, or of another class or parameter space."""


def save_network(path: Path, network: NNProc) -> None:
    """Write the weights, in half precision, with everything that rebuilds and checks them; whole or not at all.

    Of a network without a decoder only the inverse half is written.
    """
    metadata = {
        "class": network.space.name,
        "space_hash": network.space.hash,
        "config": json.dumps(asdict(network.config)),
    }
    state = network.state_dict()
    if not network.has_decoder:
        metadata["halves"] = "inverse"
        state = {k: v for k, v in state.items() if k.split(".")[0] in HALVES["inverse"]}
    tensors = {k: v.detach().half().cpu().contiguous() for k, v in state.items()}
    partial = path.with_suffix(".partial")
    save_file(tensors, partial, metadata)
    partial.replace(path)


def load_network(space: ParamSpace, path: Path, decoder: bool = False) -> NNProc:
    """The trained network of a space, in evaluation mode; shipped ones lie beside their models (Model.weights).

    Files that hold the inverse half alone give a network whose has_decoder is False; with `decoder` they will not do.
    Raises WeightsError when the file is missing, damaged, or of another class or parameter space.
    """
    if not path.is_file():
        raise WeightsError(
            f"there are no weights at {path}; train them with: python -m nnproc.train {space.name} --out {path}"
        )
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {k: file.get_tensor(k).float() for k in file.keys()}  # noqa: SIM118 (not a dict)
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path} is not a readable safetensors file ({error}); restore or retrain it") from error
    if metadata.get("class") != space.name or metadata.get("space_hash") != space.hash:
        raise WeightsError(
            f"{path} was trained for {metadata.get('class')} (space {metadata.get('space_hash')}), but the model is "
            f"{space.name} (space {space.hash}); retrain with: python -m nnproc.train {space.name}"
        )
    halves = metadata.get("halves", "both")
    if decoder and halves != "both":
        raise WeightsError(
            f"{path} holds the {halves} half alone, from shapes to parameters, and what is asked for needs a decoder; "
            f"the networks of paper/CLASS have one, as has what python -m nnproc.train makes"
        )
    try:
        network = NNProc(space, NetworkConfig(**json.loads(metadata["config"])))
        network.has_decoder = halves == "both"
        lacking, unknown = network.load_state_dict(tensors, strict=network.has_decoder)
        if unknown or any(k.split(".")[0] in HALVES["inverse"] for k in lacking):
            raise ValueError(f"it lacks {lacking} and has {unknown}")
    except (KeyError, TypeError, RuntimeError, ValueError) as error:
        raise WeightsError(f"{path} does not fit the network it describes: {error}") from error
    channels_last(network)
    return network.to(device()).eval().requires_grad_(False)


@torch.inference_mode()
def grids_from_params(network: NNProc, vectors: Tensor, batch: int = 32) -> np.ndarray:
    """Task 1: (n, width) parameter vectors to (n, 64, 64, 64) bool grids."""
    return torch.cat([logits_of_vectors(network, v) > 0 for v in vectors.split(batch)]).numpy()


@torch.inference_mode()
def values_from_grids(network: NNProc, grids: np.ndarray, batch: int = 32) -> Tensor:
    """Task 2: (n, 64, 64, 64) bool grids to (n, width) activated parameter values."""
    parts = [torch.from_numpy(grids[start : start + batch]) for start in range(0, len(grids), batch)]
    return torch.cat([values_of_latents(network, latents_of_grids(network, g, half=True)) for g in parts])


def params_from_grids(network: NNProc, grids: np.ndarray) -> list[Params]:
    """Task 2, as parameter sets."""
    return network.codec.params(values_from_grids(network, grids))


def likely_params(network: NNProc, grids: np.ndarray, count: int) -> list[list[Params]]:
    """Task 2 with doubts: of each grid the likeliest parameter sets, at most `count` (Codec.likely)."""
    return [network.codec.likely(values, count) for values in values_from_grids(network, grids)]
