"""Answers for labelled real objects, things of other kinds and the class's own shapes, from every kind of input.

Every object that was looked at is a row in the work folder at once; a run that is started again goes on from there.
"""

from __future__ import annotations

import logging
import tempfile
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from tqdm import tqdm

from datasets import part_labels
from datasets.catalogue_object import DataError, RealObject
from datasets.part_labels import Seen
from nnproc import outline_net
from nnproc.infer import WeightsError, load_network
from nnproc.learn_outlines import part_of
from procmodels import Model
from procmodels.space import Params
from recon.evaluate.beliefs import rows
from recon.evaluate.beliefs.rows import OWN, BeliefRow
from recon.evaluate.calibration import worn
from recon.evaluate.chair import from_silhouettes
from recon.evaluate.data.scenes import read_mask
from recon.evaluate.data.true_views import all_round, one_view
from recon.files.recognise import Kind
from recon.fitting import quality, shape_fit
from recon.fitting.camera_search import find
from recon.fitting.evidence import Evidence
from recon.fitting.one_view import CameraSearchOptions, OneView
from recon.fitting.silhouette_bank import load_bank
from recon.fitting.uncertainty import Certainty
from recon.geometry.view_geometry import guessed_K
from recon.masks.single_mask import checked
from recon.scene import Cameras, Poses, ReconError, Scene, Silhouettes
from recon.shapes import shape_target
from recon.shapes.shape_target import ShapeOptions

log = logging.getLogger(__name__)
Found = tuple[Params, Certainty | None, Evidence]
POINTS = 2000  # of a cloud
GROWTH = 2  # px, masks are wrong by up to so many
BENT = 0.02  # of the longest side: an own shape is bent by up to so much, so that no answer fits it exactly
SIDES = (4, 16)  # fewest and most masks of a set
# Files of other people are mostly Y-up and face +Z, as glTF asks; the tool is not told so.
FILE_FROM_CANONICAL = np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)], float)


@dataclass(frozen=True)
class GatherOptions:
    """What is looked at."""

    data: tuple[Path, ...]  # catalogues and class folders that the labels name
    kinds: tuple[str, ...]
    labels: str = "chair"  # whose labels
    limit: int | None = None  # objects, by turns of the class, of others and own; all
    own: int = 40  # of the class's own shapes
    seed: int = 0
    work: Path = Path(".cache/evaluate")
    outlines: Path | None = None  # 0.safetensors, ...: networks of nnproc.learn_outlines --without; the shipped one


@dataclass(frozen=True)
class Thing:
    """One object; `load` reads its mesh, `mask` is a real picture's."""

    name: str
    word: str
    belongs: bool
    seen: Seen | None
    load: Callable[[], trimesh.Trimesh]
    mask: Path | None = None
    params: Params | None = None  # of the class's own shapes


def file_of(model: Model, options: GatherOptions) -> Path:
    """Where the rows of a space lie. They outlive changes of the fit: delete the file to look at all objects again."""
    return options.work / "beliefs" / f"{model.space.name}_{model.space.hash}.jsonl"


def run(model: Model, options: GatherOptions) -> list[BeliefRow]:
    """The rows of all objects. Raises DataError when none of the labelled ones is there."""
    file = file_of(model, options)
    known = {(r.name, r.kind) for r in rows.read(file)}
    todo = things(model, options)
    for thing in tqdm(todo, desc="beliefs", disable=None):
        for kind in options.kinds:
            if (thing.name, kind) in known:
                continue
            try:
                with outline_net.instead(_unseen(thing, options)):
                    row = looked_at(model, thing, kind, options.seed)
                if row is not None:
                    rows.append(file, [row])
            except (DataError, ReconError) as error:
                log.warning("%s is left out: %s", thing.name, error)
    wanted = {t.name for t in todo}
    return [r for r in rows.read(file) if r.name in wanted and r.kind in options.kinds]


def _unseen(thing: Thing, options: GatherOptions) -> Path | None:
    """The network that did not see a thing; own shapes were seen by none."""
    return options.outlines and options.outlines / f"{part_of(thing.name)}.safetensors"


def things(model: Model, options: GatherOptions) -> list[Thing]:
    """Objects of the class, others and own shapes by turns, each in an order of their own that never changes."""
    there = part_labels.objects(list(options.data))
    labels, others = part_labels.parts(options.labels), part_labels.others(options.labels)
    vocabulary = {p.name for p in model.space.discrete}
    if {c for seen in labels.values() for c in seen} <= vocabulary:
        part_labels.fitting(labels, model.space, f"the labels of {options.labels}")
    else:  # another space of the class: whether it is one can be told, its choices not
        labels = {name: {} for name in labels}
    mine = [_real(n, options.labels, seen, there[n]) for n, seen in labels.items() if n in there]
    rest = [_real(n, word, None, there[n]) for n, word in others.items() if n in there]
    if not mine or not rest:
        raise DataError("none of the labelled objects is in the data; see datasets/part_labels.py for where they are")
    own = [_own(model, i, options.labels) for i in range(options.own)]
    order = [sorted(group, key=lambda t: zlib.crc32(t.name.encode())) for group in (mine, rest)]
    out = [t for turn in range(max(map(len, order))) for g in (*order, own) for t in g[turn : turn + 1]]
    return out[: options.limit]


