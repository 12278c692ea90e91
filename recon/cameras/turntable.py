"""An object that turns before a still camera: structure from motion may look at nothing but the object."""

from __future__ import annotations

import contextlib
import logging
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from recon.cameras.poses import JPEG
from recon.files import mask_images
from recon.files.photo import BACKGROUND
from recon.geometry.mask_checks import surely_inverted
from recon.scene import Frames, InputError
from recon.system.whole_files import write_picture

log = logging.getLogger("recon.cameras.poses")
LEAST = 0.5  # of the photos must have a mask


def object_alone(frames: Frames, masks: Path | None, workdir: Path) -> Frames:
    """The photos with everything but the object painted over, as copies in `workdir`/turning; names and sizes stay.

    masks  folder of the user's own masks; alpha channels serve where it has none. Photos without a mask stay as they
           are, and will hardly be placed.
    Raises InputError when fewer than half of the photos have a mask.
    """
    found = _masks(frames, masks)
    if len(found) < max(1, LEAST * len(frames.names)):
        raise InputError(
            f"--turntable looks at the object alone and needs to know where it is: {len(found)} of {len(frames.names)} "
            "photos have a mask; give --masks (white = object) or PNGs whose background is transparent"
        )
    out = workdir / "turning"
    out.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, path in zip(frames.names, frames.paths, strict=True):
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None:
            raise InputError(f"the working copy {path} is gone; run again with --force")
        if name in found:
            image = np.where(found[name][..., None], image, np.array(BACKGROUND, np.uint8))
        write_picture(out / path.name, image, *JPEG)
        paths.append(out / path.name)
    return replace(frames, paths=tuple(paths))


def _masks(frames: Frames, folder: Path | None) -> dict[str, np.ndarray]:
    """(H, W) bool by photo name, as the photo lies."""
    found: dict[str, np.ndarray] = {}
    for name, path, (width, height) in zip(frames.names, frames.alpha, frames.sizes, strict=True):
        if path is not None:
            with contextlib.suppress(mask_images.BadMask):  # nearly all of it is opaque, or transparent
                found[name] = mask_images.read_mask(path, (int(width), int(height)))
    if folder is not None:
        own, _ = mask_images.drawn(folder, frames, frames.names)
        found |= own.masks
        for _, reason in own.bad:
            log.warning(reason)
    return {name: ~mask if surely_inverted(mask) else mask for name, mask in found.items()}
