"""Continuous parameters: linear, as a ratio, or by equal factors (see procmodels.parameters for what all kinds say)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from procmodels.conditions import ABOVE, BELOW, Comparison, Condition
from procmodels.units import OF_HEIGHT, RATIO, Unit

UNIFORM = 0.5  # share of samples that do not ask what is usual: everything that is allowed is seen


@dataclass(frozen=True)
class Scalar:
    """A real number in [low, high], stored linearly in [0, 1]; `steps` evenly spaced values form its grid."""

    name: str
    low: float
    high: float
    steps: int = 9
    unit: Unit | str = OF_HEIGHT
    only_if: Condition | None = None
    usual: tuple[float, float] | None = None
    about: str = ""
    group: str = ""
    absent: float = 0.0  # share of samples that have the lowest value: what it measures is not there
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

    def usual_value(self) -> float:
        return self.value_from_unit(0.5) if self.usual is None else self.usual[0]

    def sample(self, rng: np.random.Generator, uniform: float = UNIFORM) -> float:
        """Evenly over the range in a share `uniform` of all cases, else round the usual value; or absent."""
        if self.absent and rng.random() < self.absent:
            return self.low
        if self.usual is None or rng.random() < uniform:
            return self.value_from_unit(rng.random())
        while True:
            if self.low <= (value := rng.normal(*self.usual)) <= self.high:
                return value

    def sample_grid(self, rng: np.random.Generator) -> float:
        return self.grid_value(int(rng.integers(self.steps)))

    def encode(self, value: Any) -> list[float]:
        return [self.unit_from_value(float(value))]

    def decode(self, slots: np.ndarray) -> float:
        return self.value_from_unit(min(1.0, max(0.0, float(slots[0]))))

    def meets(self, block: Any, comparison: Comparison) -> Any:
        """(B,) bool of a (B, 1) block of vectors, numpy's or torch's."""
        border = self.unit_from_value(comparison.values[0])
        return block[:, 0] > border if comparison.relation == ABOVE else block[:, 0] < border

    def fault(self, comparison: Comparison) -> str | None:
        return None if comparison.relation in (ABOVE, BELOW) else "is a number: compare it by above() or below()"

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

    unit: Unit | str = RATIO

    def value_from_unit(self, unit: float) -> float:
        if unit < 0.5:
            return self.low + (1 - self.low) * 2 * unit
        return 1 + (self.high - 1) * (2 * unit - 1)

    def unit_from_value(self, value: float) -> float:
        if value < 1:
            return (value - self.low) / (1 - self.low) / 2
        return 0.5 + (value - 1) / (self.high - 1) / 2


@dataclass(frozen=True)
class Geometric(Scalar):
    """A positive scalar whose equal steps are equal factors: lengths of which some are many times others."""

    def value_from_unit(self, unit: float) -> float:
        return min(self.high, max(self.low, self.low * (self.high / self.low) ** unit))

    def unit_from_value(self, value: float) -> float:
        return math.log(value / self.low) / math.log(self.high / self.low)
