"""Units of parameters: what a number counts, and how long that is on an object whose real size is known.

A length counts either units of the model's own coordinates (the frame in which `build` returns parts, before the shape
is scaled to a longest side of 1) or fractions of another parameter that is a length.
"""

from __future__ import annotations

from dataclasses import dataclass

MODEL = "model"


@dataclass(frozen=True)
class Unit:
    """What a parameter's number counts.

    text  how it is said after a number: "of height", "degrees"
    of    for lengths, what 1 is as long as: MODEL, a unit of the model's coordinates, or a parameter's name; else None
    """

    text: str
    of: str | None = None

    def __str__(self) -> str:
        return self.text

    @property
    def is_length(self) -> bool:
        """Whether a value is as long as something, so that it can be said in centimetres."""
        return self.of is not None

    def say(self, value: float, metres: float | None = None) -> str:
        """The value for people; with `metres`, its real length, in centimetres too."""
        text = f"{value:.0f} {self}" if self == DEGREES else f"{value:.3g} {self}"
        return text if metres is None or not self.is_length else f"{text}, {100 * metres:.1f} cm"


def of_parameter(name: str, text: str | None = None) -> Unit:
    """Fractions of another parameter's length."""
    return Unit(text or "of " + name.replace("_", " "), name)


# Models whose own unit is the object's height, as most of the paper's.
OF_HEIGHT = Unit("of height", MODEL)
METRES = Unit("metres", MODEL)
DEGREES = Unit("degrees")
RATIO = Unit("ratio")
WIDE = Unit("ratio", MODEL)  # width beside a height of 1
SHARE = Unit("share")
