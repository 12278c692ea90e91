"""Parameter spaces: what a procedural model can be asked for.

Five kinds cover the paper's four (section 3.1): Scalar and Ratio are its continuous scalars (a ratio maps the lower
half of [0, 1] to low..1 and the upper half to 1..high), then Integer, Choice (an item of a set) and Flag (binary); a
Geometric scalar takes equal factors. A parameter vector, as networks see it, holds one number in [0, 1] for a scalar,
one in {0, 1} for a flag and a one-hot block for an integer or choice (paper, section 3.2).

A parameter whose condition does not hold is inactive: it does nothing, and samples, vectors and decoded values hold it
at its usual value, so that one shape has one vector.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np

from procmodels.parameters import Choice, Flag, Geometric, Integer, Parameter, Ratio, Scalar, Value
from procmodels.scalars import UNIFORM
from procmodels.units import MODEL, Unit

__all__ = [
    "Choice",
    "Flag",
    "Geometric",
    "Integer",
    "ParamSpace",
    "Parameter",
    "ParameterError",
    "Params",
    "Ratio",
    "Scalar",
    "Value",
]

Params = dict[str, Value]
WORDS = ("about", "group", "said")  # fields of a parameter that change neither shapes nor vectors


class ParameterError(ValueError):
    """Parameter values that a space does not contain; the message names each of them with its range."""


@dataclass(frozen=True)
class ParamSpace:
    """The parameters of one procedural model, in a fixed order.

    `version` belongs to the hash: raise it whenever the same parameters build another shape, so that weights trained on
    the old shapes are refused. Raises ValueError for conditions on parameters that are not there, that ask the
    impossible or that go round in a circle.
    """

    name: str
    parameters: tuple[Parameter, ...]
    version: int = 1

    def __post_init__(self) -> None:
        for p in self.parameters:
            for asked in p.only_if.comparisons() if p.only_if else ():
                if asked.name not in self.by_name:
                    raise ValueError(f"{self.name}: {p.name} depends on {asked.name}, which is no parameter")
                if fault := self.by_name[asked.name].fault(asked):
                    raise ValueError(f"{self.name}: {p.name} depends on whether {asked}, but {asked.name} {fault}")
        try:
            self._conditions_first  # noqa: B018 (sorted once, here, where a circle is an error)
        except CycleError as error:
            raise ValueError(f"{self.name}: parameters depend on each other: {', '.join(error.args[1])}") from error

    @cached_property
    def by_name(self) -> dict[str, Parameter]:
        """The parameters by name, in order."""
        return {p.name: p for p in self.parameters}

    @cached_property
    def width(self) -> int:
        """Length of the parameter vector."""
        return sum(p.slots for p in self.parameters)

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Where each parameter lives in the vector."""
        ends = np.cumsum([p.slots for p in self.parameters])
        return {p.name: slice(int(e) - p.slots, int(e)) for p, e in zip(self.parameters, ends, strict=True)}

    @cached_property
    def grid_size(self) -> int:
        """How many points the grid of evenly spaced values holds."""
        return math.prod(p.grid_steps for p in self.parameters)

    @cached_property
    def hash(self) -> str:
        """16 hex digits over names, kinds, ranges, units, conditions, what is usual, order and version."""
        spec = [self.name, self.version, [[type(p).__name__, _specification(p)] for p in self.parameters]]
        return hashlib.sha256(json.dumps(spec, sort_keys=True).encode()).hexdigest()[:16]

    @cached_property
    def conditional(self) -> bool:
        """Whether any parameter may be inactive."""
        return any(p.only_if for p in self.parameters)

    @cached_property
    def _conditions_first(self) -> tuple[Parameter, ...]:
        """The parameters, each after those that its condition asks about."""
        asks = {p.name: sorted(p.only_if.names) if p.only_if else [] for p in self.parameters}
        return tuple(self.by_name[n] for n in TopologicalSorter(asks).static_order())

    @cached_property
    def usual(self) -> Params:
        """The usual value of every parameter; the middle of its range where none is said."""
        return {p.name: p.usual_value() for p in self.parameters}

    @cached_property
    def usual_vector(self) -> np.ndarray:
        """(width,) float32 of the usual values, inactive or not."""
        return self._slots(self.usual)

    def active(self, values: Mapping[str, Any]) -> frozenset[str]:
        """Names of the parameters that do something beside the others' values."""
        known: dict[str, bool] = {}
        for p in self._conditions_first:
            known[p.name] = not p.only_if or bool(
                p.only_if.evaluate(lambda asked: known[asked.name] and asked.allows(values[asked.name]))
            )
        return frozenset(name for name, on in known.items() if on)

    def active_slots(self, values: Mapping[str, Any]) -> np.ndarray:
        """(width,) bool, slots of the parameters that do something."""
        active = self.active(values)
        return np.array([p.name in active for p in self.parameters for _ in range(p.slots)])

    def active_in(self, vectors: Any) -> Any:
        """(B, width) bool, the active slots of (B, width) vectors: arrays of numpy or tensors of torch."""
        mask, always = vectors == vectors, vectors[:, 0] == vectors[:, 0]
        known: dict[str, Any] = {}
        for p in self._conditions_first:
            known[p.name] = (
                always
                if p.only_if is None
                else p.only_if.evaluate(
                    lambda asked: (
                        known[asked.name] & self.by_name[asked.name].meets(vectors[:, self.slices[asked.name]], asked)
                    )
                )
            )
        for name, where in self.slices.items():
            mask[:, where] = known[name][:, None]
        return mask

    def held(self, values: Mapping[str, Any]) -> Params:
        """The values with inactive parameters at their usual ones, in the space's order."""
        if not self.conditional:
            return {p.name: values[p.name] for p in self.parameters}
        active = self.active(values)
        return {p.name: values[p.name] if p.name in active else p.usual_value() for p in self.parameters}

    def grid_point(self, index: int) -> Params:
        """Grid point number `index` (0 <= index < grid_size), mixed-radix with the last parameter running fastest.

        Points that differ in inactive parameters only are the same.
        """
        if not 0 <= index < self.grid_size:
            raise IndexError(f"{self.name}: grid index {index} is not in 0..{self.grid_size - 1}")
        values: Params = {}
        for p in reversed(self.parameters):
            index, digit = divmod(index, p.grid_steps)
            values[p.name] = p.grid_value(digit)
        return self.held(values)

    def sample(self, rng: np.random.Generator, on_grid: bool = False, uniform: float = UNIFORM) -> Params:
        """One random shape, its scalars on the grid (evenly) or continuous; choices by their shares.

        uniform  share of the continuous scalars that are drawn evenly over their range rather than round what is usual
        """
        if on_grid and self.grid_size < 2**63 and all(p.usual is None for p in self.parameters):
            return self.grid_point(int(rng.integers(self.grid_size)))
        if on_grid:
            return self.held({p.name: _on_grid(p, rng) for p in self.parameters})
        return self.held({p.name: p.sample(rng, uniform) for p in self.parameters})

    def validate(self, values: Mapping[str, Any]) -> Params:
        """The values in the space's order.

        Raises ParameterError naming every missing, unknown or unusable value together with what is allowed.
        """
        known = self.by_name
        faults = [f"{n}: unknown; {self.name} has {', '.join(known)}" for n in values if n not in known]
        for name, p in known.items():
            if name not in values:
                faults.append(f"{name}: missing; it is {p.describe()}")
            elif fault := p.problem(values[name]):
                faults.append(f"{name} = {values[name]!r} {fault}; it is {p.describe()}")
        if faults:
            raise ParameterError(f"{self.name}: " + "; ".join(faults))
        return {name: values[name] for name in known}

    def encode(self, values: Mapping[str, Any]) -> np.ndarray:
        """(width,) float32 parameter vector, inactive parameters as usual."""
        return self._slots(self.held(self.validate(values)))

    def decode(self, vector: np.ndarray) -> Params:
        """Values of a (width,) vector, clipped to their ranges; the largest entry of a one-hot block wins."""
        vector = np.asarray(vector)
        if vector.shape != (self.width,):
            raise ValueError(f"{self.name}: parameter vector must be ({self.width},), got {vector.shape}")
        return self.held({p.name: p.decode(vector[self.slices[p.name]]) for p in self.parameters})

    def metres(self, values: Mapping[str, Any], metres_per_unit: float) -> dict[str, float]:
        """Real lengths of the active parameters that are lengths, where a unit of the model is so many metres long."""
        lengths: dict[str, float] = {MODEL: metres_per_unit}
        active = self.active(values)
        waiting = {p.name: p.unit.of for p in self.scalars if isinstance(p.unit, Unit) and p.unit.is_length}
        while ready := [n for n, of in waiting.items() if of in lengths]:
            lengths |= {n: float(values[n]) * lengths[str(waiting.pop(n))] for n in ready}
        return {p.name: lengths[p.name] for p in self.scalars if p.name in lengths and p.name in active}

    def _slots(self, values: Params) -> np.ndarray:
        return np.array([x for p in self.parameters for x in p.encode(values[p.name])], np.float32)

    @property
    def scalars(self) -> tuple[Scalar, ...]:
        """The continuous parameters (scalars, ratios, geometric ones)."""
        return tuple(p for p in self.parameters if isinstance(p, Scalar))

    @property
    def discrete(self) -> tuple[Integer | Choice | Flag, ...]:
        """The integers, choices and flags."""
        return tuple(p for p in self.parameters if isinstance(p, Integer | Choice | Flag))

    @property
    def groups(self) -> dict[str, tuple[Parameter, ...]]:
        """The parameters by group, groups in the order in which they first appear."""
        names = dict.fromkeys(p.group for p in self.parameters)
        return {g: tuple(p for p in self.parameters if p.group == g) for g in names}


def _on_grid(p: Parameter, rng: np.random.Generator) -> Value:
    return p.sample_grid(rng) if isinstance(p, Scalar) else p.sample(rng)


def _specification(p: Parameter) -> dict[str, Any]:
    """What the hash covers of a parameter: fields that were not set are left out, so that new ones change nothing."""
    said = {f.name: getattr(p, f.name) for f in fields(p) if f.name not in WORDS}  # type: ignore[arg-type]
    unset = {"only_if": None, "usual": None, "absent": 0.0}
    kept = {k: v for k, v in said.items() if k not in unset or v != unset[k]}
    return {k: str(v) if k in ("unit", "only_if") else v for k, v in kept.items()}
