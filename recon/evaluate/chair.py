"""What the chair's issue promises, measured: the shipped photo set, six rendered ones, the network, time and memory."""

from __future__ import annotations

import json
import resource
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from tqdm import tqdm

from datasets.jobs import child
from datasets.photosets import Photoset, PhotosetOptions, read_photoset, render_photoset
from datasets.synthetic import SyntheticOptions, shape_params
from datasets.voxels import surface_grid
from nnproc.infer import grids_from_params, load_network, values_from_grids
from procmodels import Model, load
from procmodels.space import Params
from recon.evaluate.data.scenes import drawn_scene, misaligned, orbit, read_mask, true_scene
from recon.evaluate.metrics import chamfer, d_voxel
from recon.evaluate.rows import Row
from recon.fitting import refine, view_starts
from recon.geometry import align, visual_hull
from recon.geometry.raster import iou, silhouettes
from recon.scene import Cameras, Canonical, ReconstructionError, Scene, cam_from_canonical

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "datasets" / "samples" / "chair"
SETS = 6
SET_OPTIONS = PhotosetOptions(views=20, width=640, height=480, samples=8, up="z", front="-y")
HIDDEN_SEED = 20_261  # the six chairs' own generator: training draws from others


def run(work: Path, quick: bool) -> list[Row]:
    """All rows; `quick` leaves out the photo sets that have to be rendered first."""
    model = load("chair")
    rows = shipped_rows(model, work)
    rows += known_camera_rows(model, work, quick)
    if not quick:
        rows += photo_rows(model, work)
    rows += network_rows(model, 100 if quick else 300)
    card = json.loads(model.weights.with_suffix(".json").read_text())
    return [*rows, Row("training, minutes", card["minutes"], "<= 90")]


