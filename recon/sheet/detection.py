"""Where sheets are in a photo: markers are read, then the whole drawing is laid over the photo as well as it fits.

Contours of markers are blurred, and wrong by half a pixel; the fit (ECC, Evangelidis and Psarakis 2008) goes by every
edge of the drawing, and is right to a few hundredths. Pixel centres are at +0.5 in what is returned.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from recon.sheet.drawing import board_picture
from recon.sheet.layout import COLUMNS, MARKERS, ROWS, Board, boards, corners_of_squares, dictionary

ENLARGE_BELOW = 1500  # px, longest side: markers are read in such photos enlarged twice
NEAR = 0.6  # of a marker's side, that another one of the same sheet may be away from where the first one puts it
ALIKE = 0.6  # correlation with the drawing, of a square that is taken to be in sight, and of all together
LEAST_SQUARES = 2
SMALLEST = 12.0  # px^2, area of a square in the photo
_BLUR = 5  # px, of the pictures that are compared
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-6)
_EDGE = 0.1  # of a square, white paper round the board that belongs to the drawing


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
        expected = _moved(matrix, flat[marker])
        side = np.sqrt(abs(cv2.contourArea(quad.astype(np.float32))))
        off = float(np.linalg.norm(expected - quad, axis=1).mean() / max(side, 1e-9))
        if off < min(NEAR, nearest.get(marker, (np.inf, 0))[0]):
            nearest[marker] = off, i
    return [i for _, i in nearest.values()]


def _fitted(grey: np.ndarray, board: Board, photo_from_board: np.ndarray) -> Found | None:
    """The sheet near a first guess, or None when the photo does not show its drawing there.

    Squares that do not look like the drawing (something stands on them) are left out.
    """
    squares = board.square * np.array([(c, r) for r in range(ROWS) for c in range(COLUMNS)], float)
    matrix, seen = photo_from_board, np.ones(len(squares), bool)
    for last in (False, False, True):
        patch = _patch(grey, board, matrix)
        if patch is None:
            return None
        drawn, photo, offset = patch
        local = _shift(-offset) @ matrix
        masks = [_square_mask(photo.shape, local, s, board.square) for s in squares]
        seen = np.array([_correlation(drawn[m], photo[m]) > ALIKE - 0.2 * (not last) for m in masks])
        if seen.sum() < LEAST_SQUARES:
            return None
        mask = np.any([m for m, ok in zip(masks, seen, strict=True) if ok], axis=0)
        if last:
            break
        try:
            turn = np.eye(3, dtype=np.float32)
            # From the drawing as it is now to the photo.
            _, turn = cv2.findTransformECC(
                drawn, photo, turn, cv2.MOTION_HOMOGRAPHY, _STOP, mask.astype(np.uint8), _BLUR
            )
        except cv2.error:  # it does not converge
            return None
        half = np.array([0.5, 0.5])  # OpenCV counts pixels from 0 at centres
        matrix = _shift(offset + half) @ turn.astype(float) @ _shift(-half) @ local
    if _correlation(drawn[mask], photo[mask]) < ALIKE:
        return None
    corner = np.unique(corners_of_squares()[seen])
    return Found(board, corner, _moved(matrix, board.corners()[corner]))


def _patch(grey: np.ndarray, board: Board, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """The board as the camera would show it and the photo there, float32, and the patch's place (x, y); or None."""
    outline = _moved(matrix, np.array([(0, 0), (board.size[0], 0), board.size, (0, board.size[1])]))
    area = abs(cv2.contourArea(outline.astype(np.float32)))
    if not np.isfinite(outline).all() or area < SMALLEST * ROWS * COLUMNS:
        return None
    low = np.maximum(np.floor(outline.min(0)) - 8, 0).astype(int)
    high = np.minimum(np.ceil(outline.max(0)) + 8, (grey.shape[1], grey.shape[0])).astype(int)
    if (high - low < 8).any() or (high - low > 2 * max(grey.shape)).any():
        return None
    photo = grey[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    fine = int(
        np.clip(2400 // max(photo.shape), 2, 8)
    )  # drawn so much larger, then averaged: the camera's pixels do so
    per_mm = np.sqrt(area / (board.size[0] * board.size[1]))
    scale = float(2.0 ** np.ceil(np.log2(np.clip(2 * per_mm, 1, 8))))
    margin = _EDGE * board.square
    picture = board_picture(board, scale, margin)
    # OpenCV counts pixels from 0 at centres; all else here has them at +0.5.
    start = 0.5 / scale - margin
    board_from_picture = np.array([[1 / scale, 0, start], [0, 1 / scale, start], [0, 0, 1]])
    fine_from_patch = np.array([[fine, 0, -0.5], [0, fine, -0.5], [0, 0, 1]])
    transform = fine_from_patch @ _shift(-low.astype(float)) @ matrix @ board_from_picture
    size = (photo.shape[1] * fine, photo.shape[0] * fine)
    drawn = cv2.warpPerspective(picture, transform, size, flags=cv2.INTER_LINEAR, borderValue=255)
    small = cv2.resize(drawn, (photo.shape[1], photo.shape[0]), interpolation=cv2.INTER_AREA)
    return small.astype(np.float32), photo, low.astype(float)


def _square_mask(shape: tuple[int, ...], matrix: np.ndarray, place: np.ndarray, side: float) -> np.ndarray:
    """(H, W) bool, pixels of a square and a little of the edges round it."""
    edge = _EDGE * side
    ring = place + np.array([(-edge, -edge), (side + edge, -edge), (side + edge, side + edge), (-edge, side + edge)])
    corners, mask = _moved(matrix, ring), np.zeros(shape, np.uint8)
    if np.abs(corners).max() < 1e4 and abs(cv2.contourArea(corners.astype(np.float32))) >= SMALLEST:
        cv2.fillConvexPoly(mask, np.round(corners - 0.5).astype(np.int32), 1)
    return mask.astype(bool)


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Of two lists of grey values; 0 where one of them is even, or too short to say."""
    if len(a) < SMALLEST or a.std() < 1e-3 or b.std() < 1e-3:
        return 0.0
    return float(((a - a.mean()) * (b - b.mean())).mean() / (a.std() * b.std()))


def _moved(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 2) under a homography."""
    out = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return out[:, :2] / out[:, 2:]


def _shift(by: np.ndarray) -> np.ndarray:
    return np.array([[1, 0, by[0]], [0, 1, by[1]], [0, 0, 1.0]])


def _same_place(a: Found, b: Found) -> bool:
    """Whether two findings of one board are one sheet, found twice."""
    return a.board == b.board and float(np.linalg.norm(a.pixels.mean(0) - b.pixels.mean(0))) < 0.5 * float(
        np.linalg.norm(np.ptp(a.pixels, axis=0))
    )
