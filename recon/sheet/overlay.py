"""A sheet's drawing laid over a photo as well as it fits: to a few hundredths of a pixel, by every edge of the drawing.

Gauss-Newton on the grey values, with the drawing shown as the camera would show it. The unknowns are where the board's
four outer corners are in the photo, and how bright ink and paper are. Pixel centres are at +0.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from recon.sheet.drawing import board_picture
from recon.sheet.layout import COLUMNS, ROWS, Board, corners_of_squares

ALIKE = 0.6  # correlation with the drawing, of a square that is taken to be in sight, and of all together
THIS_ONE = 0.4  # correlation inside the squares: all sheets have the same squares, each has its own bits and textures
PERHAPS = 0.2  # in the first steps: of squares far from the markers that were read, the guess may be some pixels off
LEAST_SQUARES = 2
SMALLEST = 12.0  # px^2, area of a square in the photo
BLURS = (2.0, 2.0, 2.0, 1.2, 1.2, 0.8, 0.8, 0.8, 0.8)  # px, of both pictures, step by step
SURE = 5  # steps after which only squares that look like the drawing count
_PER_MM = 4.0  # pixels of the drawing
_WITHIN = 0.22  # of a square, inside which it has bits of its marker or texture
_EDGE = 0.1  # of a square, white paper round the board that belongs to the drawing


@dataclass(frozen=True)
class _Patch:
    """The drawing as the camera would show it and the photo there, float32; `at` is their upper left corner (x, y)."""

    drawn: np.ndarray
    photo: np.ndarray
    at: np.ndarray


def laid_over(grey: np.ndarray, board: Board, photo_from_board: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """photo_from_board (3, 3), mm to px, near a first guess, and the corners (k,) that the photo shows; None if none.

    Squares that do not look like the drawing (something stands on them) are left out.
    """
    matrix, patch = photo_from_board, None
    for step, blur in enumerate(BLURS):
        if (patch := _patch(grey, board, matrix)) is None:
            return None
        masks = [_square_mask(patch, matrix, place, board.square) for place in board.places()]
        alike = np.array([_correlation(patch.drawn[m], patch.photo[m]) for m in masks])
        seen = alike > (ALIKE if step >= SURE else PERHAPS)
        if seen.sum() < LEAST_SQUARES:
            if step > 0:
                return None
            seen[:] = True
        mask = np.any([m for m, ok in zip(masks, seen, strict=True) if ok], axis=0)
        if mask.sum() < LEAST_SQUARES * SMALLEST:
            return None
        moved = _step(patch, board, matrix, mask, blur)
        if moved is None:
            return None
        matrix = moved
    assert patch is not None  # BLURS is not empty
    if _correlation(patch.drawn[mask], patch.photo[mask]) < ALIKE or _inside(patch, board, matrix, seen) < THIS_ONE:
        return None
    return matrix, np.unique(corners_of_squares()[seen])


def likeness(grey: np.ndarray, board: Board, photo_from_board: np.ndarray) -> float:
    """Correlation of the photo with the drawing as a homography places it, both blurred; 0 where it is not in sight."""
    if (patch := _patch(grey, board, photo_from_board)) is None:
        return 0.0
    outline = moved_by(photo_from_board, _outline(board)) - patch.at
    mask = np.zeros(patch.photo.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(outline - 0.5).astype(np.int32), (1,))
    drawn, photo = (cv2.GaussianBlur(a, (0, 0), BLURS[0])[mask > 0] for a in (patch.drawn, patch.photo))
    return _correlation(drawn, photo)


def moved_by(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 2) under a homography."""
    out = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return out[:, :2] / out[:, 2:]


def _outline(board: Board) -> np.ndarray:
    """(4, 2) mm, the board's outer corners."""
    width, height = board.size
    return np.array([(0, 0), (width, 0), (width, height), (0, height)], float)


