"""report.html: what a person reads first. One file that needs nothing from outside: styles and pictures are within."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from html import escape
from typing import Any

import cv2
import numpy as np

from procmodels.export import Asset
from procmodels.space import Choice, Flag, Integer, Parameter
from recon.outputs.contact_sheet import MASK_COLOUR, RESULT_COLOUR, Tile, colour_of
from recon.outputs.parameter_table import bar, spaced, table
from recon.outputs.report_css import CSS
from recon.outputs.result import Result, counted, seen, tried
from recon.system.names import shown

FILES = {
    "model.blend": "named parts, parameters as custom properties of the empty, Z up",
    "mesh.glb": "glTF for viewers and game engines, Y up",
    "mesh.usdz": "USD for phones (augmented reality) and other programs, Y up",
    "mesh.obj": "Wavefront OBJ with quads and n-gons, Y up, which readers assume (--obj-up z: Z up)",
    "mesh.stl": "for printers and CAD: closed, in millimetres where the size is known, Z up",
    "mesh.mtl": "its materials: a colour a part, from the input",
    "texture.jpg": "its texture, also inside model.blend and mesh.glb",
    "params.json": "parameter values with ranges, and the transforms between the frames",
    "contact_sheet.png": "every photo with both outlines, on one page",
    "cameras/": "COLMAP model (sparse/0), nerfstudio's transforms.json, undistorted images, the mesh in their frame",
    "masks/": "white = object, for the images in cameras/images",
    "report.json": "this report for programs",
}


@dataclass(frozen=True)
class Words:
    """The result in plain language."""

    title: str
    sentence: str


def words(result: Result, asset: Asset) -> Words:
    """A heading and one or two sentences: what it is, how large, from how many photos, how well it fits."""
    values = result.params
    active = asset.space.active(values)
    traits = [t for p in asset.space.parameters if p.name in active and (t := _trait(p, values[p.name]))]
    article = _article(result.class_name)
    what = f"{article} {spaced(result.class_name)}" + (f" with {_listed(traits)}" if traits else "")
    used, given = int(result.scene.silhouettes.used.sum()), len(result.frames.names)
    text = f"{what}; {_size(asset, result.size_from)}. "
    title = spaced(result.class_name).capitalize()
    if not result.belongs:
        title = f"Not {article.lower()} {spaced(result.class_name)}: the nearest one"
        nearest = text[0].lower() + text[1:]
        text = f"This is probably no {spaced(result.class_name)}. The nearest that can be made: {nearest}"
    if used:
        score = float(result.view_iou[result.scene.silhouettes.used].mean())
        how = (
            f"{used} of {counted(result)} used; mean outline" if given > 1 else f"{seen(result).capitalize()}; outline"
        )
        text += f"{how} agreement {score:.2f}: {verdict(score)}."
    if (met := result.shape) is not None:
        apart = 100 * (met.distance / 2) ** 0.5
        text += f"Fitted to {met.what}, {met.stands}; the surfaces are {apart:.1f} % of the longest side apart."
        return Words(shown(f"{title} from {met.what}"), shown(text))
    if result.classes:
        text += f" No class was named: {tried(result.classes)}."
    return Words(shown(f"{title} from {counted(result)}"), shown(text.strip()))


def _article(name: str) -> str:
    return "An" if name[0] in "aeiou" else "A"


def verdict(iou: float) -> str:
    """A mean outline agreement in words."""
    if iou >= 0.9:
        return "very good"
    if iou >= 0.8:
        return "good"
    return "fair, look at the weakest photos below" if iou >= 0.65 else "poor, do not rely on this result"


def page(
    facts: dict[str, Any], text: Words, asset: Asset, tiles: list[Tile], renders: list[np.ndarray], files: list[str]
) -> str:
    """The HTML. `facts` is the content of report.json."""
    ranked = sorted(tiles, key=lambda t: (not t.used, -(t.iou or 0)))
    confidence = facts["confidence"]
    sure = facts.get("certainty", {}).get("params", {})
    heading = "The image" if facts["registered"]["of"] == 1 else "Views, best first"
    heading = "Input, from the same sides" if "input" in facts else heading
    body = [
        f"<header><h1>{escape(text.title)}</h1><p class=lead>{escape(text.sentence)}</p></header>",
        f"<div class=renders>{''.join(_picture(r, f'result, view {i + 1}', 92) for i, r in enumerate(renders))}</div>",
        f"<p class=confidence><b>Confidence {confidence:.2f}</b> {bar(confidence)} {escape(facts['explanation'])}</p>",
        _warnings(facts),
        "<div class=columns>",
        f"<section><h2>Parameters</h2>{table(asset, facts['params'], sure)}</section>",
        f"<section><h2>Files</h2>{_files(files, facts['versions'])}{_alternatives(facts)}</section>",
        "</div>",
        f"<section><h2>{heading}</h2>{_legend(facts)}",
        f"<div class=views>{''.join(map(_view, ranked))}</div></section>",
        f"<div class=columns><section><h2>Seconds</h2>{_seconds(facts['seconds'])}</section>",
        f"<section><h2>Versions</h2>{_versions(facts)}</section></div>",
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(text.title)}</title><style>{CSS}</style></head>\n<body>" + "\n".join(body) + "</body></html>\n"
    )


def _trait(parameter: Parameter, value: Any) -> str:
    name = spaced(parameter.name)
    if isinstance(parameter, Choice) and parameter.said:
        return parameter.said[parameter.options.index(value)]
    if isinstance(parameter, Choice):
        return f"no {name}" if value == "none" else f"{spaced(str(value))} {name}"
    if isinstance(parameter, Integer):
        return f"{value} {name}"
    return (name if value else f"no {name}") if isinstance(parameter, Flag) else ""


def _size(asset: Asset, source: str = "") -> str:
    wide, deep, high = np.ptp(asset.shape.bounds(), axis=0) * (asset.metres_per_unit or 1.0)
    if asset.metres_per_unit is not None:
        known = f" (by the {source})" if source and not source.startswith("--") else ""
        return f"{wide:.2f} m wide, {deep:.2f} m deep, {high:.2f} m high{known}"
    return (
        f"{wide / high:.2f} times as wide and {deep / high:.2f} times as deep as high (real size not known: give "
        "--height, or lay a printed sheet beside it)"
    )


def _warnings(facts: dict[str, Any]) -> str:
    items = list(facts["warnings"])
    if missing := facts["registered"]["missing"]:
        why = "too blurred, too plain, or too far from the others; more photos in between help"
        items.append(f"no camera was found for {_listed(missing)}: {why}")
    items += [f"{u['name']} could not be read: {u['reason']}" for u in facts["registered"]["unreadable"]]
    items += [f"{v['name']} was left out: {v['reason']}" for v in facts["views"] if v.get("reason")]
    if not items:
        return "<p class=fine>No warnings.</p>"
    return f"<section class=warnings><h2>Warnings</h2><ul>{''.join(f'<li>{escape(i)}' for i in items)}</ul></section>"


def _view(tile: Tile) -> str:
    red, green, blue = colour_of(tile)
    score = "" if tile.iou is None else f"{tile.iou:.3f}"
    note = f"<em>{escape(tile.note)}</em>" if tile.note else ""
    return (
        f"<figure class={'used' if tile.used else 'unused'}>{_picture(tile.image, tile.name, 82)}"
        f'<figcaption><span title="{escape(tile.name)}">{escape(tile.name)}</span>'
        f'<b style="color:rgb({red},{green},{blue})">{score}</b>{note}</figcaption></figure>'
    )


def _picture(image: np.ndarray, text: str, quality: int) -> str:
    ok, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not ok:
        raise ValueError(f"cannot encode the picture {text!r}")
    height, width = image.shape[:2]
    source = "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()
    return f'<img src="{source}" width={width} height={height} alt="{escape(text)}">'


def _legend(facts: dict[str, Any]) -> str:
    if "input" in facts:
        return ""
    drawn = "outline of the result; filled where the two differ"
    pairs = ((MASK_COLOUR, "outline found in the photo"), (RESULT_COLOUR, drawn))
    keys = [f'<span><i style="background:rgb{c}"></i>{t}</span>' for c, t in pairs]
    return f"<p class=legend>{''.join(keys)}<span>number: intersection over union, 1 is perfect</span></p>"


def _files(files: list[str], versions: dict[str, str]) -> str:
    told = FILES | {"model.blend": f"{_written_by(versions.get('bpy', ''))}: {FILES['model.blend']}"}
    items = [
        f'<dt><a href="{escape(f)}">{escape(f)}</a></dt><dd>{escape(about)}</dd>'
        for f, about in told.items()
        if f in files
    ]
    return f"<dl class=files>{''.join(items)}</dl>"


def _written_by(blender: str) -> str:
    """Which Blender wrote a file, and how older ones get at it."""
    if not blender.startswith("5."):
        return f"Blender {blender}".strip()
    return (
        f"Blender {blender}, opens in 5.0 and later, and in 4.5 LTS, which can save it for older ones; 4.2 LTS takes "
        "mesh.usdz or mesh.glb"
    )


def _alternatives(facts: dict[str, Any]) -> str:
    if not (others := facts["alternatives"][:8]):
        return ""
    heading, key, digits = ("Runners-up, by distance", "distance", 4) if "input" in facts else ("Runners-up", "iou", 3)
    rows = [f"<tr><th>{escape(o['what'])}</th><td>{o[key]:.{digits}f}</td></tr>" for o in others]
    return f"<h2>{heading}</h2><table>{''.join(rows)}</table>"


def _seconds(seconds: dict[str, float]) -> str:
    total = max(seconds["total"], 1e-9)
    rows = []
    for stage, value in seconds.items():
        share = bar(value / total) if stage != "total" else ""
        rows.append(f"<tr><th>{escape(stage)}</th><td>{value:.1f}</td><td>{share}</td></tr>")
    return f"<table class=seconds>{''.join(rows)}</table>"


def _versions(facts: dict[str, Any]) -> str:
    pairs = {**facts["versions"], "seed": facts["seed"]}
    rows = [f"<tr><th>{escape(name)}</th><td>{escape(str(v))}</td></tr>" for name, v in pairs.items()]
    return f"<table>{''.join(rows)}</table>"


def _listed(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
