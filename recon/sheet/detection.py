"""Where sheets are in a photo: markers are read, then the whole drawing is laid over the photo (recon.sheet.overlay).

Contours of markers alone are wrong by half a pixel where they are small. Pixel centres are at +0.5 in what is returned.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from recon.sheet import page_outline
from recon.sheet.layout import MARKERS, Board, boards, dictionary
from recon.sheet.overlay import laid_over, moved_by

ENLARGE_BELOW = 1500  # px, longest side: markers are read in such photos enlarged twice
NEAR = 0.6  # of a marker's side, that another one of the same sheet may be away from where the first one puts it


@dataclass(frozen=True)
class Found:
    """One sheet in one photo: its board, and corners (k,) int of it at pixels (k, 2)."""

    board: Board
    corner: np.ndarray
    pixels: np.ndarray


def find(grey: np.ndarray) -> list[Found]:
    """Every sheet that can be read in a grey picture (H, W) uint8; one of them per copy, in order of their numbers."""
    scale = 2 if max(grey.shape) < ENLARGE_BELOW else 1
    large = grey if scale == 1 else cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    quads, ids, _ = _detector().detectMarkers(large)
    read: dict[int, list[tuple[int, np.ndarray]]] = {}
    for quad, number in zip(quads, () if ids is None else ids.ravel().tolist(), strict=True):
        corners = (quad.reshape(4, 2).astype(float) + 0.5) / scale
        read.setdefault(number // MARKERS, []).append((number % MARKERS, corners))
    found = [
        fitted
        for number in sorted(read.keys() & boards().keys())
        for start in _copies(boards()[number], read[number])
        if (fitted := _fitted(grey, boards()[number], start)) is not None
    ]
    return [f for i, f in enumerate(found) if not any(_same_place(f, other) for other in found[:i])]


def find_outlined(grey: np.ndarray, number: int) -> list[Found]:
    """The sheet of a number by its page's outline, where its markers cannot be read (recon.sheet.page_outline)."""
    if (answer := page_outline.find(grey, boards()[number])) is None:
        return []
    return [_found(boards()[number], *answer)]


@cache
def _detector() -> cv2.aruco.ArucoDetector:
    settings = cv2.aruco.DetectorParameters()
    settings.minMarkerPerimeterRate = 0.012  # of the longest side: a sheet is small beside furniture
    settings.polygonalApproxAccuracyRate = 0.05
    settings.adaptiveThreshWinSizeMax = 33
    return cv2.aruco.ArucoDetector(dictionary(), settings)


def _copies(board: Board, read: list[tuple[int, np.ndarray]]) -> Iterator[np.ndarray]:
    """photo_from_board (3, 3), mm to px, of each group of markers that lie as on one sheet; largest groups first."""
    flat, left = board.marker_corners(), list(range(len(read)))
    while left:
        groups = [_group(flat, read, left, seed) for seed in left]
        best = max(groups, key=len)
        source = np.concatenate([flat[read[i][0]] for i in best])
        matrix, _ = cv2.findHomography(source, np.concatenate([read[i][1] for i in best]))
        if matrix is not None:
            yield matrix
        left = [i for i in left if i not in best]


def _group(flat: np.ndarray, read: list[tuple[int, np.ndarray]], left: list[int], seed: int) -> list[int]:
    """The markers among `left` that lie where the seed's own quadrilateral puts them: one of each at most."""
    matrix = cv2.getPerspectiveTransform(flat[read[seed][0]].astype(np.float32), read[seed][1].astype(np.float32))
    nearest: dict[int, tuple[float, int]] = {}
    for i in left:
        marker, quad = read[i]
        expected = moved_by(matrix, flat[marker])
        side = np.sqrt(abs(cv2.contourArea(quad.astype(np.float32))))
        off = float(np.linalg.norm(expected - quad, axis=1).mean() / max(side, 1e-9))
        if off < min(NEAR, nearest.get(marker, (np.inf, 0))[0]):
            nearest[marker] = off, i
    return [i for _, i in nearest.values()]


def _fitted(grey: np.ndarray, board: Board, photo_from_board: np.ndarray) -> Found | None:
    """The sheet near a first guess, or None when the photo does not show its drawing there."""
    if (answer := laid_over(grey, board, photo_from_board)) is None:
        return None
    return _found(board, *answer)


def _found(board: Board, matrix: np.ndarray, corner: np.ndarray) -> Found:
    return Found(board, corner, moved_by(matrix, board.corners()[corner]))


def _same_place(a: Found, b: Found) -> bool:
    """Whether two findings of one board are one sheet, found twice."""
    return a.board == b.board and float(np.linalg.norm(a.pixels.mean(0) - b.pixels.mean(0))) < 0.5 * float(
        np.linalg.norm(np.ptp(a.pixels, axis=0))
    )
