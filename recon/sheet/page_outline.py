"""Sheets whose markers are too small to be read, by the outline of the page: bright paper on a darker floor.

Other photos tell which sheets lie about. A quadrilateral that might be the page is tried in its four turns; whether it
is one, and which way round, is told by the drawing laid over it.
"""

from __future__ import annotations

import cv2
import numpy as np

from recon.sheet import overlay
from recon.sheet.drawing import place
from recon.sheet.layout import PAPERS, Board

SMALLEST = 200.0  # px^2, area of a page
MOST = 12  # quadrilaterals of a photo that are tried, the largest first
ROUGH = 2e-2  # of the outline's length, that its sides may bend by
PROMISING = 0.25  # correlation before the fit, of both pictures blurred


def find(grey: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    """photo_from_board (3, 3), mm to px, and the corners (k,) that are in sight; None when no outline is that sheet's.

    grey  (H, W) uint8
    """
    starts = []
    for quad in _quads(grey):
        for corners in _pages(board):
            for turn in range(4):
                source, target = corners.astype(np.float32), np.roll(quad, -turn, axis=0).astype(np.float32)
                matrix = cv2.getPerspectiveTransform(source, target)
                likeness = overlay.likeness(grey, board, matrix)
                if likeness > PROMISING:
                    starts.append((likeness, matrix))
    for _, matrix in sorted(starts, key=lambda s: -s[0])[:4]:
        if (answer := overlay.laid_over(grey, board, matrix)) is not None:
            return answer
    return None


def _pages(board: Board) -> list[np.ndarray]:
    """(4, 2) mm of the board's frame, clockwise from the upper left, of every page that it is printed on."""
    out = []
    for paper in PAPERS.values():
        if board.number in paper.numbers:
            (left, top), size = place(paper), (paper.width, paper.height)
            ring = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * size
            out.append(ring - (left, top))
    return out


def _quads(grey: np.ndarray) -> list[np.ndarray]:
    """(4, 2) px, clockwise, pixel centres at +0.5: bright convex quadrilaterals, the largest first."""
    found: list[tuple[float, np.ndarray]] = []
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0)
    # The ink is closed over: the page is one bright piece.
    side = max(9, round(max(grey.shape) / 60)) | 1
    closed = cv2.morphologyEx(smooth, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_RECT, (side, side)))
    for level in (140, 165, 190, 215):
        contours, _ = cv2.findContours((closed > level).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        for contour in contours:
            if cv2.contourArea(contour) < SMALLEST or cv2.contourArea(contour) > 0.25 * grey.size:
                continue
            hull = cv2.convexHull(contour)
            quad = cv2.approxPolyDP(hull, ROUGH * cv2.arcLength(hull, True), True).reshape(-1, 2)
            if len(quad) != 4 or cv2.contourArea(contour) < 0.8 * cv2.contourArea(quad):
                continue
            quad = quad if cv2.contourArea(quad, True) > 0 else quad[::-1]
            found.append((float(cv2.contourArea(quad)), quad + 0.5))
    return [quad for _, quad in sorted(found, key=lambda f: -f[0])[:MOST]]
