"""From what the user gave (photos, a video, photos or a splat with known cameras) to one folder of photos."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from recon.cameras import known_cameras
from recon.files import video, zipped
from recon.files.photo_folder import choose
from recon.scene import InputError
from recon.shapes import splat_views
from recon.system.digests import digest, file_digest, folder_digest
from recon.system.folders import digest_of, exists, is_file

FOLDER = "given"  # below the work folder: links to the photos of known cameras


@dataclass(frozen=True)
class Photos:
    """A folder of photos, their cameras when these are known, a digest of all that was read, and warnings.

    views is what the photos are, in the plural.
    """

    folder: Path
    cameras: known_cameras.Given | None
    key: str
    warnings: tuple[str, ...] = ()
    views: str = "photos"


def check(source: Path, cameras: Path | None) -> None:
    """Raise InputError when `source` is none of what `run` takes, before anything is written."""
    if cameras is not None and not exists(cameras):
        raise InputError(f"{cameras} does not exist; --cameras wants a COLMAP model's folder or a transforms.json")
    if cameras is not None:
        known_cameras.required(cameras)
    if video.is_video(source):
        return video.check(source)
    if is_file(source) and zipped.photos_in(source):
        return None
    if source.is_dir() or (source.is_file() and known_cameras.find(source) is not None):
        return
    if cameras is not None and source.is_file() and splat_views.is_splat(source):
        return
    what = "is not a folder of photos, a video, or a transforms.json" if source.exists() else "is not a folder or file"
    raise InputError(f"{source} {what}; give the folder that holds the photos")


def run(
    source: Path,
    work: Path,
    cameras: Path | None,
    options: video.VideoOptions,
    force: bool = False,
    look_for_cameras: bool = True,
    outside: bool = False,
) -> Photos:
    """The photos of a source; frames of a video go to `work`/video, links to photos with cameras to `work`/given.

    A splat with cameras is drawn into `work`/given.

    cameras  a COLMAP model's folder or a transforms.json; None: one that `source` itself is or holds is used, if
             `look_for_cameras`
    outside  whether a camera file may name images beyond its own folder and `source`
    Raises InputError.
    """
    if cameras is not None and source.is_file() and splat_views.is_splat(source):
        return replace(_known(splat_views.gather(source, cameras, work / FOLDER)), views="views of the splat")
    if is_file(source) and zipped.photos_in(source):
        source = zipped.unpack(source, work / "unzipped")
    folder, warnings = source, ()  # type: tuple[Path, tuple[str, ...]]
    if video.is_video(source):
        folder = work / "video"
        warnings = video.extract(source, folder, options, force)
    found = cameras
    if found is None and look_for_cameras:
        found = known_cameras.find(source)
    if found is None:
        return Photos(folder, None, digest_of(choose(folder).files, folder), warnings)
    return _known(known_cameras.gather(folder, found, work / FOLDER, outside), warnings)


def _known(given: known_cameras.Given, warnings: tuple[str, ...] = ()) -> Photos:
    files = [file_digest(f) for f in known_cameras.camera_files(given.source)]
    key = digest(folder_digest(given.folder), folder_digest(given.masks), files)
    return Photos(given.folder, given, key, warnings)