def _patch(grey: np.ndarray, board: Board, matrix: np.ndarray) -> _Patch | None:
    """None when the board is not in the photo, or too small in it."""
    outline = moved_by(matrix, _outline(board))
    if not np.isfinite(outline).all() or np.abs(outline).max() > 1e5:
        return None
    low = np.maximum(np.floor(outline.min(0)) - 8, 0).astype(int)
    high = np.minimum(np.ceil(outline.max(0)) + 8, (grey.shape[1], grey.shape[0])).astype(int)
    if (high - low < 8).any() or cv2.contourArea(outline.astype(np.float32)) < SMALLEST * ROWS * COLUMNS:
        return None
    photo = grey[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    fine = int(np.clip(1600 // max(photo.shape), 2, 6))  # drawn so much larger, then averaged, as a camera's pixels do
    # OpenCV counts pixels from 0 at centres; all else here has them at +0.5.
    start = 0.5 / _PER_MM - _EDGE * board.square
    board_from_picture = np.array([[1 / _PER_MM, 0, start], [0, 1 / _PER_MM, start], [0, 0, 1]])
    fine_from_photo = np.array([[fine, 0, -0.5 - fine * low[0]], [0, fine, -0.5 - fine * low[1]], [0, 0, 1]])
    picture = board_picture(board, _PER_MM, _EDGE * board.square)
    size = (photo.shape[1] * fine, photo.shape[0] * fine)
    drawn = cv2.warpPerspective(picture, fine_from_photo @ matrix @ board_from_picture, size, borderValue=(255,))
    drawn = cv2.resize(drawn, (photo.shape[1], photo.shape[0]), interpolation=cv2.INTER_AREA)
    return _Patch(drawn.astype(np.float32), photo, low.astype(float))


def _step(patch: _Patch, board: Board, matrix: np.ndarray, mask: np.ndarray, blur: float) -> np.ndarray | None:
    """photo_from_board after one step: the photo is taken for gain * drawing + offset, the drawing moved a little."""
    drawn, photo = (cv2.GaussianBlur(a, (0, 0), blur) for a in (patch.drawn, patch.photo))
    dx, dy = (cv2.Sobel(drawn, cv2.CV_32F, *order, ksize=3, scale=1 / 8)[mask] for order in ((1, 0), (0, 1)))
    rows, columns = np.nonzero(mask)
    places = np.column_stack([columns, rows]) + 0.5 + patch.at
    corners = moved_by(matrix, _outline(board))
    contrast = np.polyfit(drawn[mask], photo[mask], 1)
    moves = _moves(corners, places)
    columns_of = [-contrast[0] * (dx * m[:, 0] + dy * m[:, 1]) for m in moves]
    system = np.column_stack([*columns_of, drawn[mask], np.ones(len(places))])
    answer = np.linalg.lstsq(system, photo[mask], rcond=None)[0][:8].reshape(4, 2)
    # Far steps are not what the linear model was made for.
    answer *= min(1.0, 3.0 / max(float(np.abs(answer).max()), 1e-9))
    moved = cv2.getPerspectiveTransform(
        _outline(board).astype(np.float32), (corners + answer - patch.at).astype(np.float32)
    )
    out = np.array([[1, 0, patch.at[0]], [0, 1, patch.at[1]], [0, 0, 1]]) @ moved
    return out if contrast[0] > 0 and np.isfinite(out).all() else None


def _moves(corners: np.ndarray, places: np.ndarray) -> list[np.ndarray]:
    """8 times (n, 2): how places move with x and y of each of the four corners (4, 2)."""
    out = []
    middle = corners.mean(0)
    for k in range(8):
        shifted = corners.copy()
        shifted[k // 2, k % 2] += 0.5
        turn = cv2.getPerspectiveTransform((corners - middle).astype(np.float32), (shifted - middle).astype(np.float32))
        out.append(2 * (moved_by(turn, places - middle) + middle - places))
    return out


def _square_mask(patch: _Patch, matrix: np.ndarray, place: np.ndarray, side: float, more: float = _EDGE) -> np.ndarray:
    """(H, W) bool, pixels of a square and `more` of its side round it (less than nothing: within it)."""
    edge = more * side
    ring = place + np.array([(-edge, -edge), (side + edge, -edge), (side + edge, side + edge), (-edge, side + edge)])
    corners, mask = moved_by(matrix, ring) - patch.at, np.zeros(patch.photo.shape, np.uint8)
    if np.abs(corners).max() < 1e4 and cv2.contourArea(corners.astype(np.float32)) >= SMALLEST:
        cv2.fillConvexPoly(mask, np.round(corners - 0.5).astype(np.int32), (1,))
    return mask.astype(bool)


def _inside(patch: _Patch, board: Board, matrix: np.ndarray, seen: np.ndarray) -> float:
    """Correlation of what is inside the squares in sight, each about its own mean: bits of markers, textures."""
    products = np.zeros(3)
    for place, ok in zip(board.places(), seen, strict=True):
        mask = _square_mask(patch, matrix, place, board.square, -_WITHIN)
        if ok and mask.any():
            a, b = (x[mask] - x[mask].mean() for x in (patch.drawn, patch.photo))
            products += (a @ b, a @ a, b @ b)
    return float(products[0] / max(np.sqrt(products[1] * products[2]), 1e-9))


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Of two lists of grey values; 0 where one of them is even, or too short to say."""
    if len(a) < SMALLEST or a.std() < 1e-3 or b.std() < 1e-3:
        return 0.0
    return float(((a - a.mean()) * (b - b.mean())).mean() / (a.std() * b.std()))
