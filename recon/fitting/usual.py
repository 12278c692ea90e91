"""The prior of a space's parameters: what is usual decides what no view shows."""

from __future__ import annotations

import numpy as np

from procmodels.parameters import LEAST
from procmodels.space import Choice, Flag, Integer, Params, ParamSpace, Scalar, Value

LEAST_SPREAD = 1e-3  # of a scalar's range


class Usual:
    """Deviations from a space's usual values; those of parameters that do nothing are none, as they are held there."""

    def __init__(self, space: ParamSpace) -> None:
        scalars = space.scalars
        self._told = [i for i, s in enumerate(scalars) if s.usual is not None]
        ranges = [_in_range(scalars[i]) for i in self._told]
        self._middle, self._spread = np.array(ranges, float).reshape(-1, 2).T
        self._rarities = {p.name: _rarities(p) for p in space.discrete if p.usual is not None}
        self.slopes = np.zeros((len(self._told), len(scalars)))  # of `deviations` by the scalars' units
        self.slopes[np.arange(len(self._told)), self._told] = 1 / self._spread

    def deviations(self, units: np.ndarray) -> np.ndarray:
        """(r,) deviations of scalars, as shares (n,) of their ranges, in spreads."""
        return (units[self._told] - self._middle) / self._spread

    def by_scalar(self, units: np.ndarray) -> np.ndarray:
        """(n,) the same of every scalar, infinite where nothing is said to be usual."""
        out = np.full(len(units), np.inf)
        out[self._told] = self.deviations(units)
        return out

    def rarity(self, choices: Params) -> float:
        """Of all choices: the squared deviation of a scalar that is as unlikely."""
        return sum(self.rarities(choices))

    def rarities(self, choices: Params) -> list[float]:
        """The same of each of some choices."""
        return [table[choices[name]] for name, table in self._rarities.items() if name in choices]

    def log_ratio(self, name: str, value: Value, other: Value) -> float:
        """log(share of objects with one value of a choice / with another), 0 where nothing is usual."""
        table = self._rarities.get(name)
        return 0.0 if table is None else (table[other] - table[value]) / 2


def _in_range(scalar: Scalar) -> tuple[float, float]:
    """The usual value and its spread, as shares of the scalar's range."""
    assert scalar.usual is not None
    value, spread = scalar.usual
    low, high = max(value - spread, scalar.low), min(value + spread, scalar.high)
    # Where the range ends within the spread, the rest of it is as steep.
    reach = (scalar.unit_from_value(high) - scalar.unit_from_value(low)) * spread / max(high - low, 1e-9)
    return scalar.unit_from_value(value), max(reach, LEAST_SPREAD)


def _rarities(p: Choice | Integer | Flag) -> dict[Value, float]:
    """2 log(share of the commonest value / share) by value."""
    known = (1 - (p.usual or 0.0), p.usual or 0.0) if isinstance(p, Flag) else p.shares()
    shares = {p.grid_value(i): max(float(share), LEAST) for i, share in enumerate(known)}
    return {value: 2 * float(np.log(max(shares.values()) / share)) for value, share in shares.items()}