def _real(name: str, word: str, seen: Seen | None, item: RealObject) -> Thing:
    return Thing(name, word, seen is not None, seen, item.load, item.mask)


def _own(model: Model, i: int, word: str) -> Thing:
    """A random shape of the class, bent a little: about what an object is that the class can make."""
    rng = np.random.default_rng([31, i])
    params = model.space.sample(rng)
    active = model.space.active(params)
    seen: Seen = {p.name: (params[p.name],) for p in model.space.discrete if p.name in active}

    def load() -> trimesh.Trimesh:
        mesh = model.build(params).to_trimesh()
        waves, phase = rng.normal(size=(3, 3)) * 4, rng.uniform(0, 2 * np.pi, 3)
        bend = rng.uniform(0, BENT) * np.sin(mesh.vertices @ waves + phase)
        return trimesh.Trimesh(mesh.vertices + bend, mesh.faces, process=False)

    return Thing(f"{OWN}/{i}", word, True, seen, load, params=params)


def looked_at(model: Model, thing: Thing, kind: str, seed: int) -> BeliefRow | None:
    """The answer for an object, or None when it cannot be given as this kind."""
    number = zlib.crc32(thing.name.encode()) + seed
    mask = read_mask(thing.mask) if kind == "image" and thing.mask is not None else None
    mesh = None
    if mask is None:
        try:
            mesh = thing.load()
        except DataError:
            if thing.mask is not None:  # a mask alone
                return None
            raise
    started = time.process_time()
    if mask is not None:
        params, certainty, evidence = from_image(model, mask)
    else:
        params, certainty, evidence = ANSWERS[kind](model, mesh, number)
    seconds = round(time.process_time() - started, 1)
    choices = rows.told(params, certainty, thing.seen)
    scalars = rows.deviations(model, params, certainty, thing.params)
    return BeliefRow(thing.name, thing.word, kind, thing.belongs, evidence, choices, scalars, seconds)


def from_image(model: Model, mask: np.ndarray) -> Found:
    """One mask whose camera is unknown."""
    view = OneView(mask, guessed_K(mask.shape[1], mask.shape[0]))
    options = CameraSearchOptions()
    found = find(model, view, load_bank(model, options.bank), options)
    size = np.array([[mask.shape[1], mask.shape[0]]])
    cameras = Cameras(("view",), found.K[None], found.cam_from_world[None], size)
    silhouettes = Silhouettes(("view",), (mask,), ("user",), np.ones(1, bool))
    refined = found.refined
    poses = Poses(cameras, (Path("view"),), np.zeros((0, 3)), np.zeros((0, 1), bool))
    seen = quality.evidence_in(model, refined.params, Scene(poses, silhouettes, refined.canonical))
    return refined.params, refined.certainty, seen


def _image(model: Model, mesh: trimesh.Trimesh, seed: int) -> Found:
    mask = one_view(mesh, seed)[0]
    alone = Silhouettes(("view",), (mask,), ("user",), np.ones(1, bool))
    return from_image(model, _tidied(alone, np.random.default_rng(seed)).masks[0])


def _tidied(masks: Silhouettes, rng: np.random.Generator) -> Silhouettes:
    """Masks that are a little wrong along their outlines, without the specks that this makes elsewhere."""
    return replace(masks, masks=tuple(checked(m, "view")[0] for m in worn(masks, rng, GROWTH).masks))


def _masks(model: Model, mesh: trimesh.Trimesh, seed: int) -> Found:
    """Some to many masks from all round, their cameras known."""
    rng = np.random.default_rng(seed)
    scene = all_round(mesh, int(rng.integers(SIDES[0], SIDES[1] + 1)), seed)
    scene = replace(scene, silhouettes=_tidied(scene.silhouettes, rng))
    refined = from_silhouettes(model, scene)
    seen = quality.evidence_in(model, refined.params, scene.standing(refined.canonical))
    return refined.params, refined.certainty, seen


def _shape(write: Callable[[trimesh.Trimesh, Path, int], object], kind: str) -> Callable[..., Found]:
    """A shape's file, its up and front unknown."""

    def answer(model: Model, mesh: trimesh.Trimesh, seed: int) -> Found:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "object.ply"
            turned = trimesh.Trimesh(mesh.vertices @ FILE_FROM_CANONICAL.T, mesh.faces, process=False)
            write(turned, file, seed)
            target = shape_target.run(file, kind, kind, ShapeOptions())
        found = shape_fit.run(model, target)
        return found.params, found.certainty, found.evidence

    return answer


def _points(mesh: trimesh.Trimesh, file: Path, seed: int) -> None:
    trimesh.PointCloud(np.asarray(trimesh.sample.sample_surface(mesh, POINTS, seed=seed)[0])).export(file)


ANSWERS: dict[str, Callable[..., Found]] = {
    "mesh": _shape(lambda mesh, file, seed: mesh.export(file), Kind.MESH),
    "cloud": _shape(_points, Kind.CLOUD),
    "image": _image,
    "masks": _masks,
}


def possible(model: Model, kinds: tuple[str, ...]) -> tuple[str, ...]:
    """The kinds that need no network, or all when there is one."""
    try:
        load_network(model.space, model.weights)
    except WeightsError as error:
        if "masks" in kinds:
            log.warning("masks with known cameras are left out: %s", error)
        return tuple(k for k in kinds if k != "masks")
    return kinds
