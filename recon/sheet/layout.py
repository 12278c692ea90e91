"""What is printed where: a ChArUco board, its numbers told apart from those of all other sheets.

Millimetres on the page, x to the right and y down from the board's upper left corner, as OpenCV has its boards: a
chessboard whose upper left square is black, with markers of DICT_4X4_50 in the white squares, row by row.
The board's own frame is in metres: x to the right, y up the page, z out of it, the origin in the board's middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

COLUMNS, ROWS = 3, 4  # squares: few and large ones are read from farther off
MARKERS = COLUMNS * ROWS // 2
CORNERS = (COLUMNS + 1) * (ROWS + 1)  # of all squares
MARKER_SHARE = 0.8  # of a square's side: what is left is the white round the marker


_RING = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)  # clockwise from the upper left


def corners_of_squares() -> np.ndarray:
    """(COLUMNS * ROWS, 4) int: which corners each square has, squares row by row, corners clockwise."""
    first = np.array([r * (COLUMNS + 1) + c for r in range(ROWS) for c in range(COLUMNS)])
    return first[:, None] + [0, 1, COLUMNS + 2, COLUMNS + 1]


@dataclass(frozen=True)
class Board:
    """One sheet's chessboard: its number among all sheets, and the side of a square in mm."""

    number: int
    square: float

    @property
    def ids(self) -> tuple[int, ...]:
        """The numbers of its markers."""
        return tuple(range(self.number * MARKERS, (self.number + 1) * MARKERS))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in mm."""
        return COLUMNS * self.square, ROWS * self.square

    def places(self) -> np.ndarray:
        """(COLUMNS * ROWS, 2) mm, upper left corners of all squares, row by row."""
        return self.square * np.array([(c, r) for r in range(ROWS) for c in range(COLUMNS)], float)

    def squares(self, black: bool) -> list[tuple[float, float]]:
        """Upper left corners (x, y) of the squares of one colour, row by row; white ones hold the markers."""
        places = [(c, r) for r in range(ROWS) for c in range(COLUMNS) if ((c + r) % 2 == 0) == black]
        return [(c * self.square, r * self.square) for c, r in places]

    def marker_corners(self) -> np.ndarray:
        """(MARKERS, 4, 2) mm, of every marker clockwise from its upper left, as OpenCV gives them."""
        side = MARKER_SHARE * self.square
        gap = (self.square - side) / 2
        return np.array([np.array(place) + gap + side * _RING for place in self.squares(black=False)])

    def corners(self) -> np.ndarray:
        """(CORNERS, 2) mm, of the squares, row by row."""
        return self.square * np.array([(c, r) for r in range(ROWS + 1) for c in range(COLUMNS + 1)], float)

    def in_metres(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 2) in mm as (n, 3) in the board's own frame."""
        flat = (points - np.array(self.size) / 2) * (1e-3, -1e-3)
        return np.column_stack([flat, np.zeros(len(flat))])


@dataclass(frozen=True)
class Paper:
    """A paper size in mm, the square that fits it, and the numbers of the boards that are printed on it."""

    name: str
    width: float
    height: float
    square: float
    numbers: tuple[int, ...]

    def board(self, sheet: int) -> Board:
        """The board of one of its sheets, counted from 1."""
        return Board(self.numbers[sheet - 1], self.square)


SMALL, LARGE = (0, 1, 2, 3, 4), (5, 6, 7)  # a marker's number alone must tell how large it is
PAPERS = {
    "A4": Paper("A4", 210.0, 297.0, 60.0, SMALL),
    "Letter": Paper("Letter", 215.9, 279.4, 60.0, SMALL),
    "A3": Paper("A3", 297.0, 420.0, 85.0, LARGE),
    "Tabloid": Paper("Tabloid", 279.4, 431.8, 85.0, LARGE),
}
RULER = 150.0  # mm, printed on every sheet


@cache
def boards() -> dict[int, Board]:
    """Every board that may be seen, by its number."""
    return {n: Board(n, p.square) for p in PAPERS.values() for n in p.numbers}


def name_of(number: int) -> str:
    """A board as people know it, by what is printed on its sheet."""
    return f"sheet {number + 1}" if number in SMALL else f"sheet {number - LARGE[0] + 1} (A3 or Tabloid)"


@cache
def dictionary() -> cv2.aruco.Dictionary:
    """The markers."""
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
