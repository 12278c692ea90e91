"""A video of the object: sharp, well-spread frames become a folder of photos."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from recon.files.av_capture import AvCapture
from recon.scene import InputError
from recon.store import Store
from recon.system import limits, scratch
from recon.system.digests import digest, file_digest
from recon.system.progress import hidden
from recon.system.whole_files import write_picture

log = logging.getLogger("recon.files.video")

ENDINGS = {".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mts", ".m2ts", ".ts", ".3gp", ".ogv", ".mpg", ".wmv"}
LOOK_SIDE = 480  # px, longest side at which sharpness is measured: sensor noise is gone, motion blur is not
THUMB = 24  # px, side of the square thumbnails that frames are compared by


@dataclass(frozen=True)
class VideoOptions:
    """How frames are chosen."""

    count: int = 40  # frames; the clip is cut in so many slots of equal length, each gives its sharpest
    looks: int = 30  # frames of a slot that are looked at, at most; long clips take time
    still: float = 5.0  # grey levels of 255: thumbnails nowhere further apart are one picture (the camera stood still)
    blurred: float = 0.1  # of the median sharpness; frames below are not used
    least: int = 3  # frames
    least_cut: int = 12  # frames that a damaged video must give
    quality: int = 95  # JPEG quality


@dataclass(frozen=True)
class Look:
    """What is remembered of the frames that were looked at: index (n,), sharpness (n,), thumbs (n, THUMB, THUMB)."""

    index: np.ndarray
    sharpness: np.ndarray
    thumbs: np.ndarray
    decoded: int  # frames that could be decoded
    promised: int  # frames that the file says it has; 0 when it does not


@dataclass(frozen=True)
class Extracted:
    """The chosen frames in the video's order, and warnings."""

    paths: tuple[Path, ...]
    warnings: tuple[str, ...]


def is_video(path: Path) -> bool:
    """Whether a file is a video by its beginning, or by its name."""
    return path.is_file() and (path.suffix.lower() in ENDINGS or is_container(path))


def is_container(path: Path) -> bool:
    """Whether a file begins as MP4/MOV, AVI, MKV/WEBM, Ogg, WMV or an MPEG stream does."""
    try:
        with path.open("rb") as file:
            start = file.read(400)
    except OSError:
        return False
    boxes = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot")
    mp4 = start[4:8] in boxes and not start[8:12].startswith((b"hei", b"mif1", b"msf1", b"avi", b"hev"))
    other = start[:4] in (b"\x1aE\xdf\xa3", b"OggS", b"\0\0\x01\xba", b"0&\xb2u")  # MKV, Ogg, MPEG, WMV
    stream = any(len(start) > p + step and start[p] == start[p + step] == 0x47 for p, step in ((0, 188), (4, 192)))
    return mp4 or (start[:4] == b"RIFF" and start[8:12] == b"AVI ") or other or stream


def check(path: Path) -> None:
    """Raise InputError when a file does not even begin like a video."""
    if not is_container(path):
        raise InputError(f"{path} is no video that can be read (MP4, MOV, AVI, MKV, WEBM and MTS are)")


def extract(path: Path, folder: Path, options: VideoOptions = VideoOptions(), force: bool = False) -> tuple[str, ...]:
    """Write the chosen frames of a video as JPEG into `folder` (made anew) and return warnings.

    A folder that holds this video's frames already, chosen with the same options, is left as it is unless `force`.
    Raises InputError when the video cannot be decoded, or gives too few frames.
    """
    if not 3 <= options.count <= 1000:
        raise InputError(f"--frames must be 3 to 1000, got {options.count}")
    store, key = Store(folder.parent, [Extracted]), _key(path, options)
    stored = None if force else store.load(folder.name, key)
    if stored is not None and {p.name for p in folder.iterdir()} == {p.name for p in stored.result.paths}:
        log.info("frames of %s: unchanged, skipped", path.name)
        return stored.result.warnings
    check(path)
    look = _look(path, options)
    chosen = choose(look, options)
    warnings = _judged(path, look, chosen, options)
    store.forget([folder.name])
    written = _write(path, chosen, scratch.fresh(folder), options)
    if len(written) < len(chosen):
        raise InputError(f"{path} changed while it was read; run again")
    store.save(folder.name, key, Extracted(tuple(written), tuple(warnings)), 0.0)
    log.info("%d of %d frames of %s are used", len(written), look.decoded, path.name)
    return tuple(warnings)


def _key(path: Path, options: VideoOptions) -> str:
    """A digest of the video's content and the options."""
    try:
        return digest(file_digest(path), options)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error


@contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture | AvCapture]:
    """The decoder, which turns frames upright as the file says; its own chatter about damage is kept quiet."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    if not str(path.resolve()).isprintable():  # the decoder crashes on names that are not UTF-8
        raise InputError(f"the name of {path} has characters that the video's decoder cannot take; rename it")
    before = cv2.getLogLevel()
    cv2.setLogLevel(0)
    capture = _capture(path)
    try:
        yield capture
    finally:
        capture.release()
        cv2.setLogLevel(before)


def _capture(path: Path) -> cv2.VideoCapture | AvCapture:
    """OpenCV's decoder where it knows the codec, else PyAV's. Raises InputError."""
    capture = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)
    _check_size(path, capture)
    knows = capture.isOpened() and capture.grab()
    capture.release()
    if knows:  # begun anew, since a frame was taken
        capture = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
        return capture
    try:
        other = AvCapture(path)
        _check_size(path, other)
        return other
    except (OSError, ValueError) as error:  # FFmpeg's errors are both
        raise InputError(
            f"{path} cannot be decoded: it is cut off, damaged, or its codec is not known; record or export it "
            "anew (MP4 with H.264 is safe)"
        ) from error


def _check_size(path: Path, capture: cv2.VideoCapture | AvCapture) -> None:
    """Raise InputError when a frame is too large to decode a dozen of them."""
    width, height = capture.get(cv2.CAP_PROP_FRAME_WIDTH), capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if width * height > limits.FRAME_PIXELS:
        raise InputError(
            f"{path} has frames of {width:.0f} x {height:.0f}, at most {limits.FRAME_PIXELS // 10**6} megapixels "
            "are read; export it smaller"
        )


def _check_length(path: Path, frames: int) -> None:
    """Raise InputError for a film."""
    if frames > limits.VIDEO_FRAMES:
        raise InputError(
            f"{path} has {frames:,} frames or more, at most {limits.VIDEO_FRAMES:,} are looked at; cut out the minutes "
            "that show the object"
        )


def _look(path: Path, options: VideoOptions) -> Look:
    """Sharpness and thumbnails of all frames, or of every n-th of a long clip."""
    index, sharpness, thumbs, at = [], [], [], 0
    with _opened(path) as capture:
        promised = max(0, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
        promised = promised if promised < 10**7 else 0
        _check_length(path, promised)
        step = max(1, promised // (options.count * options.looks))
        with tqdm(total=promised or None, desc="looking for sharp frames", unit="frame", disable=hidden()) as bar:
            while capture.grab():
                if at % step == 0:
                    ok, image = capture.retrieve()
                    if ok and image is not None and image.size:
                        sharp, thumb = _measure(image)
                        index.append(at)
                        sharpness.append(sharp)
                        thumbs.append(thumb)
                at += 1
                _check_length(path, at)
                bar.update()
    shape = (-1, THUMB, THUMB)
    return Look(np.array(index, int), np.array(sharpness), np.array(thumbs, np.uint8).reshape(shape), at, promised)


def _measure(image: np.ndarray) -> tuple[float, np.ndarray]:
    """Variance of the Laplacian at LOOK_SIDE px, and the thumbnail (THUMB, THUMB) uint8."""
    scale = min(1.0, LOOK_SIDE / max(image.shape[:2]))
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
    grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
    thumb = cv2.resize(grey, (THUMB, THUMB), interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(grey, cv2.CV_64F).var()), thumb


def choose(look: Look, options: VideoOptions) -> np.ndarray:
    """(k,) indices of frames, ascending: the sharpest of each slot, without blurred ones and repetitions."""
    if not len(look.index):
        return np.zeros(0, int)
    slot = look.index * options.count // (int(look.index[-1]) + 1)
    best = [int(s[look.sharpness[s].argmax()]) for k in np.unique(slot) for s in [np.flatnonzero(slot == k)]]
    limit = options.blurred * float(np.median(look.sharpness[best]))
    kept: list[int] = []
    for i in best:
        thumb = look.thumbs[i].astype(int)
        same = kept and np.abs(look.thumbs[kept[-1]].astype(int) - thumb).max() <= options.still
        if same and look.sharpness[i] > look.sharpness[kept[-1]]:
            kept[-1] = i
        elif not same and look.sharpness[i] >= limit:
            kept.append(i)
    return look.index[kept]


def _judged(path: Path, look: Look, chosen: np.ndarray, options: VideoOptions) -> list[str]:
    """Warnings; raises InputError when there are too few frames."""
    if not len(look.index):
        raise InputError(f"no frame of {path} can be decoded: it is cut off, or has no key frame; export it anew")
    cut = look.decoded < 0.95 * look.promised - 2
    short = f"only {look.decoded} of the {look.promised} frames of {path.name} can be decoded, it is cut off or damaged"
    if cut and len(chosen) < options.least_cut:
        raise InputError(f"{short}; they give {len(chosen)} pictures, at least {options.least_cut} are needed")
    if len(chosen) < options.least:
        raise InputError(
            f"{path} gives {len(chosen)} different pictures in {look.decoded} frames, at least {options.least} are "
            "needed; film while you walk round the object"
        )
    return [short] if cut else []


def _write(path: Path, chosen: np.ndarray, folder: Path, options: VideoOptions) -> list[Path]:
    """Decode again and write the chosen frames; names sort in the video's order."""
    wanted, at = set(chosen.tolist()), 0
    written: list[Path] = []
    with _opened(path) as capture, tqdm(total=len(wanted), desc="writing frames", disable=hidden()) as bar:
        while len(written) < len(wanted) and capture.grab():
            if at in wanted:
                ok, image = capture.retrieve()
                if not ok:
                    break
                written.append(folder / f"frame_{at:06d}.jpg")
                write_picture(written[-1], image, cv2.IMWRITE_JPEG_QUALITY, options.quality)
                bar.update()
            at += 1
    return written
