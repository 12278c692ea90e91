"""The project as a library: one call from an input to a result, which is what the command says and writes.

result = recon.reconstruct("chair.obj", class_name="chair", height=0.92, out="results/chair")
result.params, result.confidence, result.shape().vertices()
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procmodels import load
from procmodels.shape import Shape
from procmodels.space import Params
from recon.pipelines import inputs
from recon.pipelines.inputs import Asked
from recon.pipelines.stages import Redo
from recon.system.progress import no_bars

Where = str | Path  # a file or a folder; relative ones are below the working directory


@dataclass(frozen=True)
class Result:
    """What a reconstruction found out; `report` holds the rest.

    class_name            the procedural model's name, params its values
    belongs               False when the object is taken to be none of the class: the result is the nearest one
    confidence            0..1, with its explanation in words
    mean_iou              agreement of the outlines over the views that were used; None without views
    distance              D_chamfer to a shape that was given, canonical units squared; None for photos and masks
    world_from_canonical  (4, 4) float, where the shape stands: in the frame of the input's cameras or of its file
    size                  (3,) float, width, depth and height: in metres when `height` was given, else canonical units
    warnings              what a person should know, one sentence each
    folder                where the files are (README.md lists them), None when none were kept
    report                the content of report.json
    model                 what procmodels.load takes to get the model: a class, or the path of its file
    """

    class_name: str
    params: Params
    belongs: bool
    confidence: float
    explanation: str
    mean_iou: float | None
    distance: float | None
    world_from_canonical: np.ndarray
    size: np.ndarray
    warnings: tuple[str, ...]
    folder: Path | None
    report: dict[str, Any]
    model: str

    def shape(self) -> Shape:
        """The object as named parts in the canonical frame. Raises ModelError when the model's file is gone."""
        return load(self.model).build(self.params)


def reconstruct(
    path: Where,
    class_name: str = "chair",
    *,
    out: Where | None = None,
    height: float | None = None,
    seed: int = 0,
    input: str | None = None,
    up: str | None = None,
    front: str | None = None,
    masks: Where | None = None,
    mask: Where | None = None,
    box: Sequence[float] | None = None,
    pix3d: Where | None = None,
    camera_off: float | None = None,
    cameras: Where | None = None,
    allow_outside: bool = False,
    turntable: bool = False,
    intrinsics: Sequence[float] | None = None,
    focal_mm: float | Sequence[float] | None = None,
    frames: int | None = None,
    force: bool = False,
    start: str | None = None,
) -> Result:
    """Reconstruct the object in `path`: photos, a video, one image, masks, a mesh, a point cloud, a splat, voxels.

    class_name  a model's name, "auto", or the path of a model's .py file, which is code that runs
    out         folder of the results, with all that makes a second call go on from finished stages; None keeps none
    height      of the object, in metres
    box         x, y, width, height in pixels of the upright image
    intrinsics  fx, fy, cx, cy in pixels of the original photos
    focal_mm    focal length, or that and the sensor's width, in mm
    force       compute every stage again, or those from `start` on
    The others are the command's flags of the same names (docs/inputs.md).

    Nothing is printed. Raises recon.InputError for what cannot be used, recon.ReconstructionError when the input is
    fine but no result could be made; messages name flags as the command has them.
    """
    with ExitStack() as stack:
        stack.enter_context(no_bars())
        folder = Path(out) if out is not None else Path(stack.enter_context(tempfile.TemporaryDirectory())) / "out"
        asked = Asked(
            source=Path(path),
            out=folder,
            class_name=class_name,
            height=height,
            seed=seed,
            input=input,
            redo=Redo(force, start),
            up=up,
            front=front,
            masks=_path(masks),
            mask=_path(mask),
            box=_listed(box),
            pix3d=_path(pix3d),
            camera_off=camera_off,
            cameras=_path(cameras),
            allow_outside=allow_outside,
            turntable=turntable,
            intrinsics=_listed(intrinsics),
            focal_mm=_listed([focal_mm] if isinstance(focal_mm, int | float) else focal_mm),
            frames=frames,
        )
        return run(asked, kept=out is not None)


def run(asked: Asked, kept: bool = True) -> Result:
    """What `reconstruct` does, for what was asked in the command's words; `kept` says whether asked.out stays."""
    inputs.check(asked)
    return read(inputs.run(asked).folder, asked.class_name, kept)


def read(folder: Path, class_name: str, kept: bool = True) -> Result:
    """The result that lies in a folder; `class_name` is what was asked for, which may be the path of a model's file."""
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    params = json.loads((folder / "params.json").read_text(encoding="utf-8"))
    return Result(
        class_name=report["class"],
        params=report["params"],
        belongs=report["belongs"],
        confidence=report["confidence"],
        explanation=report["explanation"],
        mean_iou=report["mean_iou"],
        distance=report.get("distance"),
        world_from_canonical=np.array(params["world_from_canonical"], float),
        size=np.array(params["size_metres"] or params["size_canonical"], float),
        warnings=tuple(report["warnings"]),
        folder=folder if kept else None,
        report=report,
        model=str(Path(class_name).absolute()) if class_name.endswith(".py") else report["class"],
    )


def _path(given: Where | None) -> Path | None:
    return None if given is None else Path(given)


def _listed(numbers: Sequence[float] | None) -> str | None:
    """Numbers as the command takes them, "1,2.5"; their count is checked there."""
    return None if numbers is None else ",".join(str(float(n)) for n in numbers)
