"""Kinds of damage to one file, each a function of the path and a generator of random numbers."""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np

Damage = Callable[[Path, np.random.Generator], None]
NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.])")


def _kept(share: float) -> Damage:
    def damage(path: Path, rng: np.random.Generator) -> None:
        data = path.read_bytes()
        path.write_bytes(data[: int(share * len(data))])

    return damage


def _first_bytes(path: Path, rng: np.random.Generator) -> None:
    path.write_bytes(path.read_bytes()[: int(rng.integers(1, 40))])


def _last_bytes_lost(path: Path, rng: np.random.Generator) -> None:
    path.write_bytes(path.read_bytes()[: -int(rng.integers(1, 9))])


def _flipped(count: int, first: int | None = None) -> Damage:
    """Bits turned over, anywhere or among the first bytes."""

    def damage(path: Path, rng: np.random.Generator) -> None:
        data = np.frombuffer(path.read_bytes(), np.uint8).copy()
        at = rng.integers(0, min(len(data), first or len(data)), count)
        data[at] ^= (1 << rng.integers(0, 8, count)).astype(np.uint8)
        path.write_bytes(data.tobytes())

    return damage


def _block(value: int, share: float, start: float) -> Damage:
    """One value from a place on."""

    def damage(path: Path, rng: np.random.Generator) -> None:
        data = bytearray(path.read_bytes())
        a = int(start * len(data)) + int(rng.integers(0, 16))
        length = max(4, int(share * len(data)))
        data[a : a + length] = bytes([value]) * len(data[a : a + length])
        path.write_bytes(bytes(data))

    return damage


def _random(path: Path, rng: np.random.Generator) -> None:
    path.write_bytes(rng.bytes(len(path.read_bytes())))


def _random_after_head(path: Path, rng: np.random.Generator) -> None:
    data = path.read_bytes()
    path.write_bytes(data[:64] + rng.bytes(max(0, len(data) - 64)))


def _instead(data: bytes) -> Damage:
    return lambda path, rng: path.write_bytes(data) and None


def _appended(path: Path, rng: np.random.Generator) -> None:
    path.write_bytes(path.read_bytes() + rng.bytes(5000))


def _doubled(path: Path, rng: np.random.Generator) -> None:
    path.write_bytes(path.read_bytes() * 2)


def _utf16(path: Path, rng: np.random.Generator) -> None:
    path.write_bytes(path.read_bytes().decode("latin-1").encode("utf-16"))


BYTES: dict[str, Damage] = {
    "empty": _kept(0),
    "first bytes": _first_bytes,
    "a tenth": _kept(0.1),
    "half": _kept(0.5),
    "last bytes lost": _last_bytes_lost,
    "3 bits flipped": _flipped(3),
    "100 bits flipped": _flipped(100),
    "8 bits flipped in the head": _flipped(8, 64),
    "zeros in the middle": _block(0, 0.2, 0.4),
    "ones in the head": _block(255, 0, 0.001),
    "zeros from the start": _block(0, 0.02, 0),
    "random": _random,
    "random after the head": _random_after_head,
    "appended": _appended,
    "doubled": _doubled,
    "text": _instead(b"This is no such file, and was never meant to be one.\n" * 3),
    "web page": _instead(b"<!DOCTYPE html><html><body>404 Not Found</body></html>"),
    "zip": _instead(b"PK\x05\x06" + bytes(18)),
    "only zeros": _instead(bytes(4096)),
}


def _numbers(text: bytes, count: int) -> Damage:
    """Some numbers of a text exchanged."""

    def damage(path: Path, rng: np.random.Generator) -> None:
        data = path.read_bytes()
        found = list(NUMBER.finditer(data))
        chosen = sorted(rng.choice(len(found), min(count, len(found)), replace=False)) if found else []
        for i in reversed(chosen):
            data = data[: found[i].start()] + text + data[found[i].end() :]
        path.write_bytes(data)

    return damage


def _nested(path: Path, rng: np.random.Generator) -> None:
    """As deep as a file of 200 kB can be, in place of the first number."""
    data = path.read_bytes()
    deep = b"[" * 100_000 + b"]" * 100_000
    found = NUMBER.search(data)
    path.write_bytes(data[: found.start()] + deep + data[found.end() :] if found else deep)


def _json_changed(value: object) -> Damage:
    """One value of a JSON file, at a random depth, exchanged; other text gets that value's text as a line."""

    def damage(path: Path, rng: np.random.Generator) -> None:
        try:
            content = json.loads(path.read_bytes())
        except ValueError:
            path.write_bytes(path.read_bytes() + f"\n{value}\n".encode())
            return
        place = content
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            key = keys[int(rng.integers(len(keys)))]
            inner = place[key]
            if not (isinstance(inner, dict | list) and inner) or rng.random() < 0.3:
                break
            place = inner
        if value is ...:
            del place[key]
        else:
            place[key] = value
        path.write_text(json.dumps(content))

    return damage


TEXT: dict[str, Damage] = {
    "nan": _numbers(b"NaN", 3),
    "inf": _numbers(b"Infinity", 3),
    "all inf": _numbers(b"Infinity", 10**9),
    "1e308": _numbers(b"1e308", 3),
    "all 1e308": _numbers(b"-1e308", 10**9),
    "1e-300": _numbers(b"1e-300", 3),
    "all 0": _numbers(b"0", 10**9),
    "minus": _numbers(b"-1", 3),
    "many digits": _numbers(b"9" * 5000, 2),
    "huge": _numbers(b"99999999999", 3),
    "all huge": _numbers(b"99999999999", 10**9),
    "words": _numbers(b"many", 3),
    "nothing": _numbers(b"", 3),
    "deep nesting": _nested,
    "null": _json_changed(None),
    "list": _json_changed([]),
    "object": _json_changed({"a": 1}),
    "string": _json_changed("x"),
    "true": _json_changed(True),
    "removed": _json_changed(...),
    "utf-16": _utf16,
}


def _gone(path: Path) -> None:
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def _unreadable(path: Path, rng: np.random.Generator) -> None:
    path.chmod(0)


def _pipe(path: Path, rng: np.random.Generator) -> None:
    _gone(path)
    os.mkfifo(path)


def _folder(path: Path, rng: np.random.Generator) -> None:
    _gone(path)
    path.mkdir()


def _linked(to: str) -> Damage:
    def damage(path: Path, rng: np.random.Generator) -> None:
        _gone(path)
        path.symlink_to(to.replace("SELF", path.name))

    return damage


def _socket(path: Path, rng: np.random.Generator) -> None:
    _gone(path)
    with socket.socket(socket.AF_UNIX) as one:
        before = Path.cwd()
        os.chdir(path.parent)  # names of sockets are short
        one.bind(path.name)
        os.chdir(before)


def _missing(path: Path, rng: np.random.Generator) -> None:
    _gone(path)


SPECIAL: dict[str, Damage] = {
    "unreadable": _unreadable,
    "pipe": _pipe,
    "folder": _folder,
    "link to nowhere": _linked("nowhere"),
    "link to itself": _linked("SELF"),
    "link to a device": _linked("/dev/zero"),
    "socket": _socket,
    "missing": _missing,
}
