"""The report's table of parameters: by groups, with ranges, real lengths and certainty; what does nothing is greyed."""

from __future__ import annotations

from html import escape
from typing import Any

from procmodels.export import Asset
from procmodels.space import Choice, Integer, Parameter, Scalar


def table(asset: Asset, values: dict[str, Any], sure: dict[str, Any]) -> str:
    """Name, value, where it lies in its range, and how sure it is: a band, or a share and the best rival.

    sure  what report.json says about certainty, by parameter
    """
    rows, active = [], asset.space.active(values)
    for group, parameters in asset.space.groups.items():
        if group:
            rows.append(f"<tr class=group><th colspan=3>{escape(group)}</th></tr>")
        for p in parameters:
            if p.name in active:
                rows.append(_row(p, values[p.name], asset.lengths.get(p.name), sure.get(p.name, {})))
            else:
                when = escape(spaced(str(p.only_if)))
                rows.append(f"<tr class=idle><th>{escape(spaced(p.name))}</th><td></td><td>only if {when}</td></tr>")
    return f"<table class=parameters>{''.join(rows)}</table>"


def bar(share: float, sure: tuple[float, float] | None = None) -> str:
    """A bar filled up to a share; `sure` marks where the value lies in nine of ten cases."""
    band = "" if sure is None else f'<u style="left:{100 * sure[0]:.1f}%;width:{100 * (sure[1] - sure[0]):.1f}%"></u>'
    return f'<span class=bar><i style="width:{100 * min(max(share, 0), 1):.1f}%"></i>{band}</span>'


def spaced(name: str) -> str:
    """A name for people; of paper/chair the last word."""
    return name.rpartition("/")[2].replace("_", " ")


def _row(p: Parameter, value: Any, metres: float | None, about: dict[str, Any]) -> str:
    if isinstance(p, Scalar):
        ends = [p.unit_from_value(float(about[k])) for k in ("low", "high")] if about else []
        band = (min(ends), max(ends)) if ends else None
        where = _ranged(p.unit_from_value(float(value)), f"{p.low:g}", f"{p.high:g}", band)
        length = "" if metres is None else f", {100 * metres:.1f} cm"
        shown = f"{value:.3f} <small>{escape(str(p.unit))}{length}</small>"
    elif isinstance(p, Integer):
        shown = str(value)
        where = _ranged((value - p.low) / max(p.high - p.low, 1), str(p.low), str(p.high))
    else:
        options = p.options if isinstance(p, Choice) else ("yes", "no")
        chosen = _plain(value) if not isinstance(p, Choice) else str(value)
        where = " ".join(f"<span class={'chosen' if o == chosen else 'other'}>{escape(o)}</span>" for o in options)
        shown = escape(chosen)
    if "chance" in about:
        where += f" <small>{100 * about['chance']:.0f} % sure, else {escape(_plain(about['rival']))}</small>"
    title = f' title="{escape(p.about)}"' if p.about else ""
    return f"<tr><th{title}>{escape(spaced(p.name))}</th><td>{shown}</td><td>{where}</td></tr>"


def _plain(value: Any) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else spaced(str(value))


def _ranged(share: float, low: str, high: str, sure: tuple[float, float] | None = None) -> str:
    return f"<span class=range><small>{low}</small>{bar(share, sure)}<small>{high}</small></span>"
