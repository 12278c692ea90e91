"""What the user's INPUT is: told from its content, said in a sentence, and overridden by --input KIND."""

from __future__ import annotations

import json
import logging
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from recon.files import camera_table, formats, photo_folder, zipped
from recon.files.head import head_of
from recon.files.photo import opened, thinned
from recon.files.raw_photo import is_raw
from recon.files.shape import SHAPES, Kind, Recognised
from recon.files.video import is_container
from recon.scene import InputError
from recon.system.folders import exists

__all__ = ["SHAPES", "Kind", "Recognised", "recognise"]
log = logging.getLogger("recon")
_LOOK_PIXELS = 1_000_000  # of a picture, which tell a mask


def recognise(path: Path, forced: str | None = None) -> Recognised:
    """What `path` is, which is also said to the user; `forced` (--input) wins over what it looks like.

    Raises InputError for a path that does not exist, for content that nothing here reads, and for an unknown kind.
    """
    if forced is not None and forced not in list(Kind):
        raise InputError(f"--input {forced!r} is not a kind of input; kinds: {', '.join(Kind)}")
    if not exists(path):
        raise InputError(f"{path} does not exist; it is not a folder of photos and not a file")
    if not (path.is_dir() or path.is_file()):
        raise InputError(f"{path} is a pipe or a device, not a file or a folder")
    try:
        seen = _folder(path) if path.is_dir() else _file(path)
    except InputError:
        if forced is None:
            raise
        return Recognised(Kind(forced), f"taken as {forced}, as --input says")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); check its permissions") from error
    if forced is not None and forced != seen.kind:
        log.info("%s looks like %s; --input says %s, so it is read as that", path, seen.what, forced)
        return Recognised(Kind(forced), f"taken as {forced}, as --input says; it looks like {seen.what}")
    log.info("%s looks like %s%s", path, seen.what, "" if forced else "; --input KIND says otherwise")
    return seen


def _folder(path: Path) -> Recognised:
    """A folder of photos or masks, with or without known cameras."""
    if (found := camera_table.find(path)) is not None:
        return Recognised(Kind.CAMERAS, f"a photo set with known cameras ({found[1].describe})")
    choice = photo_folder.choose(path)
    pictures = choice.photos()
    if pictures and all(_two_valued(p) for p in pictures[:12]):
        return Recognised(Kind.MASKS, f"a folder of {len(pictures)} masks{choice.said()}")
    return Recognised(Kind.PHOTOS, f"a folder of {len(pictures)} photos{choice.said()}")


def _two_valued(path: Path) -> bool:
    """Whether a picture is black and white without colours and greys: a mask."""
    if path.suffix.lower() not in (".png", ".bmp", ".tif", ".tiff"):
        return False
    try:
        with opened(path) as picture:
            if "A" in picture.getbands() or "transparency" in picture.info:
                return False  # an alpha channel makes a photo with its own mask
            small = thinned(picture, _LOOK_PIXELS)
            image = np.asarray(small if small.mode[0] in "LIF" else small.convert("RGB"))
    except Exception:  # decoders fail in many ways on damaged files; whoever reads it says what is wrong
        return False
    grey = image if image.ndim == 2 else image[..., 0]
    if image.ndim == 3 and not (image == grey[..., None]).all():
        return False
    low, high = int(grey.min()), int(grey.max())
    return low < high and float(np.mean((grey == low) | (grey == high))) > 0.98


def _file(path: Path) -> Recognised:
    """A shape of the table, or what the first of the readers below knows."""
    head = head_of(path)
    if not head.size:
        raise InputError(f"{path} is empty")
    if (cameras := _known_cameras(path, head.start)) is not None:
        return cameras
    if (form := formats.format_of(head)) is not None:
        return formats.describe(head, form)
    for look in _LOOKS:
        if (seen := look(path, head.start)) is not None:
            return seen
    raise InputError(
        f"{path} is nothing that can be read here; give a folder of photos, a video, an image, a mesh (OBJ, PLY, GLB, "
        "STL, OFF, DAE, 3MF, FBX, USD), a point cloud (PLY, PCD, XYZ, CSV, NPY, LAS, E57), a splat (PLY, .splat, .spz, "
        ".ksplat, SOG) or a voxel grid (.npz, .binvox)"
    )


def _picture(path: Path, head: bytes) -> Recognised | None:
    brand = head[8:12] if head[4:8] == b"ftyp" else b""
    still = brand in (b"heic", b"heix", b"mif1", b"msf1", b"avif", b"heim", b"heis")
    known = head[:3] == b"\xff\xd8\xff" or head[:8] == b"\x89PNG\r\n\x1a\n" or head[:2] == b"BM"
    known = known or head[:12] == b"\0\0\0\x0cjP  \r\n\x87\n" or head[:4] == b"\xff\x4f\xff\x51" or is_raw(path)
    known = known or head[:4] in (b"II*\0", b"MM\0*") or (head[:4] == b"RIFF" and head[8:12] == b"WEBP")
    if not (known or still):
        return None
    return Recognised(Kind.MASKS, "one mask") if _two_valued(path) else Recognised(Kind.IMAGE, "one image")


def _video(path: Path, head: bytes) -> Recognised | None:
    return Recognised(Kind.VIDEO, "a video") if is_container(path) else None


def _known_cameras(path: Path, head: bytes) -> Recognised | None:
    found = camera_table.find(path)
    if found is None and path.suffix.lower() == ".json" and b'"frames"' in head:
        return Recognised(Kind.CAMERAS, "a photo set with known cameras (transforms.json)")  # damaged, which is said
    return None if found is None else Recognised(Kind.CAMERAS, f"known cameras of photos ({found[1].describe})")


def _json(path: Path, head: bytes) -> Recognised | None:
    """JSON of something else, or damaged."""
    if head.lstrip()[:1] != b"{":
        return None
    try:
        json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is damaged JSON ({error})") from error
    return None


def _archive(path: Path, head: bytes) -> Recognised | None:
    """A zip archive of photos, or of something else."""
    if head[:4] != b"PK\x03\x04":
        return None
    if photos := zipped.photos_in(path):
        return Recognised(Kind.PHOTOS, f"a zip file of {photos} photos")
    if zipfile.is_zipfile(path):
        raise InputError(f"{path} is a zip file without numpy arrays; unpack it and give what is inside")
    raise InputError(f"{path} is a zip file that is damaged or cut short; copy it again")


_LOOKS: tuple[Callable[[Path, bytes], Recognised | None], ...] = (_picture, _video, _json, _archive)
