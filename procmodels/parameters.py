"""The kinds of parameters. Each may say when it does something, what is usual, what it does and where it belongs.

only_if  a Condition (procmodels.conditions) on other parameters; where it does not hold, this one does nothing
usual    the prior: (value, spread) of a number; shares of the values of a choice, integer or flag (the share of true)
about    what it does, in one line
group    where people look for it: "seat", "legs", "back", ...
said     how a sentence says each value of a choice ("a star base"); "": it does not
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from procmodels.conditions import ABOVE, BELOW, Comparison, Condition
from procmodels.scalars import UNIFORM, Geometric, Ratio, Scalar

__all__ = ["Choice", "Flag", "Geometric", "Integer", "Parameter", "Ratio", "Scalar", "Value"]

Value = float | int | str | bool
LEAST = 0.05  # share of samples that even the rarest choice has


class Parameter(Protocol):
    """What every kind of parameter answers; `slots` is its width in the parameter vector."""

    @property
    def name(self) -> str: ...
    @property
    def only_if(self) -> Condition | None: ...
    @property
    def usual(self) -> Any: ...
    @property
    def about(self) -> str: ...
    @property
    def group(self) -> str: ...
    @property
    def slots(self) -> int: ...
    @property
    def grid_steps(self) -> int: ...
    def usual_value(self) -> Value: ...
    def grid_value(self, index: int) -> Value: ...
    def sample(self, rng: np.random.Generator, uniform: float = UNIFORM) -> Value: ...
    def sample_grid(self, rng: np.random.Generator) -> Value: ...
    def encode(self, value: Value) -> list[float]: ...
    def decode(self, slots: np.ndarray) -> Value: ...
    def meets(self, block: Any, comparison: Comparison) -> Any: ...
    def fault(self, comparison: Comparison) -> str | None: ...
    def problem(self, value: object) -> str | None: ...
    def describe(self) -> str: ...


class _OneHot:
    """Shared by the kinds that are one of a short list of values."""

    name: str
    usual: tuple[float, ...] | None

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

    def shares(self) -> np.ndarray:
        """(n,) shares of samples that have each of the values: as usual, but none of them rarer than LEAST."""
        if self.usual is None:
            return np.full(len(self.values), 1 / len(self.values))
        least = min(LEAST, 1 / len(self.values))
        usual = np.asarray(self.usual, float)
        return least + (1 - least * len(usual)) * usual / usual.sum()

    def sample(self, rng: np.random.Generator, uniform: float = UNIFORM) -> Value:
        """By the usual shares, whatever `uniform`."""
        if self.usual is None:
            return self.sample_grid(rng)
        ends = np.cumsum(self.shares())
        return self.values[min(int(np.searchsorted(ends, rng.random(), side="right")), len(ends) - 1)]

    def sample_grid(self, rng: np.random.Generator) -> Value:
        return self.values[int(rng.integers(len(self.values)))]

    def encode(self, value: Value) -> list[float]:
        return [float(value == v) for v in self.values]

    def decode(self, slots: np.ndarray) -> Value:
        return self.values[int(np.argmax(slots))]

    def meets(self, block: Any, comparison: Comparison) -> Any:
        """(B,) bool of a (B, n) block of vectors, numpy's or torch's."""
        allowed = [i for i, v in enumerate(self.values) if comparison.allows(v)]
        return block[:, allowed].sum(1) > 0.5


@dataclass(frozen=True)
class Integer(_OneHot):
    """A whole number in low..high, both included."""

    name: str
    low: int
    high: int
    only_if: Condition | None = None
    usual: tuple[float, ...] | None = None
    about: str = ""
    group: str = ""

    @property
    def values(self) -> tuple[Value, ...]:
        return tuple(range(self.low, self.high + 1))

    def usual_value(self) -> Value:
        return self.values[len(self.values) // 2 if self.usual is None else int(np.argmax(self.usual))]

    def fault(self, comparison: Comparison) -> str | None:
        if comparison.relation in (ABOVE, BELOW) or all(v in self.values for v in comparison.values):
            return None
        return f"is {self.describe()}"

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
    only_if: Condition | None = None
    usual: tuple[float, ...] | None = None
    about: str = ""
    group: str = ""
    said: tuple[str, ...] = ()

    @property
    def values(self) -> tuple[Value, ...]:
        return self.options

    def usual_value(self) -> Value:
        return self.options[0 if self.usual is None else int(np.argmax(self.usual))]

    def fault(self, comparison: Comparison) -> str | None:
        known = comparison.relation not in (ABOVE, BELOW) and all(v in self.options for v in comparison.values)
        return None if known else f"is {self.describe()}"

    def problem(self, value: object) -> str | None:
        return None if isinstance(value, str) and value in self.options else "is not one of them"

    def describe(self) -> str:
        return "one of " + ", ".join(self.options)


@dataclass(frozen=True)
class Flag:
    """True or false."""

    name: str
    only_if: Condition | None = None
    usual: float | None = None
    about: str = ""
    group: str = ""
    slots = 1
    grid_steps = 2

    def grid_value(self, index: int) -> bool:
        return bool(index)

    def usual_value(self) -> bool:
        return self.usual is not None and self.usual > 0.5

    def sample(self, rng: np.random.Generator, uniform: float = UNIFORM) -> bool:
        """By the usual share, whatever `uniform`."""
        if self.usual is None:
            return self.sample_grid(rng)
        return bool(rng.random() < LEAST + (1 - 2 * LEAST) * self.usual)

    def sample_grid(self, rng: np.random.Generator) -> bool:
        return bool(rng.integers(2))

    def encode(self, value: Value) -> list[float]:
        return [float(bool(value))]

    def decode(self, slots: np.ndarray) -> bool:
        return bool(slots[0] >= 0.5)

    def meets(self, block: Any, comparison: Comparison) -> Any:
        """(B,) bool of a (B, 1) block of vectors, numpy's or torch's."""
        yes, no = comparison.allows(True), comparison.allows(False)
        on = block[:, 0] >= 0.5
        return (on & yes) | (~on & no)

    def fault(self, comparison: Comparison) -> str | None:
        known = comparison.relation not in (ABOVE, BELOW) and all(isinstance(v, bool) for v in comparison.values)
        return None if known else "is true or false"

    def problem(self, value: object) -> str | None:
        return None if isinstance(value, bool | np.bool_) else "is neither true nor false"

    def describe(self) -> str:
        return "true or false"


def grouped(group: str, *parameters: Parameter) -> tuple[Parameter, ...]:
    """The parameters, with the group that people look for them in."""
    return tuple(replace(p, group=group) for p in parameters)  # type: ignore[type-var]
