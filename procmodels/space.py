"""Parameter spaces: what a procedural model can be asked for.

Five kinds cover the paper's four (section 3.1): Scalar and Ratio are its continuous scalars (a ratio maps the lower
half of [0, 1] to low..1 and the upper half to 1..high), then Integer, Choice (an item of a set) and Flag (binary).
A parameter vector, as networks see it, holds one number in [0, 1] for a scalar or ratio, one in {0, 1} for a flag and a
one-hot block for an integer or choice (paper, section 3.2).
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

Value = float | int | str | bool
Params = dict[str, Value]


class ParameterError(ValueError):
    """Parameter values that a space does not contain; the message names each of them with its range."""


class Parameter(Protocol):
    """What every kind of parameter answers; `slots` is its width in the parameter vector."""

    @property
    def name(self) -> str: ...
    @property
    def slots(self) -> int: ...
    @property
    def grid_steps(self) -> int: ...
    def grid_value(self, index: int) -> Value: ...
    def sample(self, rng: np.random.Generator) -> Value: ...
    def encode(self, value: Value) -> list[float]: ...
    def decode(self, slots: np.ndarray) -> Value: ...
    def problem(self, value: object) -> str | None: ...
    def describe(self) -> str: ...


@dataclass(frozen=True)
class Scalar:
    """A real number in [low, high], stored linearly in [0, 1]; `steps` evenly spaced values form its grid."""

    name: str
    low: float
    high: float
    steps: int
    unit: str = "of height"
    slots = 1

    @property
    def grid_steps(self) -> int:
        return self.steps

    def value_from_unit(self, unit: float) -> float:
        return self.low + (self.high - self.low) * unit

    def unit_from_value(self, value: float) -> float:
        return (value - self.low) / (self.high - self.low)

    def grid_value(self, index: int) -> float:
        return self.value_from_unit(index / (self.steps - 1))

    def sample(self, rng: np.random.Generator) -> float:
        return self.value_from_unit(rng.random())

    def encode(self, value: Value) -> list[float]:
        return [self.unit_from_value(float(value))]

    def decode(self, slots: np.ndarray) -> float:
        return self.value_from_unit(min(1.0, max(0.0, float(slots[0]))))

    def problem(self, value: object) -> str | None:
        if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
            return "is not a number"
        # A hair of tolerance: values that went through JSON or float32 and back stay valid.
        slack = 1e-6 * (self.high - self.low)
        inside = math.isfinite(value) and self.low - slack <= value <= self.high + slack
        return None if inside else "is out of range"

    def describe(self) -> str:
        return f"a number from {self.low:g} to {self.high:g} ({self.unit})"


@dataclass(frozen=True)
class Ratio(Scalar):
    """A scalar whose lower half maps to low..1 and whose upper half maps to 1..high (low < 1 < high)."""

    unit: str = "ratio"

    def value_from_unit(self, unit: float) -> float:
        if unit < 0.5:
            return self.low + (1 - self.low) * 2 * unit
        return 1 + (self.high - 1) * (2 * unit - 1)

    def unit_from_value(self, value: float) -> float:
        if value < 1:
            return (value - self.low) / (1 - self.low) / 2
        return 0.5 + (value - 1) / (self.high - 1) / 2


class _OneHot:
    """Shared by the kinds that are one of a short list of values."""

    name: str

    @property
    def values(self) -> tuple[Value, ...]:
        raise NotImplementedError

    @property
    def slots(self) -> int:
        return len(self.values)

    @property
    def grid_steps(self) -> int:
        return len(self.values)

    def grid_value(self, index: int) -> Value:
        return self.values[index]

    def sample(self, rng: np.random.Generator) -> Value:
        return self.values[int(rng.integers(len(self.values)))]

    def encode(self, value: Value) -> list[float]:
        return [float(value == v) for v in self.values]

    def decode(self, slots: np.ndarray) -> Value:
        return self.values[int(np.argmax(slots))]


@dataclass(frozen=True)
class Integer(_OneHot):
    """A whole number in low..high, both included."""

    name: str
    low: int
    high: int

    @property
    def values(self) -> tuple[Value, ...]:
        return tuple(range(self.low, self.high + 1))

    def problem(self, value: object) -> str | None:
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            return "is not a whole number"
        return None if self.low <= value <= self.high else "is out of range"

    def describe(self) -> str:
        return f"a whole number from {self.low} to {self.high}"


@dataclass(frozen=True)
class Choice(_OneHot):
    """One of a set of names."""

    name: str
    options: tuple[str, ...]

    @property
    def values(self) -> tuple[Value, ...]:
        return self.options

    def problem(self, value: object) -> str | None:
        return None if isinstance(value, str) and value in self.options else "is not one of them"

    def describe(self) -> str:
        return "one of " + ", ".join(self.options)


@dataclass(frozen=True)
class Flag:
    """True or false."""

    name: str
    slots = 1
    grid_steps = 2

    def grid_value(self, index: int) -> bool:
        return bool(index)

    def sample(self, rng: np.random.Generator) -> bool:
        return bool(rng.integers(2))

    def encode(self, value: Value) -> list[float]:
        return [float(bool(value))]

    def decode(self, slots: np.ndarray) -> bool:
        return bool(slots[0] >= 0.5)

    def problem(self, value: object) -> str | None:
        return None if isinstance(value, bool | np.bool_) else "is neither true nor false"

    def describe(self) -> str:
        return "true or false"


@dataclass(frozen=True)
class ParamSpace:
    """The parameters of one procedural model, in a fixed order.

    `version` belongs to the hash: raise it whenever the same parameters build another shape, so that weights trained on
    the old shapes are refused.
    """

    name: str
    parameters: tuple[Parameter, ...]
    version: int = 1

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
        """How many shapes the grid of evenly spaced values holds."""
        return math.prod(p.grid_steps for p in self.parameters)

    @cached_property
    def hash(self) -> str:
        """16 hex digits over names, kinds, ranges, order and version."""
        spec = [self.name, self.version, [[type(p).__name__, asdict(p)] for p in self.parameters]]  # type: ignore[call-overload]
        return hashlib.sha256(json.dumps(spec, sort_keys=True).encode()).hexdigest()[:16]

    def grid_point(self, index: int) -> Params:
        """Grid point number `index` (0 <= index < grid_size), mixed-radix with the last parameter running fastest."""
        if not 0 <= index < self.grid_size:
            raise IndexError(f"{self.name}: grid index {index} is not in 0..{self.grid_size - 1}")
        values: Params = {}
        for p in reversed(self.parameters):
            index, digit = divmod(index, p.grid_steps)
            values[p.name] = p.grid_value(digit)
        return {p.name: values[p.name] for p in self.parameters}

    def sample(self, rng: np.random.Generator, on_grid: bool = False) -> Params:
        """One random shape: a uniform grid point, or scalars drawn continuously."""
        if on_grid:
            return self.grid_point(int(rng.integers(self.grid_size)))
        return {p.name: p.sample(rng) for p in self.parameters}

    def validate(self, values: Mapping[str, Any]) -> Params:
        """The values in the space's order.

        Raises ParameterError naming every missing, unknown or unusable value together with what is allowed.
        """
        known = {p.name: p for p in self.parameters}
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
        """(width,) float32 parameter vector."""
        checked = self.validate(values)
        return np.array([x for p in self.parameters for x in p.encode(checked[p.name])], np.float32)

    def decode(self, vector: np.ndarray) -> Params:
        """Values of a (width,) vector, clipped to their ranges; the largest entry of a one-hot block wins."""
        vector = np.asarray(vector)
        if vector.shape != (self.width,):
            raise ValueError(f"{self.name}: parameter vector must be ({self.width},), got {vector.shape}")
        return {p.name: p.decode(vector[self.slices[p.name]]) for p in self.parameters}

    @property
    def scalars(self) -> tuple[Scalar, ...]:
        """The continuous parameters (scalars and ratios)."""
        return tuple(p for p in self.parameters if isinstance(p, Scalar))

    @property
    def discrete(self) -> tuple[Integer | Choice | Flag, ...]:
        """The integers, choices and flags."""
        return tuple(p for p in self.parameters if isinstance(p, Integer | Choice | Flag))
