"""The sheet as printed: what other programs know as a ChArUco board, to scale, each sheet told from the others."""

import re

import cv2
import numpy as np
import pytest

from recon.sheet.__main__ import main, pdf
from recon.sheet.drawing import MM_PER_INCH, page, place
from recon.sheet.layout import COLUMNS, MARKER_SHARE, PAPERS, ROWS, RULER, boards, dictionary, name_of

DPI = 100.0


def test_numbers_are_of_one_board_each_and_fit_the_dictionary():
    numbers = [i for b in boards().values() for i in b.ids]
    assert len(numbers) == len(set(numbers))
    assert max(numbers) < len(dictionary().bytesList)
    assert len({name_of(n) for n in boards()}) == len(boards())
    for paper in PAPERS.values():
        assert {boards()[n].square for n in paper.numbers} == {paper.square}, "a number alone tells the size"


@pytest.mark.parametrize("paper", PAPERS.values(), ids=list(PAPERS))
def test_opencv_reads_it_as_a_charuco_board(paper):
    board = paper.board(2)
    ids = np.array(board.ids)
    known = cv2.aruco.CharucoBoard((COLUMNS, ROWS), board.square, MARKER_SHARE * board.square, dictionary(), ids)
    corners, found, _, markers = cv2.aruco.CharucoDetector(known).detectBoard(page(paper, 2, DPI))
    assert set(markers.ravel()) == set(board.ids)
    assert len(found) == (COLUMNS - 1) * (ROWS - 1)
    inner = board.corners().reshape(ROWS + 1, COLUMNS + 1, 2)[1:-1, 1:-1].reshape(-1, 2)
    seen = (corners.reshape(-1, 2) + 0.5) * MM_PER_INCH / DPI - place(paper)
    assert seen == pytest.approx(inner[found.ravel()], abs=0.4), "mm, at a quarter of a mm a pixel"


@pytest.mark.parametrize("paper", PAPERS.values(), ids=list(PAPERS))
def test_everything_fits_the_page_and_printers_margins(paper):
    ink = page(paper, 1, DPI) == 0
    rows, columns = np.flatnonzero(ink.any(1)), np.flatnonzero(ink.any(0))
    margin = 6 * DPI / MM_PER_INCH
    assert rows[0] > margin
    assert columns[0] > margin
    assert rows[-1] < ink.shape[0] - margin
    assert columns[-1] < ink.shape[1] - margin


def test_the_ruler_is_as_long_as_it_says():
    """From the middle of its first mark to that of its last, with one every centimetre."""
    paper, scale = PAPERS["A4"], 300.0 / MM_PER_INCH
    ink = page(paper, 1, 300.0) == 0
    below = round((place(paper)[1] + paper.board(1).size[1] + 2) * scale)
    line = below + int(ink[below:].sum(1).argmax())
    edges = np.flatnonzero(np.diff(np.r_[0, ink[line - round(3 * scale)].astype(int), 0]))
    marks = edges.reshape(-1, 2).mean(1) / scale
    assert marks[-1] - marks[0] == pytest.approx(RULER, abs=0.1)
    assert np.diff(marks) == pytest.approx(np.full(15, 10.0), abs=0.1)


def test_every_black_square_has_a_texture_of_its_own():
    pictures = [page(PAPERS["A4"], n, 60.0) for n in (1, 2)]
    assert (page(PAPERS["A4"], 1, 60.0) == pictures[0]).all(), "the same sheet each time"
    differing = (pictures[0] != pictures[1]).mean()
    assert 0.1 < differing < 0.5


def test_pdf_pages_have_the_papers_size():
    data = pdf(PAPERS["A4"], 2)
    boxes = re.findall(rb"/MediaBox \[ ([^\]]*)\]", data)
    assert len(boxes) == 2
    assert [float(v) for v in boxes[0].split()] == pytest.approx([0, 0, 210 / 25.4 * 72, 297 / 25.4 * 72], abs=0.1)
    assert len(data) < 1_000_000


def test_the_command(tmp_path, capsys):
    out = tmp_path / "sheet.pdf"
    assert main(["--paper", "letter", "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"%PDF")
    for words, said in (
        (["--out", str(out)], "is not replaced"),
        (["--paper", "A9", "--out", str(tmp_path / "b.pdf")], "A3"),
        (["--count", "9", "--out", str(tmp_path / "b.pdf")], "different sheets"),
        (["--out", str(tmp_path / "no" / "b.pdf")], "does not exist"),
    ):
        assert main(words) == 2
        error = capsys.readouterr().err
        assert error.startswith("error: ")
        assert said in error
    assert not (tmp_path / "b.pdf").exists()
