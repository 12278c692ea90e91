"""The results of a run as files, written whole or not at all.

Frames: mesh.glb, mesh.usdz and mesh.obj (Y up, or Z up when asked for) and model.blend (Z up) stand on the floor plane,
in metres when the height is known, otherwise with longest side 1; mesh.stl (Z up) is in millimetres. cameras/ is in the
world frame of structure from motion, and cameras/mesh.obj is the mesh in that frame. params.json holds the transforms.
"""

from __future__ import annotations

import json
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from procmodels import Model
from procmodels.export import Asset, export_glb, export_obj, save_blend
from procmodels.look import srgb
from procmodels.shape import Shape
from procmodels.space import Choice, Integer, Parameter, Scalar
from procmodels.stl import export_stl
from procmodels.usd import export_usd
from recon.fitting.uncertainty import LEVEL
from recon.outputs import camera_export, contact_sheet, point_tiles, publish, report
from recon.outputs.previews import render_previews
from recon.outputs.result import Result, about_size, in_place, seen
from recon.system.names import all_shown
from recon.system.whole_files import write_picture


@dataclass(frozen=True)
class OutputsOptions:
    """What is written, and how large the pictures are."""

    blender: bool = True  # write model.blend and mesh.usdz; everything else is written without
    obj_up: str = "y"  # axis of mesh.obj that points up: "y", which programs assume, or "z"
    renders: int = 3  # pictures of the result
    render_size: int = 480  # pixels, width and height of each
    thumbnail: int = 360  # pixels, width of a photo in the report


@dataclass(frozen=True)
class OutputPaths:
    """Where the results are; blend and usd are None when they were not asked for."""

    folder: Path
    glb: Path
    obj: Path
    stl: Path
    blend: Path | None
    usd: Path | None
    params_json: Path
    report_json: Path
    report_html: Path
    contact_sheet: Path
    cameras: Path
    masks: Path


