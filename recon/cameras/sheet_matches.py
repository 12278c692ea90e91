"""Corners of printed sheets as matches for structure from motion: what is the same corner is known by its number.

Where a floor is plain, these tie the photos together. In the child process of recon.cameras.poses.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from recon.scene import Frames
from recon.sheet.layout import CORNERS

TOLERANCE = 0.012  # of the longest side, that matches may miss the lines by: these cameras are half a degree off


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


def joined(pycolmap: Any, database: Path, order: dict[str, Any], pair_list: Path, verification: Any) -> Path:
    """A copy of the database with the marks of an order among its features and matches, all pairs verified anew.

    Matches of two photos that contradict where their cameras stand about a sheet are left out first.
    """
    copy = database.with_suffix(".sheet.db")
    shutil.copyfile(database, copy)
    opened = pycolmap.Database.open(str(copy))
    ids = {image.name: image.image_id for image in opened.read_all_images()}
    rows = {name: _add_keypoints(opened, ids[name], found) for name, found in order["marks"].items() if name in ids}
    pairs = [(order["images"][i], order["images"][j]) for i, j in order["pairs"]]
    for a, b in pairs:
        common = sorted(rows.get(a, {}).keys() & rows.get(b, {}).keys())
        added = np.array([(rows[a][key], rows[b][key]) for key in common], np.uint32).reshape(-1, 2)
        F = fundamental(order["sheet_poses"], order["sheet_K"], a, b)
        if len(added) or F is not None:
            _rewrite(opened, ids[a], ids[b], added, F, order["sheet_tolerance"])
    opened.clear_two_view_geometries()
    opened.close()
    pair_list.write_text("".join(f"{a} {b}\n" for a, b in pairs))
    pycolmap.verify_matches(copy, pair_list, verification)
    return copy


def fundamental(
    poses: dict[str, dict[str, list[float]]], K: dict[str, list[float]], a: str, b: str
) -> np.ndarray | None:
    """(3, 3) F with x_b^T F x_a = 0 for pixels of two photos, by a sheet that both show; None without one.

    poses  cam_from_sheet by photo and board (recon.cameras.sheet_poses); K: focal length and principal point by photo
    """
    common = sorted(poses.get(a, {}).keys() & poses.get(b, {}).keys())
    if not common:
        return None
    b_from_a = np.reshape(poses[b][common[0]], (4, 4)) @ np.linalg.inv(np.reshape(poses[a][common[0]], (4, 4)))
    x, y, z = b_from_a[:3, 3]
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ b_from_a[:3, :3]
    Ka, Kb = (np.array([[f, 0, cx], [0, f, cy], [0, 0, 1.0]]) for f, cx, cy in (K[a], K[b]))
    return np.linalg.inv(Kb).T @ essential @ np.linalg.inv(Ka)


def from_epipolar(F: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n,) px, the farther of the two distances of pixels a, b (n, 2) from each other's epipolar lines."""
    first, second = (np.column_stack([p, np.ones(len(p))]) for p in (a, b))
    in_b, in_a = first @ F.T, second @ F
    product = np.abs((second * in_b).sum(1))
    return product / np.maximum(np.minimum(np.hypot(*in_b[:, :2].T), np.hypot(*in_a[:, :2].T)), 1e-12)


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


def _rewrite(opened: Any, a: int, b: int, added: np.ndarray, F: np.ndarray | None, tolerance: float) -> None:
    """The matches of a pair: those that it has, as far as they fit F, and `added` (k, 2)."""
    kept = np.zeros((0, 2), np.uint32)
    if opened.exists_matches(a, b):
        kept = np.asarray(opened.read_matches(a, b), np.uint32).reshape(-1, 2)
        if F is not None and len(kept):
            places = [np.asarray(opened.read_keypoints(i), float)[:, :2] for i in (a, b)]
            kept = kept[from_epipolar(F, places[0][kept[:, 0]], places[1][kept[:, 1]]) < tolerance]
        opened.delete_matches(a, b)
    opened.write_matches(a, b, np.concatenate([kept, added]))
