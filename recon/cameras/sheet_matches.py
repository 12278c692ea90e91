"""Corners of printed sheets as matches for structure from motion: what is the same corner is known by its number.

Where a floor is plain, these tie the photos together. In the child process of recon.cameras.poses.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from recon.scene import Frames
from recon.sheet.layout import CORNERS

TRUSTED = 6  # corners that a pair of photos shares: enough to tell that its other matches are wrong
AGREE = 0.5  # of them must fit the geometry of the pair


def marks(frames: Frames) -> dict[str, list[tuple[int, float, float]]]:
    """By file name of the working copy: the number of each corner, and its pixel.

    A sheet of which some photo shows two copies is left out: nobody knows which is which.
    """
    seen = frames.sheets
    if seen is None:
        return {}
    twice = np.unique(seen.board[seen.copy > 0])
    out: dict[str, list[tuple[int, float, float]]] = {}
    for view, board, corner, (u, v) in zip(seen.view, seen.board, seen.corner, seen.pixels, strict=True):
        if board not in twice:
            out.setdefault(frames.paths[view].name, []).append((int(board * CORNERS + corner), float(u), float(v)))
    return out


def join(pycolmap: Any, database: Path, order: dict[str, Any], pair_list: Path, verification: Any) -> None:
    """Add the marks of an order to the features and matches in the database, and verify all pairs anew.

    A pair whose marks do not fit what its other matches say keeps the marks alone: chairs look alike from both sides.
    """
    opened = pycolmap.Database.open(str(database))
    ids = {image.name: image.image_id for image in opened.read_all_images()}
    rows = {name: _add_keypoints(opened, ids[name], found) for name, found in order["marks"].items() if name in ids}
    shared = {}
    for i, j in order["pairs"]:
        a, b = order["images"][i], order["images"][j]
        common = sorted(rows.get(a, {}).keys() & rows.get(b, {}).keys())
        if common:
            shared[a, b] = np.array([(rows[a][key], rows[b][key]) for key in common], np.uint32)
            _write(opened, ids[a], ids[b], shared[a, b], keep=True)
    opened.clear_two_view_geometries()
    opened.close()
    pycolmap.verify_matches(database, pair_list, verification)
    _drop_contradictions(pycolmap, database, ids, shared, pair_list, verification)


def _add_keypoints(opened: Any, image: int, found: list[tuple[int, float, float]]) -> dict[int, int]:
    """Row among the image's keypoints by the number of a corner."""
    pixels = np.array([(u, v) for _, u, v in found], np.float32)
    if opened.exists_keypoints(image):
        known = np.asarray(opened.read_keypoints(image), np.float32)
    else:
        known = np.zeros((0, 2), np.float32)
    added = np.zeros((len(pixels), known.shape[1]), np.float32)
    added[:, :2] = pixels
    if known.shape[1] == 6:  # x, y and an affine shape
        added[:, [2, 5]] = 1.0
    elif known.shape[1] > 2:  # x, y, scale, orientation
        added[:, 2] = 1.0
    both = np.concatenate([known, added])
    (opened.update_keypoints if opened.exists_keypoints(image) else opened.write_keypoints)(image, both)
    return {key: len(known) + i for i, (key, _, _) in enumerate(found)}


def _write(opened: Any, a: int, b: int, added: np.ndarray, keep: bool) -> None:
    """Write the matches of a pair: those that it has, if they are kept, and `added` (k, 2)."""
    matches = added
    if opened.exists_matches(a, b):
        if keep:
            matches = np.concatenate([np.asarray(opened.read_matches(a, b), np.uint32).reshape(-1, 2), added])
        opened.delete_matches(a, b)
    opened.write_matches(a, b, matches)


def _drop_contradictions(
    pycolmap: Any,
    database: Path,
    ids: dict[str, int],
    shared: dict[tuple[str, str], np.ndarray],
    pair_list: Path,
    verification: Any,
) -> None:
    opened = pycolmap.Database.open(str(database))
    wrong = []
    for (a, b), marked in shared.items():
        if len(marked) < TRUSTED or not opened.exists_two_view_geometry(ids[a], ids[b]):
            continue
        inliers = np.asarray(opened.read_two_view_geometry(ids[a], ids[b]).inlier_matches).reshape(-1, 2)
        fitting = {tuple(row) for row in inliers.tolist()}
        if sum(tuple(row) in fitting for row in marked.tolist()) < AGREE * len(marked):
            opened.delete_two_view_geometry(ids[a], ids[b])
            _write(opened, ids[a], ids[b], marked, keep=False)
            wrong.append((a, b))
    opened.close()
    if wrong:
        again = pair_list.with_suffix(".again.txt")
        again.write_text("".join(f"{a} {b}\n" for a, b in wrong))
        pycolmap.verify_matches(database, again, verification)