def run(result: Result, out: Path, options: OutputsOptions, model: Model) -> OutputPaths:
    """Write all results into the folder `out`, replacing those of an earlier run and nothing else
    (recon.outputs.publish).

    A failure leaves the earlier results as they were. Raises InputError when the folder cannot be written,
    ReconstructionError when the disk is full.
    """
    started = time.monotonic()
    asset = asset_of(result, model)
    size = (options.render_size, options.render_size)
    with publish.replacing(out) as fresh, ThreadPoolExecutor(1) as pool:
        # While Blender writes the meshes.
        drawn = pool.submit(render_previews, asset.shape, options.renders, size, look=result.look)
        _write_meshes(fresh, asset, options)
        _write_json(fresh / "params.json", params_content(result, asset, options))
        if len(result.scene.cameras):
            camera_export.write(fresh / "cameras", result.scene.poses)
            export_obj(asset, fresh / "cameras" / "mesh.obj", world=True)
            _write_masks(fresh / "masks", result)
        renders = drawn.result()
        tiles = contact_sheet.tiles(result, asset.shape, options.thumbnail)
        if result.shape is not None:
            tiles += point_tiles.tiles(result.shape, asset.shape, options.renders, options.thumbnail)
        text = report.words(result, asset)
        sheet = contact_sheet.draw(tiles, renders, text.title, text.sentence)
        write_picture(fresh / "contact_sheet.png", cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
        facts = report_content(result, time.monotonic() - started)
        files = ["report.json", *(p.name + "/" * p.is_dir() for p in fresh.iterdir())]
        html = report.page(facts, text, asset, tiles, renders, files)
        (fresh / "report.html").write_text(html, encoding="utf-8")
        # Last: a results folder without a manifest is told by this file's time (recon.system.manifest).
        _write_json(fresh / "report.json", facts)
    return _paths(out, options)


def _certainty(result: Result) -> dict[str, Any]:
    """How sure each parameter is: an interval for scalars, for choices the chance of being right and the best rival."""
    if (sure := result.certainty) is None:
        return {}
    intervals = {n: {"low": round(low, 5), "high": round(high, 5)} for n, (low, high) in sure.intervals.items()}
    choices = {
        n: {"chance": round(c.chance, 3), "rival": c.rival, "behind": round(c.gap, 4)} for n, c in sure.choices.items()
    }
    return {"certainty": {"level": LEVEL, "params": {**intervals, **choices}}}


def report_content(result: Result, outputs_seconds: float) -> dict[str, Any]:
    """What report.json holds, names as they can be shown; mean_iou is over the used views, None without views."""
    used = result.scene.silhouettes.used
    reasons = dict(result.scene.silhouettes.reasons)
    views = [
        {"name": name, "iou": round(float(score), 4), "used": bool(use), "mask": source}
        | ({"reason": reasons[name]} if name in reasons else {})
        for name, score, use, source in zip(
            result.scene.silhouettes.names, result.view_iou, used, result.scene.silhouettes.source, strict=True
        )
    ]
    seconds = {**result.seconds, "outputs": round(outputs_seconds, 2)}
    content = {
        "class": result.class_name,
        "belongs": result.belongs,
        "classes": [{"class": name, "iou": round(score, 4)} for name, score in result.classes],
        "params": _plain(result.params),
        **_about_shape(result),
        "mean_iou": round(float(result.view_iou[used].mean()), 4) if used.any() else None,
        "confidence": round(result.confidence, 4),
        "explanation": result.explanation,
        **_certainty(result),
        "alternatives": _alternatives(result),
        "registered": {
            "n": in_place(result),
            "of": len(result.frames.names),
            "how": seen(result),
            "missing": list(result.scene.poses.unregistered),
            "misplaced": list(result.scene.silhouettes.misplaced),
            "unreadable": [{"name": name, "reason": reason} for name, reason in result.frames.skipped],
        },
        "size": about_size(result),
        "views": views,
        "warnings": list(result.warnings),
        "seconds": {**seconds, "total": round(sum(seconds.values()), 2)},
        "seed": result.seed,
        "versions": result.versions,
    }
    return all_shown(content)


def _about_shape(result: Result) -> dict[str, Any]:
    """What is said about an input that is a shape."""
    if (met := result.shape) is None:
        return {}
    about = {"kind": met.kind, "what": met.what, "stands": met.stands, "points": len(met.points)}
    return {"input": about, "distance": round(met.distance, 6)}


def _alternatives(result: Result) -> list[dict[str, Any]]:
    """Other answers, best first, by what the input is compared by: agreement of outlines, or distance."""
    if result.shape is not None:
        return [{"what": what, "distance": round(d, 6)} for what, d in result.shape.alternatives]
    return [{"what": what, "iou": round(score, 4)} for what, score in result.alternatives]


def params_content(result: Result, asset: Asset, options: OutputsOptions = OutputsOptions()) -> dict[str, Any]:
    """What params.json holds (docs/params.schema.json): values with ranges, and the transforms between the frames."""
    extent = np.ptp(asset.shape.bounds(), axis=0)
    metres = asset.metres_per_unit
    return {
        "class": result.class_name,
        "space_hash": asset.space.hash,
        "values": _plain(result.params),
        **_colours(asset),
        "parameters": {p.name: _parameter(p, asset) for p in asset.space.parameters},
        "canonical_frame": "X right, faces -Y, Z up, bounding box centred on the origin, longest side 1",
        "size_canonical": [round(float(x), 6) for x in extent],
        "world_from_canonical": result.scene.canonical.world_from_canonical.tolist(),
        "mesh_from_canonical": asset.mesh_from_canonical.tolist(),
        "obj_up": options.obj_up,
        "height_metres": result.height_m,
        "metres_per_canonical_unit": metres,
        "metres_per_sfm_unit": None if metres is None else metres / result.scene.canonical.scale,
        "size_metres": None if metres is None else [round(float(x) * metres, 6) for x in extent],
    }


def _colours(asset: Asset) -> dict[str, Any]:
    """Base colours of the parts, when these are known: sRGB as on the web."""
    if asset.look is None:
        return {}
    values = np.rint(255 * srgb(asset.look.colours)).astype(np.uint8)
    return {"colours": {p.name: f"#{v.tobytes().hex()}" for p, v in zip(asset.shape.parts, values, strict=True)}}


def _parameter(parameter: Parameter, asset: Asset) -> dict[str, Any]:
    about: dict[str, Any] = {"value": asset.params[parameter.name], "is": parameter.describe()}
    about |= {k: v for k, v in (("about", parameter.about), ("group", parameter.group)) if v}
    if parameter.only_if:
        about |= {"only_if": str(parameter.only_if), "active": parameter.name in asset.space.active(asset.params)}
    if isinstance(parameter, Scalar | Integer):
        about |= {"low": parameter.low, "high": parameter.high}
    if isinstance(parameter, Choice):
        about["options"] = list(parameter.options)
    if isinstance(parameter, Scalar):
        about["unit"] = str(parameter.unit)
        if parameter.name in asset.lengths:
            about["metres"] = asset.lengths[parameter.name]
    return _plain(about)


def asset_of(result: Result, model: Model) -> Asset:
    """The result's shape with what the files say about it; the given height is that of its extent along z."""
    shape: Shape = model.build(result.params)
    height = float(np.ptp(shape.bounds(), axis=0)[2])
    metres = None if result.height_m is None else result.height_m / height
    lengths = {} if metres is None else model.lengths(result.params, metres)
    world = result.scene.canonical.world_from_canonical
    return Asset(shape, model.space, result.params, metres, world, model.live_object, lengths, result.look)


def _write_meshes(folder: Path, asset: Asset, options: OutputsOptions) -> None:
    export_glb(asset, folder / "mesh.glb")
    export_obj(asset, folder / "mesh.obj", up=options.obj_up)
    export_stl(asset, folder / "mesh.stl")
    if options.blender:
        save_blend(asset, folder / "model.blend")
        export_usd(folder / "mesh.usdz")  # what save_blend left in Blender


def _write_masks(folder: Path, result: Result) -> None:
    """White = object; sizes and names as the images beside the cameras."""
    folder.mkdir()
    for stem, mask in zip(
        camera_export.stems(result.scene.silhouettes.names), result.scene.silhouettes.masks, strict=True
    ):
        write_picture(folder / f"{stem}.png", np.where(mask, 255, 0).astype(np.uint8))


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Numpy scalars as Python's own, which JSON knows."""
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in values.items()}


def _paths(out: Path, options: OutputsOptions) -> OutputPaths:
    return OutputPaths(
        folder=out,
        glb=out / "mesh.glb",
        obj=out / "mesh.obj",
        stl=out / "mesh.stl",
        blend=out / "model.blend" if options.blender else None,
        usd=out / "mesh.usdz" if options.blender else None,
        params_json=out / "params.json",
        report_json=out / "report.json",
        report_html=out / "report.html",
        contact_sheet=out / "contact_sheet.png",
        cameras=out / "cameras",
        masks=out / "masks",
    )
