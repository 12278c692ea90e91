"""What the tool answers for a real object given as each kind of input, compared with the object itself.

Every answer is brought into the object's canonical frame, where D_chamfer is measured. How far the answer's front is
turned from the object's is kept beside it.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from procmodels import Model
from procmodels.space import Params
from recon.evaluate.chair import from_silhouettes
from recon.evaluate.data.true_views import all_round, one_view
from recon.evaluate.metrics import best_turn, chamfer, quarter_turned
from recon.evaluate.pix3d_dev import redrawn
from recon.files.recognise import Kind
from recon.fitting import shape_fit
from recon.fitting.camera_search import find
from recon.fitting.one_view import CameraSearchOptions, OneView
from recon.fitting.silhouette_bank import load_bank
from recon.geometry.raster import iou
from recon.geometry.view_geometry import guessed_K
from recon.shapes import shape_target
from recon.shapes.shape_target import ShapeOptions

# Files of other people are mostly Y-up and face +Z, as glTF asks; the tool is not told so.
FILE_FROM_CANONICAL = np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)], float)
SAME = 0.0008  # D_chamfer of an object with itself turned, below which that turn cannot be seen


@dataclass(frozen=True)
class Answer:
    """d_chamfer in the object's frame; turn is how many quarter turns the front is off; iou of outlines, where there
    are any; seconds of processor time."""

    params: Params
    d_chamfer: float
    turn: int
    iou: float | None
    seconds: float


def from_mesh(model: Model, mesh: trimesh.Trimesh, seed: int) -> Answer:
    """The mesh as a file of unknown up and front."""
    turned = trimesh.Trimesh(mesh.vertices @ FILE_FROM_CANONICAL.T, mesh.faces, process=False)
    return _from_shape(model, mesh, lambda file: turned.export(file), Kind.MESH, seed)


def from_points(count: int) -> Callable[[Model, trimesh.Trimesh, int], Answer]:
    """`count` points of its surface as a file of unknown up and front."""

    def answer(model: Model, mesh: trimesh.Trimesh, seed: int) -> Answer:
        points = np.asarray(trimesh.sample.sample_surface(mesh, count, seed=seed)[0]) @ FILE_FROM_CANONICAL.T
        return _from_shape(model, mesh, lambda file: trimesh.PointCloud(points).export(file), Kind.CLOUD, seed)

    return answer


def _from_shape(model: Model, mesh: trimesh.Trimesh, write: Callable[[Path], object], kind: str, seed: int) -> Answer:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "object.ply"
        write(file)
        started = time.process_time()
        target = shape_target.run(file, kind, kind, ShapeOptions(seed=seed))
        found = shape_fit.run(model, target, shape_fit.ShapeFitOptions(seed=seed))
        seconds = time.process_time() - started
    place = FILE_FROM_CANONICAL.T @ found.canonical.world_from_canonical[:3, :3]
    return Answer(found.params, *_compared(model, found.params, mesh, place), None, seconds)


def from_one_mask(known: bool) -> Callable[[Model, trimesh.Trimesh, int], Answer]:
    """One rendered silhouette, its camera known or not."""

    def answer(model: Model, mesh: trimesh.Trimesh, seed: int) -> Answer:
        mask, K, pose, azimuth = one_view(mesh, seed)
        view = OneView(mask, K, True, pose) if known else OneView(mask, guessed_K(mask.shape[1], mask.shape[0]))
        options = CameraSearchOptions()
        bank = load_bank(model, options.bank)
        started = time.process_time()
        found = find(model, view, bank, options)
        seconds = time.process_time() - started
        agreement = iou(mask, redrawn(model, found, mask.shape))
        if known:
            place = found.refined.canonical.world_from_canonical[:3, :3]
            return Answer(
                found.refined.params, *_compared(model, found.refined.params, mesh, place), agreement, seconds
            )
        # The camera's place says how the answer is turned against the object. Which shape it is, is another question,
        # so that the distance counts after the best quarter turn.
        turn = round((azimuth - found.azimuth) / 90) % 4
        best, _ = best_turn(model.build(found.refined.params).to_trimesh(), mesh)
        return Answer(found.refined.params, best, _visible(mesh, turn), agreement, seconds)

    return answer


def from_all_round(views: int) -> Callable[[Model, trimesh.Trimesh, int], Answer]:
    """Silhouettes from all round with known cameras; where the object stands and faces is found."""

    def answer(model: Model, mesh: trimesh.Trimesh, seed: int) -> Answer:
        scene = all_round(mesh, views, seed)
        started = time.process_time()
        refined = from_silhouettes(model, scene)
        seconds = time.process_time() - started
        place = np.linalg.inv(scene.canonical.world_from_canonical) @ refined.canonical.world_from_canonical
        compared = _compared(model, refined.params, mesh, place[:3, :3])
        return Answer(refined.params, *compared, refined.mean_iou, seconds)

    return answer


INPUTS: dict[str, Callable[[Model, trimesh.Trimesh, int], Answer]] = {
    "mesh": from_mesh,
    "500 points": from_points(500),
    "5000 points": from_points(5000),
    "1 mask, camera known": from_one_mask(True),
    "1 mask, camera unknown": from_one_mask(False),
    "4 masks": from_all_round(4),
    "24 masks": from_all_round(24),
}


def _compared(model: Model, params: Params, mesh: trimesh.Trimesh, turned: np.ndarray) -> tuple[float, int]:
    """D_chamfer of the answer where it stands, and its quarter turns; `turned` (3, 3) is object_from_answer, scaled."""
    rotation = turned / np.cbrt(abs(np.linalg.det(turned)))
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    built = model.build(params).to_trimesh().apply_transform(matrix)
    degrees = np.degrees(np.arctan2(rotation[1, 0], rotation[0, 0]))
    return chamfer(built, mesh), _visible(mesh, round(degrees / 90) % 4)


def _visible(mesh: trimesh.Trimesh, turn: int) -> int:
    """The turn, or 0 when the object looks the same after it: the front of a square table is nowhere."""
    return turn if turn and chamfer(quarter_turned(mesh, turn), mesh) > SAME else 0
