"""OBJ files as people have them: any encoding and line ends, indents, continued lines, words that nobody knows.

Read in portions: only vertices' places and faces' corners are kept.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from recon.files.head import Head, decoded
from recon.files.polygons import fans
from recon.files.shape import Cloud, Kind, Recognised, Surface, counted, not_too_many
from recon.scene import InputError
from recon.system import limits

_PORTION = 1 << 24  # bytes
_VERTEX = re.compile(r"^[ \t]*v[ \t]+\S", re.MULTILINE)
_WORDS = re.compile(r"^[ \t]*(v|vt|vn|f|o|g|s|usemtl|mtllib)[ \t]+\S", re.MULTILINE)
_SEEN = 1 << 20  # bytes of comments that may come before the first vertex


def is_obj(head: Head) -> bool:
    """Whether it is text whose first words are OBJ's, after any comments."""
    if head.text is None:
        return False
    text = head.text
    if not text or not _WORDS.search(text):
        with head.path.open("rb") as file:
            text = decoded(file.read(_SEEN)) or ""
    lines = [
        line
        for line in re.sub(r"\\[ \t]*\n", " ", text).splitlines()
        if line.strip() and not line.lstrip().startswith("#")
    ]
    ours = sum(bool(_WORDS.match(line)) for line in lines[:200])
    return ours > 0.5 * len(lines[:200]) and bool(
        _VERTEX.search(text) or len(text) >= _SEEN // 4 or _has_vertices(head.path)
    )


def _has_vertices(path: Path) -> bool:
    return any(_VERTEX.search(text.decode("latin-1")) for text in _portions(path))


def describe(path: Path) -> Recognised:
    """Faces, vertices and parts, counted."""
    faces = vertices = parts = 0
    for text in _portions(path):
        faces += len(re.findall(rb"^[ \t]*f[ \t]", text, re.MULTILINE))
        vertices += len(re.findall(rb"^[ \t]*v[ \t]", text, re.MULTILINE))
        parts += len(re.findall(rb"^[ \t]*o[ \t]", text, re.MULTILINE))
    not_too_many(path, max(faces, vertices))
    if not faces:
        return Recognised(Kind.CLOUD, f"{vertices:,} points of an OBJ file")
    return Recognised(
        Kind.MESH, f"a mesh of {counted(faces, 'face')}" + (f" in {parts} parts" if parts > 1 else "") + " (OBJ)"
    )


def read(path: Path) -> Surface | Cloud:
    """Faces as triangles, or points when there are none. Raises ValueError for words that are no numbers."""
    points, counts, corners, known = [np.zeros((0, 3))], [], [], 0
    for text in _portions(path):
        lines = [line.strip() for line in text.split(b"\n")]
        found, seen = _places([line[2:] for line in lines if line[:2] in (b"v ", b"v\t")]), known
        points.append(found)
        faces = [line[2:] for line in lines if line[:2] in (b"f ", b"f\t")]
        if any(b"-" in face for face in faces):
            faces = []
            for line in lines:
                seen += line[:2] in (b"v ", b"v\t")
                if line[:2] in (b"f ", b"f\t"):
                    faces.append(_absolute(line[2:], seen))
        words = [face.partition(b"#")[0].split() for face in faces]
        counts.append(np.array([len(w) for w in words], int))
        flat = list(chain.from_iterable(words))
        corners.append(np.array([int(w.partition(b"/")[0]) for w in flat], np.int64) - 1)
        known += len(found)
    if not counts or not sum(map(len, corners)):
        return Cloud(np.concatenate(points))
    return Surface(np.concatenate(points), fans(np.concatenate(counts), np.concatenate(corners)))


def _absolute(face: bytes, known: int) -> bytes:
    """Corners counted back from the last vertex, counted from the first."""
    corners = (int(word.partition(b"/")[0]) for word in face.partition(b"#")[0].split())
    return b" ".join(b"%d" % (known + 1 + c if c < 0 else c) for c in corners)


def _places(lines: list[bytes]) -> np.ndarray:
    """(n, 3) float of lines without their `v`; decimal commas are read where white space separates the numbers."""
    if any(b"," in line for line in lines):
        lines = [_with_points(line) for line in lines]
    words = [line.split(None, 3)[:3] for line in lines]
    if any(len(w) < 3 for w in words):
        raise ValueError("a vertex has fewer than three numbers")
    return np.array(list(map(float, chain.from_iterable(words)))).reshape(-1, 3)


def _with_points(line: bytes) -> bytes:
    words = line.split()
    decimal = len(words) >= 3 and all(re.fullmatch(rb"[-+]?\d*,?\d*([eE][-+]?\d+)?", word) for word in words)
    return line.replace(b",", b".") if decimal else line.replace(b",", b" ")


def _portions(path: Path) -> Iterator[bytes]:
    """The file in portions of whole lines, in UTF-8, lines that go on joined, every line ended by a newline alone."""
    if path.stat().st_size > limits.TEXT:
        raise InputError(
            f"{path} is an OBJ file of more than {limits.TEXT >> 30} GB; decimate it, or save it as binary PLY"
        )
    with path.open("rb") as file:
        begin = file.read(4)
        file.seek(3 if begin.startswith(b"\xef\xbb\xbf") else 0)
        if begin[:2] in (b"\xff\xfe", b"\xfe\xff"):
            yield _joined((decoded(file.read()) or "").encode())
            return
        rest = b""
        while data := file.read(_PORTION):
            whole = (rest + data).replace(b"\r\n", b"\n")
            end = max(whole.rfind(b"\n"), whole.rfind(b"\r", 0, -1)) + 1
            while end and whole[: end - 1].rstrip(b" \t").endswith(b"\\"):
                end = max(whole.rfind(b"\n", 0, end - 1), whole.rfind(b"\r", 0, end - 1)) + 1
            rest = whole[end:]
            yield _joined(whole[:end])
        yield _joined(rest)


def _joined(text: bytes) -> bytes:
    return re.sub(rb"\\[ \t]*\n", b" ", text.replace(b"\r\n", b"\n").replace(b"\r", b"\n"))
