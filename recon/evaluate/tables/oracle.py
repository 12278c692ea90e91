"""The best that a procedural model can do on an object: a long exact search on the true mesh.

An oracle is an upper bound of that best: a longer search may find better, and an answer from any input that comes
nearer than the search replaces it. What an answer loses against it was there to be found; what remains at the oracle
cannot be expressed, or nobody has found it.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import trimesh

from procmodels import Model
from procmodels.space import Params
from recon.evaluate.metrics import chamfer
from recon.files.recognise import Kind
from recon.fitting import shape_fit
from recon.fitting.shape_fit import ShapeFitOptions
from recon.fitting.shape_starts import StartOptions
from recon.shapes import shape_target
from recon.shapes.shape_target import ShapeOptions

SLOW_BUILD = 150  # random shapes for node graphs, which take long to build


@dataclass(frozen=True)
class OracleOptions:
    """How long is searched, beside what the tool does for its users (recon.fitting.shape_fit)."""

    random: int = 500  # random shapes, five times as many
    keep: int = 12  # starts that are polished, three times as many
    fine: int = 2_000
    sweeps: int = 8
    tries: int = 5
    seeds: tuple[int, ...] = (0, 1)


def oracle(model: Model, mesh: trimesh.Trimesh, options: OracleOptions = OracleOptions()) -> tuple[Params, float]:
    """Parameters and their D_chamfer to the mesh, which is given in the canonical frame: up and front are known."""
    best: tuple[float, Params] | None = None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "object.ply"
        mesh.export(file)
        for seed in options.seeds:
            target = shape_target.run(file, Kind.MESH, Kind.MESH, ShapeOptions(up="z", front="-y", seed=seed))
            search = ShapeFitOptions(
                StartOptions(random=SLOW_BUILD if model.live_object else options.random),
                keep=options.keep,
                fine=options.fine,
                sweeps=options.sweeps,
                tries=options.tries,
                seed=seed,
            )
            params = shape_fit.run(model, target, search).params
            distance = chamfer(model.build(params).to_trimesh(), mesh)
            if best is None or distance < best[0]:
                best = distance, params
    assert best is not None
    return best[1], best[0]
