"""index.html: every object of a batch at a glance, sorted as one likes. It opens from the disk and needs no network."""

from __future__ import annotations

from collections import Counter
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from recon.batch.one import DONE
from recon.outputs.report_css import CSS
from recon.system.names import shown
from recon.system.whole_files import write_bytes

_STYLE = """
.tools { display: flex; flex-wrap: wrap; gap: 12px 28px; margin: 1.4rem 0; position: sticky; top: 0; padding: .6rem 0;
  background: #faf9f6; }
.tools label { color: var(--faint); }
select, input { font: inherit; padding: .2em .4em; border: 1px solid var(--line); border-radius: 4px; background: #fff;
  color: inherit; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(250px, 1fr)); gap: 20px 16px; }
.card { content-visibility: auto; contain-intrinsic-size: 250px 200px; }
.card a { text-decoration: none; }
.card b { font-weight: 600; }
.card p { margin: .2rem 0 0; font-size: .9rem; color: var(--faint); overflow-wrap: anywhere; }
.wrong { background: #fdf1dc; border-left: 4px solid #d9962b; border-radius: 4px; padding: .6rem .9rem; }
.line { display: flex; justify-content: space-between; gap: .8rem; margin-top: .3rem; }
.line span { overflow: hidden; text-overflow: ellipsis; white-space: nowrap; }
"""
_SCRIPT = """
const cards = [...document.querySelectorAll(".card")], box = document.querySelector(".cards");
const [order, find, status] = ["order", "find", "status"].map(id => document.getElementById(id));
const numbers = { surest: ["confidence", -1], unsurest: ["confidence", 1], best: ["fit", 1], slowest: ["seconds", -1] };
function show() {
  const [key, sign] = numbers[order.value] || [order.value, 0], words = find.value.toLowerCase();
  const value = card => card.dataset[key] === "" ? Infinity : sign * card.dataset[key];
  const listed = (a, b) => a.dataset.number - b.dataset.number;
  const sorted = [...cards].sort((a, b) => sign ? value(a) - value(b) || listed(a, b)
    : key === "name" ? a.dataset.name.localeCompare(b.dataset.name, undefined, { numeric: true }) : listed(a, b));
  const wanted = card => card.textContent.toLowerCase().includes(words)
    && (!status.value || card.dataset.status === status.value);
  for (const card of sorted) card.hidden = !wanted(card);
  box.append(...sorted);
}
for (const tool of [order, find, status]) tool.addEventListener("input", show);
show();
"""
_ORDERS = {
    "listed": "as listed",
    "unsurest": "least sure first",
    "surest": "surest first",
    "best": "best agreement first",
    "slowest": "slowest first",
    "name": "by name",
}


def write(rows: list[dict[str, Any]], out: Path, listed: int) -> None:
    """The page of the objects so far, of `listed` in all. Raises OSError."""
    counts = Counter(row["status"] for row in rows)
    told = ", ".join(f"{n} {status}" for status, n in sorted(counts.items()))
    left = f"; {listed - len(rows)} still to come" if listed > len(rows) else ""
    orders = "".join(f"<option value={key}>{text}</option>" for key, text in _ORDERS.items())
    states = "".join(f'<option value="{escape(s)}">{escape(s)}</option>' for s in sorted(counts))
    body = [
        f"<header><h1>{len(rows)} object{'s' * (len(rows) != 1)}</h1><p class=lead>{escape(told)}{left}. ",
        '<a href="table.csv">table.csv</a> and <a href="table.json">table.json</a> hold all values.</p></header>',
        f"<div class=tools><label>Order <select id=order>{orders}</select></label>",
        f"<label>Show <select id=status><option value=''>all</option>{states}</select></label>",
        "<label>Find <input id=find type=search></label></div>",
        f"<div class=cards>{''.join(_card(i, row) for i, row in enumerate(rows))}</div>",
    ]
    html = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{len(rows)} objects</title><style>{CSS}{_STYLE}</style></head>\n<body>"
        + "\n".join(body)
        + f"<script>{_SCRIPT}</script></body></html>\n"
    )
    write_bytes(out / "index.html", html.encode())


def _card(number: int, row: dict[str, Any]) -> str:
    """An object: its picture and what is known of it, or what was wrong with it."""
    name, status = escape(shown(row["name"])), escape(row["status"])
    done = row["status"] == DONE
    sure = row["confidence"] if done else None
    apart = _apart(row) if done else None
    data = {"number": number, "name": name, "status": status, "confidence": _said(sure), "fit": _said(apart)}
    data["seconds"] = _said(row.get("seconds"))
    told = " ".join(f'data-{key}="{value}"' for key, value in data.items())
    head = f"<div class='card{'' if done else ' wrong'}' {told}>"
    if not done:
        error, given = (escape(shown(row[key])) for key in ("error", "input"))
        return f"{head}<b>{name}</b> {status}<p>{error}</p><p>{given}</p></div>"
    noun = row["class"].rpartition("/")[2]
    what = noun if row["belongs"] else f"no {noun}: the nearest one"
    warned = f"<p>{len(row['warnings'])} warning{'s' * (len(row['warnings']) > 1)}</p>" if row["warnings"] else ""
    link, picture = (quote(part.format(row["name"])) for part in ("{}/report.html", "thumbs/{}.jpg"))
    return (
        f'{head}<a href="{link}"><img loading=lazy width=480 height=240 src="{picture}" alt="{name}">'
        f"<span class=line><span title='{name}'>{name}</span><b>{sure:.2f}</b></span></a>"
        f"<p>{escape(what)}, {_agreement(row)}</p>{warned}</div>"
    )


def _agreement(row: dict[str, Any]) -> str:
    if row["distance"] is not None:
        return f"surfaces {100 * (row['distance'] / 2) ** 0.5:.1f} % apart"
    return "no view used" if row["mean_iou"] is None else f"outlines agree by {row['mean_iou']:.2f}"


def _apart(row: dict[str, Any]) -> float | None:
    """How badly the result explains the input, 0 is perfect."""
    if row["distance"] is not None:
        return float((row["distance"] / 2) ** 0.5)
    return None if row["mean_iou"] is None else 1 - row["mean_iou"]


def _said(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
