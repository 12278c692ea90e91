"""Which photos share a camera, and which pairs of photos are compared."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from recon.cameras.intrinsics import camera_model
from recon.scene import Frames

KEY_PHOTOS = 30  # sequential matching also compares every pair of so many photos spread over the sequence


def camera_groups(frames: Frames, held: np.ndarray | None = None) -> list[dict[str, Any]]:
    """Photos with one set of intrinsics: the same size, and the same EXIF focal length within 3 %.

    Each group: "images", file names of the working copies, "model", COLMAP's, and "params", SIMPLE_RADIAL (f, cx, cy,
    k) in pixels when EXIF gives f, else None. Photos without a focal length join the largest group of their size.
    held  (V, 4) float or None, fx, fy, cx, cy in pixels of the working copies that the user gave
    """
    if held is not None:
        alike: dict[tuple[float, ...], list[str]] = {}
        for path, size, row in zip(frames.paths, frames.sizes.tolist(), held.round(3).tolist(), strict=True):
            alike.setdefault((*size, *row), []).append(path.name)
        models = [camera_model(np.array(key[2:])) for key in alike]
        return [
            {"images": names, "model": m, "params": p} for names, (m, p) in zip(alike.values(), models, strict=True)
        ]
    buckets: dict[tuple[int, int, int | None], list[int]] = {}
    for i, (size, focal) in enumerate(zip(frames.sizes.tolist(), frames.focal_px, strict=True)):
        step = None if math.isnan(focal) else round(math.log(focal) / math.log(1.03))
        buckets.setdefault((size[0], size[1], step), []).append(i)
    for width, height, step in [k for k in buckets if k[2] is None]:
        known = [k for k in buckets if k[:2] == (width, height) and k[2] is not None]
        if known:
            buckets[max(known, key=lambda k: len(buckets[k]))] += buckets.pop((width, height, step))
    groups = []
    for (width, height, step), members in buckets.items():
        focal = None if step is None else float(np.nanmedian(frames.focal_px[members]))
        params = None if focal is None else [focal, width / 2, height / 2, 0.0]
        images = [frames.paths[i].name for i in sorted(members)]
        groups.append({"images": images, "model": "SIMPLE_RADIAL", "params": params})
    return groups


def image_pairs(count: int, matching: str, exhaustive_up_to: int, overlap: int) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, to compare; `matching` is "auto", "exhaustive" or "sequential".

    Sequential: each photo with its `overlap` successors and those 2, 4, 8, ... further on, round the end to the
    start again (people walk in circles), and all pairs of a few photos spread over the sequence, which tie together
    second rounds and unordered folders.
    """
    if matching == "exhaustive" or (matching == "auto" and count <= exhaustive_up_to):
        return [(i, j) for i in range(count) for j in range(i + 1, count)]
    steps = set(range(1, overlap + 1)) | {2**k for k in range(max(1, count).bit_length()) if 2**k < count}
    pairs = {(i, (i + s) % count) for i in range(count) for s in steps}
    keys = np.unique(np.linspace(0, count - 1, min(count, KEY_PHOTOS)).astype(int)).tolist()
    pairs |= {(a, b) for a in keys for b in keys}
    return sorted({(min(p), max(p)) for p in pairs if p[0] != p[1]})
