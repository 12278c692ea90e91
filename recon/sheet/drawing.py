"""The sheet as a picture, black and white: the board, texture in its black squares, a ruler and what to do."""

from __future__ import annotations

from functools import cache, lru_cache

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from recon.sheet.layout import MARKER_SHARE, RULER, Board, Paper, dictionary

MM_PER_INCH = 25.4
DPI = 600.0
BORDER = 0.12  # of a square's side, that a black square stays black inside its edges: corners need clean edges
GRAINS = (2.0, 5.0)  # mm, sizes of the texture's blobs: some show from near, some from afar
_TEXTURE_PX = 2.0  # a mm, of the texture before it is enlarged


def page(paper: Paper, sheet: int = 1, dpi: float = DPI) -> np.ndarray:
    """(H, W) uint8, 0 or 255: one sheet of a paper, counted from 1."""
    scale = dpi / MM_PER_INCH
    out = np.full((round(paper.height * scale), round(paper.width * scale)), 255, np.uint8)
    board, (left, top) = paper.board(sheet), place(paper)
    _draw(out, scale, board, left, top)
    return _told(out, scale, paper, sheet, top + board.size[1])


@lru_cache(maxsize=64)
def board_picture(board: Board, scale: float, margin: float) -> np.ndarray:
    """(H, W) uint8: a board alone with `margin` mm of white round it, at `scale` pixels a mm."""
    width, height = board.size
    shape = round((height + 2 * margin) * scale), round((width + 2 * margin) * scale)
    out = np.full(shape, 255, np.uint8)
    _draw(out, scale, board, margin, margin)
    return out


def _draw(out: np.ndarray, scale: float, board: Board, left: float, top: float) -> None:
    """The board with its upper left corner at (left, top) mm."""
    for i, (x, y) in enumerate(board.squares(black=True)):
        _fill(out, scale, left + x, top + y, board.square, 0)
        gap = BORDER * board.square
        _paste(out, scale, left + x + gap, top + y + gap, board.square - 2 * gap, _blobs(board, i))
    for marker, (x, y) in zip(board.ids, board.squares(black=False), strict=True):
        side = MARKER_SHARE * board.square
        gap = (board.square - side) / 2
        bits = cv2.aruco.generateImageMarker(dictionary(), marker, 6, borderBits=1)
        _paste(out, scale, left + x + gap, top + y + gap, side, bits)


def place(paper: Paper) -> tuple[float, float]:
    """The board's upper left corner on the page, mm."""
    width, height = paper.board(1).size
    return (paper.width - width) / 2, 0.25 * (paper.height - height)


def _pixels(scale: float, *values: float) -> list[int]:
    return [round(v * scale) for v in values]


def _fill(out: np.ndarray, scale: float, x: float, y: float, side: float, value: int) -> None:
    left, right, top, bottom = _pixels(scale, x, x + side, y, y + side)
    out[top:bottom, left:right] = value


def _paste(out: np.ndarray, scale: float, x: float, y: float, side: float, picture: np.ndarray) -> None:
    """A square picture at its place: markers as they are, textures with smooth outlines."""
    left, right, top, bottom = _pixels(scale, x, x + side, y, y + side)
    how = cv2.INTER_NEAREST if len(picture) < 10 else cv2.INTER_CUBIC
    shown = cv2.resize(picture, (right - left, bottom - top), interpolation=how)
    out[top:bottom, left:right] = np.where(shown > 127, 255, 0)


@cache
def _blobs(board: Board, square: int) -> np.ndarray:
    """Grey texture of one black square, like no other: white blobs on black of the sizes in GRAINS."""
    rng = np.random.default_rng([board.number, square])
    side = round((1 - 2 * BORDER) * board.square * _TEXTURE_PX)
    out = np.zeros((side, side))
    for grain in GRAINS:
        noise = cv2.GaussianBlur(rng.normal(size=(side, side)), (0, 0), grain * _TEXTURE_PX / 2)
        out += noise / noise.std()
    return np.clip(127 + 300 * out / out.std(), 0, 255).astype(np.uint8)


def _told(out: np.ndarray, scale: float, paper: Paper, sheet: int, below: float) -> np.ndarray:
    """With the ruler and the words, under the board that ends at `below` mm."""
    picture = Image.fromarray(out)
    draw = ImageDraw.Draw(picture)
    room = paper.height - below
    left, line = (paper.width - RULER) / 2, below + 0.3 * room
    thick = max(1, round(0.3 * scale))
    draw.line(_pixels(scale, left, line, left + RULER, line), fill=0, width=thick)
    for mm in range(0, round(RULER) + 1, 5):
        tall = 4.0 if mm % 10 == 0 else 2.0
        draw.line(_pixels(scale, left + mm, line - tall, left + mm, line), fill=0, width=thick)
    font = ImageFont.load_default(size=max(6.0, 3.2 * scale))
    for i, words in enumerate(_words(paper, sheet)):
        x, y = _pixels(scale, left, line + 1.5 + 4.2 * i)
        draw.text((x, y), words, fill=0, font=font)
    return np.asarray(picture)


def _words(paper: Paper, sheet: int) -> tuple[str, ...]:
    return (
        f"Print at 100 % (actual size). This ruler must measure {RULER:.0f} mm; if it does not, say what it measures",
        '(option "ruler", in mm).',
        f"Lay it flat on the floor beside the object, where most photos show it. {paper.name}, sheet {sheet}.",
    )