def reconstruct(photos: Path, out: Path) -> dict[str, Any]:
    """Run the command itself in a process of its own, from nothing; its report, with `peak_gb` added."""
    asked = [str(photos.resolve()), "--class", "chair", "--out", str(out.resolve()), "--force"]
    process = child.start("recon", *asked, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    said = process.communicate()[1]
    if process.returncode:
        raise ReconstructionError(f"{photos}: the command ended with {process.returncode}: {said[-2000:]}")
    report = json.loads((out / "report.json").read_text())
    report["peak_gb"] = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    return report


def shipped_rows(model: Model, work: Path) -> list[Row]:
    """The shipped set, photos only in; the ground truth scores and does nothing else."""
    truth, out = read_photoset(SHIPPED), work / "shipped"
    report = reconstruct(SHIPPED / "photos", out)
    true_masks = {n: read_mask(p) for n, p in zip(truth.names, truth.masks, strict=True)}
    found = {p.stem: read_mask(p) for p in (out / "masks").glob("*.png")}
    mask_iou = [iou(found[Path(n).stem], m) for n, m in true_masks.items() if Path(n).stem in found]
    shape, cameras, canonical = read_result(model, out)
    drawn = silhouettes(shape, cameras.K, cam_from_canonical(cameras, canonical), cameras.sizes)
    outline_iou = [iou(d, true_masks[n]) for d, n in zip(drawn, cameras.names, strict=True)]
    seconds = report["seconds"]
    return [
        Row("shipped: photos registered, share", report["registered"]["n"] / report["registered"]["of"], ">= 0.9"),
        Row("shipped: GrabCut masks, mean IoU with true masks", float(np.mean(mask_iou)), ">= 0.9"),
        Row("shipped: result, mean IoU with true masks", float(np.mean(outline_iou)), ">= 0.85"),
        Row("shipped: front direction right", float(abs(misaligned(truth, cameras, canonical).yaw) < 45), ">= 1"),
        Row("shipped: D_chamfer", chamfer(shape.to_trimesh(), trimesh.load_mesh(truth.mesh)), "<= 0.0035"),
        Row("shipped: whole command, s", seconds["total"], "<= 150"),
        Row("shipped: fit + refine, s", seconds["fit"] + seconds["refine"], "<= 20"),
        Row("shipped: peak memory, GB", report["peak_gb"], "<= 4"),
    ]


def hidden_params(model: Model) -> list[Params]:
    """The six chairs: off-grid, never seen in training."""
    return [model.space.sample(np.random.default_rng([HIDDEN_SEED, i])) for i in range(SETS)]


def rendered_sets(model: Model, work: Path) -> list[tuple[Params, Photoset]]:
    """The six chairs' photo sets, rendered once (about two minutes each) and kept below `work`."""
    sets = []
    for i, params in enumerate(hidden_params(model)):
        folder = work / f"own_{i}"
        if not (folder / "truth" / "cameras.json").is_file():
            work.mkdir(parents=True, exist_ok=True)
            mesh = work / f"own_{i}.ply"
            model.build(params).to_trimesh().export(mesh)
            render_photoset(mesh, folder, replace(SET_OPTIONS, seed=i))
        sets.append((params, read_photoset(folder)))
    return sets


def photo_rows(model: Model, work: Path) -> list[Row]:
    """Photos only, six sets of our own chairs. A set that cannot be reconstructed counts as wrong in everything."""
    right, errors, distances = 0, [], []
    for i, (params, truth) in enumerate(tqdm(rendered_sets(model, work), desc="photo sets", disable=None)):
        try:
            reconstruct(truth.photos[0].parent, work / f"result_{i}")
            shape, _, _ = read_result(model, work / f"result_{i}")
            found = _params(model, work / f"result_{i}")
        except ReconstructionError as error:
            tqdm.write(str(error))
            errors.append(1.0)
            distances.append(1.0)
            continue
        right += _discrete_right(model, found, params)
        errors.append(_scalar_error(model, found, params))
        distances.append(chamfer(shape.to_trimesh(), model.build(params).to_trimesh()))
    return [
        Row("own chairs, photos only: sets with every discrete parameter right, of 6", right, ">= 5"),
        Row("own chairs, photos only: scalar error, share of range", float(np.mean(errors)), "<= 0.05"),
        Row("own chairs, photos only: D_chamfer", float(np.mean(distances)), "<= 0.0015"),
    ]


def known_camera_rows(model: Model, work: Path, quick: bool) -> list[Row]:
    """True masks and cameras given. Quick: the masks are drawn from the same six chairs instead of rendered."""
    if quick:
        cameras, place = orbit(24)
        scenes = [(p, drawn_scene(model.build(p), cameras, place)) for p in hidden_params(model)]
    else:
        scenes = [(p, true_scene(t)) for p, t in rendered_sets(model, work)]
    right, errors, distances = 0, [], []
    for params, scene in tqdm(scenes, desc="known cameras", disable=None):
        refined = from_silhouettes(model, scene)
        right += _discrete_right(model, refined.params, params)
        errors.append(_scalar_error(model, refined.params, params))
        shape = model.build(refined.params)
        distances.append(chamfer(shape.to_trimesh(), model.build(params).to_trimesh()))
    floor = np.mean([chamfer(model.build(p).to_trimesh(), model.build(p).to_trimesh()) for p, _ in scenes])
    return [
        Row("own chairs, true masks and cameras: sets with every discrete parameter right, of 6", right, ">= 6"),
        Row("own chairs, true masks and cameras: scalar error, share of range", float(np.mean(errors))),
        Row("own chairs, true masks and cameras: D_chamfer", float(np.mean(distances)), "<= 0.0006"),
        Row("own chairs: floor of D_chamfer", float(floor)),
    ]


def from_silhouettes(model: Model, scene: Scene) -> refine.Refined:
    """The stages after the photographs: align, hull, fit, refine. Where the object stands is not taken as known."""
    found = scene.standing(align.run(scene.poses, scene.silhouettes))
    return refine.run(model, found, view_starts.run(model, found, visual_hull.run(found)))


def network_rows(model: Model, shapes: int) -> list[Row]:
    """Held-out on-grid shapes: Task 1, Task 2 and the accuracy of its parameters."""
    options = SyntheticOptions()
    truth = [shape_params(model, "test_on", i, options) for i in range(shapes)]
    built = [model.build(p) for p in truth]
    grids = np.stack([surface_grid(s.vertices(), s.triangles()) for s in built])
    network = load_network(model.space, model.weights)
    vectors = network.codec.vectors(truth)
    values = values_from_grids(network, grids)
    meshes = [s.to_trimesh() for s in built]
    found = [model.build(p).to_trimesh() for p in network.codec.params(values)]
    forward = []
    if network.has_decoder:
        wrong = d_voxel(grids_from_params(network, vectors), grids)
        forward.append(Row(f"network, {shapes} held-out on-grid: Task 1 D_voxel, %", wrong, "<= 0.15"))
    return [
        *forward,
        Row(
            "network: Task 2 D_chamfer",
            float(np.mean([chamfer(a, b) for a, b in zip(found, meshes, strict=True)])),
            "<= 0.0002",
        ),
        Row("network: floor of D_chamfer", float(np.mean([chamfer(m, m) for m in meshes]))),
        Row("network: discrete accuracy", network.codec.discrete_accuracy(values, vectors), ">= 0.99"),
        Row("network: scalar error, share of range", float(network.codec.scalar_error(values, vectors).mean())),
    ]


def _params(model: Model, out: Path) -> Params:
    values = json.loads((out / "report.json").read_text())["params"]
    return model.space.validate(values)


def read_result(model: Model, out: Path) -> tuple[Any, Cameras, Canonical]:
    """A finished run's shape, cameras and place, read from what it wrote."""
    params = json.loads((out / "params.json").read_text())
    frames = json.loads((out / "cameras" / "transforms.json").read_text())
    canonical = Canonical(np.array(params["world_from_canonical"]))
    flip = np.diag([1.0, -1, -1, 1])  # nerfstudio's cameras look along -z with y up
    views = frames["frames"]
    K = np.array(
        [[[v["fl_x"], 0, v["cx"]], [0, v["fl_y"], v["cy"]], [0, 0, 1]] for v in ({**frames, **f} for f in views)]
    )
    poses = np.stack([np.linalg.inv(np.array(v["transform_matrix"]) @ flip) for v in views])
    sizes = np.array([[v["w"], v["h"]] for v in ({**frames, **f} for f in views)])
    names = tuple(Path(v["file_path"]).name for v in views)
    return model.build(_params(model, out)), Cameras(names, K, poses, sizes), canonical


def _discrete_right(model: Model, found: Params, true: Params) -> bool:
    return all(found[p.name] == true[p.name] for p in model.space.discrete)


def _scalar_error(model: Model, found: Params, true: Params) -> float:
    """Mean over the scalars that are active in the truth, as a share of their ranges."""
    active = model.space.active(true)
    ends = [(s, float(found[s.name]), float(true[s.name])) for s in model.space.scalars if s.name in active]
    return float(np.mean([abs(s.unit_from_value(a) - s.unit_from_value(b)) for s, a, b in ends]))
