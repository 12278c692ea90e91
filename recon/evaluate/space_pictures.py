"""What a class can make: random shapes of its prior, and every value of its choices.

    python -m recon.evaluate space --class procmodels/classes/chair.py

The same class gives the same pictures. Here people see whether a prior looks like what they own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procmodels import Model
from procmodels.space import Params
from recon.evaluate.gallery import CAPTION, Tile, jpeg, stacked, strip

TRIES = 10_000  # samples until one has a parameter active


@dataclass(frozen=True)
class SpaceOptions:
    """What the pictures show and where they go."""

    shapes: int = 40  # random ones
    columns: int = 8
    width: int = 1400  # pixels
    quality: int = 85  # of the JPEG
    seed: int = 5
    out: Path = Path("docs/gallery")


def run(model: Model, options: SpaceOptions = SpaceOptions()) -> Iterator[Path]:
    """Draw NAME_prior.jpg and, for a class with choices, NAME_choices.jpg; yields their paths."""
    options.out.mkdir(parents=True, exist_ok=True)
    for what, tiles in (("prior", prior(model, options)), ("choices", choices(model, options))):
        if tiles:
            rows = [tiles[i : i + options.columns] for i in range(0, len(tiles), options.columns)]
            caption = CAPTION if any(text for text, _ in tiles) else 0
            picture = stacked([strip(row, options.columns, caption, options.width) for row in rows])
            path = options.out / f"{model.space.name}_{what}.jpg"
            path.write_bytes(jpeg(picture, options.quality))
            yield path


def prior(model: Model, options: SpaceOptions) -> list[Tile]:
    """Random shapes, all their scalars as usual."""
    generators = [np.random.default_rng([options.seed, i]) for i in range(options.shapes)]
    return [("", model.build(model.space.sample(rng, uniform=0.0))) for rng in generators]


def choices(model: Model, options: SpaceOptions) -> list[Tile]:
    """Every value of every choice, integer and flag on the first usual shape that it does something to."""
    tiles: list[Tile] = []
    for p in model.space.discrete:
        base = _active(model, p.name, options.seed)
        for value in map(p.grid_value, range(p.grid_steps)):
            said = {True: "yes", False: "no"}[value] if isinstance(value, bool) else value
            name = p.name.replace("_", " ")
            tiles.append((f"{name}: {said}", model.build(model.space.held({**base, p.name: value}))))
    return tiles


def _active(model: Model, name: str, seed: int) -> Params:
    """The usual values, or the first sample in which the parameter does something."""
    if name in model.space.active(model.space.usual):
        return model.space.usual
    for i in range(TRIES):
        params = model.space.sample(np.random.default_rng([seed, i]), uniform=0.0)
        if name in model.space.active(params):
            return params
    raise ValueError(f"{model.name}: {name} does nothing in {TRIES:,} samples")
