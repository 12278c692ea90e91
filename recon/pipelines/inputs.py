"""Kind of input -> what reconstructs it, and the flags that it takes. A flag that it does not take is an error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from recon.files import recognise
from recon.files.shape import SHAPES, Kind, Recognised
from recon.outputs.write import OutputPaths, OutputsOptions
from recon.pipelines.stages import Redo
from recon.scene import InputError
from recon.system.arguments import nameable, readable
from recon.system.light_open3d import without_plotting


@dataclass(frozen=True)
class Asked:
    """The command line. A flag has its field's name; None or False where nothing was said."""

    source: Path
    out: Path
    class_name: str = "chair"
    height: float | None = None
    seed: int = 0
    input: str | None = None
    redo: Redo = field(default_factory=Redo)
    plain: bool = False
    up: str | None = None
    front: str | None = None
    masks: Path | None = None
    mask: Path | None = None
    box: str | None = None
    pix3d: Path | None = None
    camera_off: float | None = None
    cameras: Path | None = None
    allow_outside: bool = False
    turntable: bool = False
    intrinsics: str | None = None
    focal_mm: str | None = None
    frames: int | None = None
    obj_up: str = "y"
    ruler: float | None = None


@dataclass(frozen=True)
class Way:
    """How one kind of input is reconstructed: its name in words, the flags besides everybody's, and what runs."""

    name: str
    flags: frozenset[str]
    run: Callable[[Asked, Recognised], OutputPaths]


# Either of two flags says the same thing, or one makes the other useless.
RIVALS = (("intrinsics", "focal_mm"), ("pix3d", "intrinsics"), ("pix3d", "focal_mm"), ("mask", "box"))


def check(asked: Asked) -> None:
    """Raise InputError unless everything that is read is there and the output folder can have its name."""
    read = (("INPUT", asked.source), *((_option(f), getattr(asked, f)) for f in ("masks", "mask", "pix3d", "cameras")))
    for option, given in read:
        if given is not None:
            readable(given, option)
    nameable(asked.out, "--out")


def run(asked: Asked) -> OutputPaths:
    """Reconstruct the object, by what INPUT is. Raises InputError or ReconstructionError."""
    without_plotting()
    seen = recognise.recognise(asked.source, asked.input)
    return way_of(asked, seen).run(asked, seen)


def way_of(asked: Asked, seen: Recognised) -> Way:
    """The row of the table for an input. Raises InputError for flags that it does not take, naming them."""
    way = WAYS[_row(asked, seen)]
    own = {flag for w in WAYS.values() for flag in w.flags}
    for flag in sorted(own - way.flags):
        if getattr(asked, flag) not in (None, False):
            *others, last = [w.name for w in WAYS.values() if flag in w.flags]
            belongs = f"{', '.join(others)} or {last}" if others else last
            raise InputError(
                f"{_option(flag)} is not for {way.name}, and that is what {asked.source} is ({seen.what}); it belongs "
                f"to {belongs}. Leave it out, or say with --input what INPUT is"
            )
    for one, other in RIVALS:
        if getattr(asked, one) is not None and getattr(asked, other) is not None:
            raise InputError(f"{_option(one)} and {_option(other)} say the same in two ways; give one of them")
    return way


def _option(flag: str) -> str:
    return "--" + flag.replace("_", "-")


def _row(asked: Asked, seen: Recognised) -> str:
    """The key of WAYS: the kind of the input and whether cameras or a single file are meant."""
    if seen.kind in SHAPES:
        with_cameras = seen.kind == Kind.SPLAT and asked.cameras is not None
        return "splat in cameras" if with_cameras else "splat" if seen.kind == Kind.SPLAT else "shape"
    if seen.kind == Kind.VIDEO:
        return "video in cameras" if asked.cameras else "video"
    if seen.kind == Kind.MASKS and asked.source.is_dir():
        return "masks in cameras" if asked.cameras else "masks"
    if seen.kind in (Kind.MASKS, Kind.IMAGE):
        return "image"
    return "photos in cameras" if asked.cameras or seen.kind == Kind.CAMERAS else "photos"


