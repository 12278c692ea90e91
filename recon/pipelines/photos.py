"""The whole reconstruction as a straight list of stages; finished ones whose inputs are unchanged are skipped."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from nnproc.infer import WeightsError, load_network
from procmodels import Model
from procmodels import look as looks
from recon import scene
from recon.appearance import photos as appearance
from recon.cameras import known_cameras, poses, register_missing, sheet_place, turntable
from recon.cameras.sfm_options import PosesOptions
from recon.files import frames, mask_images, sheet_search, video, zipped
from recon.fitting import quality, refine, uncertainty
from recon.fitting import view_starts as fit
from recon.geometry import align
from recon.geometry import visual_hull as hull
from recon.masks import silhouettes
from recon.outputs import write as outputs
from recon.outputs.result import REGISTERED
from recon.outputs.write import OutputPaths
from recon.pipelines import checks, class_selection, out_folder, photo_source, real_size, results
from recon.pipelines.results import About
from recon.pipelines.stages import LAST, Redo, Stages
from recon.scene import InputError, Scene
from recon.store import dataclasses_of
from recon.system.folders import digest_of

STAGES = ("frames", "poses", "silhouettes", "align", "hull", "fit", "refine", "colours", LAST)
KNOWN = (scene, hull, fit, refine, uncertainty, class_selection, appearance, looks)  # whose dataclasses are results


@dataclass(frozen=True)
class ReconOptions:
    """What the user asked for, and the options of every stage."""

    class_name: str = "chair"  # a model of procmodels, the path of a model's .py file, or "auto"
    masks: Path | None = None  # folder, or zip file, of the user's own masks
    height: float | None = None  # real height of the object in metres
    ruler: float | None = None  # mm, what a printed sheet's ruler measures; None: as it should
    seed: int = 0
    redo: Redo = field(default_factory=Redo)
    cameras: Path | None = None  # a COLMAP model's folder or a transforms.json: where the photos were taken from
    look_for_cameras: bool = True  # in a folder of photos, when `cameras` is None
    allow_outside: bool = False  # the camera file may name images beyond its own folder and INPUT
    intrinsics: tuple[float, float, float, float] | None = None  # fx, fy, cx, cy in px of the original photos
    focal_mm: tuple[float, float] | None = None  # focal length and sensor width in mm
    video: video.VideoOptions = field(default_factory=video.VideoOptions)
    frames: frames.FramesOptions = field(default_factory=frames.FramesOptions)
    sheet: sheet_search.SheetOptions = field(default_factory=sheet_search.SheetOptions)
    poses: PosesOptions = field(default_factory=PosesOptions)
    silhouettes: silhouettes.SilhouetteOptions = field(default_factory=silhouettes.SilhouetteOptions)
    align: align.AlignOptions = field(default_factory=align.AlignOptions)
    hull: hull.HullOptions = field(default_factory=hull.HullOptions)
    fit: fit.FitOptions = field(default_factory=fit.FitOptions)
    refine: refine.RefineOptions = field(default_factory=refine.RefineOptions)
    look: appearance.LookOptions = field(default_factory=appearance.LookOptions)
    auto: class_selection.AutoOptions = field(default_factory=class_selection.AutoOptions)
    outputs: outputs.OutputsOptions = field(default_factory=outputs.OutputsOptions)


def run(photos: Path, out: Path, options: ReconOptions = ReconOptions()) -> OutputPaths:
    """Reconstruct the object in a folder of photos (or a video, or photos with cameras) into the folder `out`.

    Raises InputError (the user's input or options) or ReconstructionError (no result possible); whatever was finished
    before stays in `out/.recon` and is used by the next run.
    """
    models = _checked(photos, options)
    checks.check(options.height, out)
    real_size.check_ruler(options.ruler)
    with out_folder.claimed(out, {"INPUT": photos, "--masks": options.masks, "--cameras": options.cameras}) as work:
        return _run(photos, out, work, models, _seeded(options))


def _run(photos: Path, out: Path, work: Path, models: list[Model], options: ReconOptions) -> OutputPaths:
    """The stages, one after the other."""
    source = photo_source.run(
        photos,
        work,
        options.cameras,
        options.video,
        options.redo.force,
        options.look_for_cameras,
        options.allow_outside,
    )
    if source.cameras:  # two pictures may look alike and yet be taken from two places
        options = replace(options, frames=replace(options.frames, same_difference=-1.0))
    stages = Stages(work, STAGES, dataclasses_of(*KNOWN), [source.key, options.seed], options.redo)

    shots = stages.run(
        "frames",
        [options.frames, options.sheet],
        lambda: sheet_search.run(frames.run(source.folder, work, options.frames), source.folder, options.sheet),
    )
    drawn = unpacked(options.masks, work) or (source.cameras.masks if source.cameras else None)
    masks_key = "none" if drawn is None else digest_of(mask_images.files(drawn), drawn)
    looked_at = masks_key if source.cameras or options.poses.turntable else "none"
    placed = stages.run("poses", [options.poses, looked_at], lambda: _placed(shots, source, drawn, work, options))
    masks = stages.run(
        "silhouettes",
        [options.silhouettes, masks_key],
        lambda: silhouettes.run(shots, placed, drawn, work, options.silhouettes),
    )
    place = stages.run("align", options.align, lambda: align.run(placed, masks, options.align))
    seen = Scene(placed, masks, place)
    solid = stages.run("hull", options.hull, lambda: hull.run(seen, options.hull))
    chosen = _chosen(stages, models, seen, solid, options)
    verdict = quality.run(chosen.model, seen, chosen.refined, len(shots.names))
    refined = chosen.refined
    size = real_size.decide(
        options.height, options.ruler, placed.sheets, refined.canonical, chosen.model, refined.params
    )
    coloured = stages.run("colours", options.look, lambda: _coloured(chosen, seen, options.look))
    about = About(
        stages.seconds,
        options.seed,
        size.height,
        warnings=(*source.warnings, *placed.warnings, *masks.warnings, *chosen.warnings, *size.warnings),
        classes=chosen.classes,
        views=source.views,
        placed=REGISTERED if source.cameras is None else "given",
        size_from=size.source,
        look=coloured.look,
    )
    result = results.of_views(chosen.model, shots, seen, chosen.refined, verdict, about)
    stages.last()
    return outputs.run(result, out, options.outputs, chosen.model)


def unpacked(masks: Path | None, work: Path) -> Path | None:
    """The folder of the user's own masks, which may come as a zip file. Raises InputError."""
    return zipped.unpack(masks, work / "masks_unzipped") if masks and zipped.photos_in(masks) else masks


def _placed(
    shots: scene.Frames, source: photo_source.Photos, drawn: Path | None, work: Path, options: ReconOptions
) -> scene.Poses:
    """The stage "poses": the cameras, and where printed sheets lie; `drawn` is the folder of masks."""
    return sheet_place.run(shots, _cameras(shots, source, drawn, work, options))


def _cameras(
    shots: scene.Frames, source: photo_source.Photos, drawn: Path | None, work: Path, options: ReconOptions
) -> scene.Poses:
    """The cameras given, or structure from motion."""
    if source.cameras is not None:
        given = known_cameras.run(shots, source.cameras, work, drawn)
        return register_missing.run(shots, given, work, options.poses) if source.cameras.others else given
    if options.poses.turntable:
        return poses.run(shots, work, options.poses, turntable.object_alone(shots, drawn, work))
    return poses.run(shots, work, options.poses)


def _chosen(
    stages: Stages,
    models: list[Model],
    seen: Scene,
    solid: hull.Hull,
    options: ReconOptions,
) -> class_selection.Chosen:
    """The stages "fit" and "refine", for the class that was named or for all."""
    if options.class_name == checks.AUTO:
        return class_selection.run(stages.run, models, seen, solid, options.fit, options.refine, options.auto)
    model = models[0]
    key = [options.fit, class_selection.key(model)]
    found = stages.run("fit", key, lambda: fit.run(model, seen, solid, options.fit))
    refined = stages.run("refine", options.refine, lambda: refine.run(model, seen, found, options.refine))
    return class_selection.Chosen(model, refined)


def _coloured(chosen: class_selection.Chosen, seen: Scene, options: appearance.LookOptions) -> appearance.Appearance:
    """The stage "colours": the look of the answer where it stands."""
    shape = chosen.model.build(chosen.refined.params)
    return appearance.run(shape, seen.standing(chosen.refined.canonical), options)


def _seeded(options: ReconOptions) -> ReconOptions:
    """The options with the one seed handed to every stage that draws random numbers."""
    return replace(
        options,
        frames=replace(options.frames, allow_single=options.masks is not None),
        poses=replace(options.poses, seed=options.seed, intrinsics=options.intrinsics, focal_mm=options.focal_mm),
        silhouettes=replace(options.silhouettes, seed=options.seed),
        fit=replace(options.fit, seed=options.seed),
    )


def _checked(photos: Path, options: ReconOptions) -> list[Model]:
    """The models to try; everything else that can be found wrong before minutes are spent. Raises InputError."""
    photo_source.check(photos, options.cameras)
    if options.masks is not None and not zipped.photos_in(options.masks):
        mask_images.files(options.masks)
    options.redo.check(STAGES)
    return _with_weights(options.class_name)


def _with_weights(class_name: str) -> list[Model]:
    """The model of that name, or every one that has weights."""
    if class_name == checks.AUTO:
        return class_selection.known_models()
    models = checks.models(class_name)
    try:
        load_network(models[0].space, models[0].weights)
    except WeightsError as error:
        raise InputError(str(error)) from error
    return models
