"""How large the object really is: as the user says, else as printed sheets tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from procmodels import Model
from procmodels.space import Params
from recon.scene import Canonical, InputError, PrintedSheet
from recon.sheet.layout import RULER

GIVEN, SHEET = "--height", "printed sheet"
DISAGREE = 0.03  # of the height: what is given and what the sheet tells may differ so much without a word
APART = 0.01  # of the size: two sheets that differ more are not printed alike
RULERS = (75.0, 300.0)  # mm, what the ruler of a sheet may measure


@dataclass(frozen=True)
class RealSize:
    """The object's height in metres, None when it is not known, who says so ("" for nobody), and warnings."""

    height: float | None = None
    source: str = ""
    warnings: tuple[str, ...] = ()


def check_ruler(ruler: float | None) -> None:
    """Raise InputError for a ruler (mm) that no print can have."""
    if ruler is not None and not RULERS[0] <= ruler <= RULERS[1]:
        raise InputError(
            f"--ruler is what the printed sheet's ruler of {RULER:.0f} mm measures, in mm, from {RULERS[0]:.0f} to "
            f"{RULERS[1]:.0f}; got {ruler:g}"
        )


def decide(
    given: float | None,
    ruler: float | None,
    sheets: tuple[PrintedSheet, ...],
    canonical: Canonical,
    model: Model,
    params: Params,
) -> RealSize:
    """The height of the shape where it stands.

    given  what the user says, metres; it wins
    ruler  what the sheets' ruler measures, mm; None: as it should
    """
    if not sheets:
        lost = "--ruler was given, but no printed sheet was found in the photos: lay it where two or more show it whole"
        return RealSize(given, GIVEN if given else "", (lost,) if ruler else ())
    units = float(np.ptp(model.build(params).bounds(), axis=0)[2]) * canonical.scale
    metres = metres_per_unit(sheets) * (1.0 if ruler is None else ruler / RULER)
    told, warnings = units * metres, _differing(sheets)
    if given is None:
        return RealSize(told, SHEET, tuple(warnings))
    if abs(told / given - 1) > DISAGREE:
        warnings.append(
            f"--height says {given:.3f} m and the printed sheet {told:.3f} m ({100 * (told / given - 1):+.1f} %): "
            f"--height is used. If the sheet was not printed at 100 % its ruler of {RULER:.0f} mm measures something "
            "else: give that with --ruler"
        )
    return RealSize(given, GIVEN, tuple(warnings))


def metres_per_unit(sheets: tuple[PrintedSheet, ...]) -> float:
    """Of an SfM unit: the sheets' mean, those that more photos show counting more."""
    weights = [len(s.names) for s in sheets]
    return float(np.exp(np.average([np.log(s.metres_per_unit) for s in sheets], weights=weights)))


def _differing(sheets: tuple[PrintedSheet, ...]) -> list[str]:
    scales = [s.metres_per_unit for s in sheets]
    if max(scales) / min(scales) - 1 <= APART:
        return []
    small, large = (sheets[int(pick(scales))] for pick in (np.argmin, np.argmax))
    return [
        f"the printed {small.name} and {large.name} tell sizes that differ by "
        f"{100 * (max(scales) / min(scales) - 1):.1f} %: measure their rulers, and leave out the one that is wrong"
    ]