def _shape(asked: Asked, seen: Recognised) -> OutputPaths:
    from recon.pipelines import shape  # each where it is used: all of them together take seconds to load

    stands = shape.ShapeOptions(up=asked.up or "auto", front=asked.front or "auto")
    written = OutputsOptions(obj_up=asked.obj_up)
    options = shape.ShapeRunOptions(
        asked.class_name,
        asked.height,
        asked.seed,
        asked.redo,
        stands,
        look=shape.LookOptions(plain=asked.plain),
        outputs=written,
    )
    return shape.run(asked.source, asked.out, seen, options)


def _image(asked: Asked, seen: Recognised) -> OutputPaths:
    from recon.appearance.photos import LookOptions
    from recon.cameras.intrinsics import parse_focal_mm, parse_intrinsics
    from recon.masks.single_mask import checked_doubt, parse_box
    from recon.pipelines import image, mask_set
    from recon.pipelines.single_view import ImageOptions

    options = ImageOptions(
        class_name=asked.class_name,
        height=asked.height,
        seed=asked.seed,
        redo=asked.redo,
        mask=asked.mask,
        box=parse_box(asked.box) if asked.box else None,
        pix3d=asked.pix3d,
        doubt=checked_doubt(asked.camera_off, asked.pix3d),
        intrinsics=parse_intrinsics(asked.intrinsics) if asked.intrinsics else None,
        focal_mm=parse_focal_mm(asked.focal_mm) if asked.focal_mm else None,
        outputs=OutputsOptions(obj_up=asked.obj_up),
        look=LookOptions(plain=asked.plain),
    )
    pipeline = mask_set if asked.source.is_dir() else image
    return pipeline.run(asked.source, asked.out, options)


def _photos(asked: Asked, seen: Recognised) -> OutputPaths:
    from recon.appearance.photos import LookOptions
    from recon.cameras.intrinsics import parse_focal_mm, parse_intrinsics
    from recon.cameras.sfm_options import PosesOptions
    from recon.files.video import VideoOptions
    from recon.pipelines import photos

    video = VideoOptions() if asked.frames is None else VideoOptions(count=asked.frames)
    options = photos.ReconOptions(
        class_name=asked.class_name,
        height=asked.height,
        ruler=asked.ruler,
        seed=asked.seed,
        redo=asked.redo,
        masks=asked.source if seen.kind == Kind.MASKS else asked.masks,
        cameras=asked.cameras,
        look_for_cameras=asked.input in (None, Kind.CAMERAS),
        allow_outside=asked.allow_outside,
        intrinsics=parse_intrinsics(asked.intrinsics) if asked.intrinsics else None,
        focal_mm=parse_focal_mm(asked.focal_mm) if asked.focal_mm else None,
        poses=PosesOptions(turntable=asked.turntable),
        video=video,
        outputs=OutputsOptions(obj_up=asked.obj_up),
        look=LookOptions(plain=asked.plain or seen.kind in (Kind.MASKS, Kind.SPLAT)),  # which are drawn in one colour
    )
    return photos.run(asked.source, asked.out, options)


def _takes(flags: Sequence[str]) -> frozenset[str]:
    return frozenset(flags)


LENS, CAMERAS = ("intrinsics", "focal_mm"), ("cameras", "allow_outside")
SEEN = ("masks", "ruler")  # of photos
WAYS = {
    "photos": Way("photos", _takes([*SEEN, "turntable", "cameras", *LENS]), _photos),
    "photos in cameras": Way("photos with known cameras", _takes([*SEEN, *CAMERAS]), _photos),
    "video": Way("a video", _takes([*SEEN, "turntable", "frames", "cameras", *LENS]), _photos),
    "video in cameras": Way("a video with known cameras", _takes([*SEEN, "frames", *CAMERAS]), _photos),
    "image": Way("one image", _takes(["mask", "box", "pix3d", "camera_off", *LENS]), _image),
    "masks": Way("a folder of masks", _takes(["cameras", *LENS]), _image),
    "masks in cameras": Way("masks with known cameras", _takes(CAMERAS), _photos),
    "shape": Way("a mesh, a point cloud or a voxel grid", _takes(["up", "front"]), _shape),
    "splat": Way("a splat", _takes(["up", "front", "cameras"]), _shape),
    "splat in cameras": Way("a splat with known cameras", _takes(["masks", *CAMERAS]), _photos),
}
