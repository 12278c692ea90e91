"""When a parameter does something: conditions on the values of other parameters, declared beside it.

    Integer("back_bars", 1, 8, only_if=when("back").among("hbars", "vbars"))
    Scalar("cushion", 0, 0.2, 5, only_if=when("seat").not_("none") & when("soft").is_(True))

A condition asks about parameters that are active themselves: where one is not, what is said of it does not hold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

AMONG, NOT, ABOVE, BELOW = "among", "not", "above", "below"


class Condition(Protocol):
    """A statement about the values of parameters; `&` and `|` join two of them."""

    @property
    def names(self) -> frozenset[str]:
        """The parameters that it asks about."""

    def evaluate(self, holds: Callable[[Comparison], Any]) -> Any:
        """Whether it holds, given what answers single comparisons: by bools, or by arrays of them."""

    def comparisons(self) -> tuple[Comparison, ...]:
        """The single comparisons in it, from left to right."""

    def __and__(self, other: Condition) -> Condition: ...
    def __or__(self, other: Condition) -> Condition: ...


class _Joins:
    """What all conditions share."""

    def __and__(self: Any, other: Condition) -> Condition:
        return Both(self, other)

    def __or__(self: Any, other: Condition) -> Condition:
        return Either(self, other)

    @property
    def names(self: Any) -> frozenset[str]:
        return frozenset(t.name for t in self.comparisons())


@dataclass(frozen=True)
class Comparison(_Joins):
    """One parameter's value compared with others: among them, none of them, above or below the one of them."""

    name: str
    relation: str
    values: tuple[Any, ...]

    def allows(self, value: Any) -> bool:
        """Whether a value of the parameter passes."""
        if self.relation == ABOVE:
            return bool(value > self.values[0])
        if self.relation == BELOW:
            return bool(value < self.values[0])
        return (value in self.values) == (self.relation == AMONG)

    def evaluate(self, holds: Callable[[Comparison], Any]) -> Any:
        return holds(self)

    def comparisons(self) -> tuple[Comparison, ...]:
        return (self,)

    def __str__(self) -> str:
        verb = {AMONG: "is", NOT: "is not", ABOVE: "is above", BELOW: "is below"}[self.relation]
        said = [
            "yes" if v is True else "no" if v is False else f"{v:g}" if isinstance(v, float) else str(v)
            for v in self.values
        ]
        return f"{self.name} {verb} {' or '.join(said)}"


@dataclass(frozen=True)
class _Pair(_Joins):
    first: Condition
    second: Condition

    def comparisons(self) -> tuple[Comparison, ...]:
        return self.first.comparisons() + self.second.comparisons()


@dataclass(frozen=True)
class Both(_Pair):
    """Holds where two conditions do."""

    def evaluate(self, holds: Callable[[Comparison], Any]) -> Any:
        return self.first.evaluate(holds) & self.second.evaluate(holds)

    def __str__(self) -> str:
        return " and ".join(f"({c})" if isinstance(c, Either) else str(c) for c in (self.first, self.second))


@dataclass(frozen=True)
class Either(_Pair):
    """Holds where one of two conditions does."""

    def evaluate(self, holds: Callable[[Comparison], Any]) -> Any:
        return self.first.evaluate(holds) | self.second.evaluate(holds)

    def __str__(self) -> str:
        return f"{self.first} or {self.second}"


@dataclass(frozen=True)
class when:
    """The start of a condition on the parameter `name`."""

    name: str

    def among(self, *values: Any) -> Comparison:
        """Its value is one of these."""
        return Comparison(self.name, AMONG, values)

    def is_(self, value: Any) -> Comparison:
        """Its value is this one."""
        return Comparison(self.name, AMONG, (value,))

    def not_(self, *values: Any) -> Comparison:
        """It does something, and its value is none of these."""
        return Comparison(self.name, NOT, values)

    def above(self, value: float) -> Comparison:
        """Its value is a number greater than this one."""
        return Comparison(self.name, ABOVE, (value,))

    def below(self, value: float) -> Comparison:
        """Its value is a number less than this one."""
        return Comparison(self.name, BELOW, (value,))
