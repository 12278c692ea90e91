"""Rows of numbers out of large files: a part of them drawn while they are read, so that memory stays small."""

from __future__ import annotations

import warnings
from typing import IO

import numpy as np

BLOCK = 1 << 24  # bytes that are read at once


def kept(count: int, most: int, seed: int = 0) -> np.ndarray:
    """(m,) int, sorted indices of at most `most` of `count` rows.

    One at random out of every stretch of equal length: every k-th would be one column of a scanner's picture.
    """
    if count <= most:
        return np.arange(count)
    ends = np.linspace(0, count, most + 1).astype(np.int64)
    return ends[:-1] + (np.random.default_rng(seed).random(most) * np.diff(ends)).astype(np.int64)


def picked(file: IO[bytes], kind: np.dtype, count: int, rows: np.ndarray, names: list[str] | None = None) -> np.ndarray:
    """(len(rows),) records of type `kind`: those at the sorted indices `rows` of the next `count` ones in the file.

    names  fields that are kept, of wide records; None: all
    Raises ValueError when the file ends before.
    """
    out = np.empty(len(rows), kind if names is None else [(name, kind[name]) for name in names])
    step, done = max(1, BLOCK // kind.itemsize), 0
    for start in range(0, count, step):
        number = min(step, count - start)
        data = file.read(number * kind.itemsize)
        if len(data) < number * kind.itemsize:
            raise ValueError(
                f"it is cut short: {start + len(data) // kind.itemsize:,} rows, its header promises {count:,}"
            )
        end = int(np.searchsorted(rows, start + number))
        some = np.frombuffer(data, kind)[rows[done:end] - start]
        if names is None:
            out[done:end] = some
        for name in names or ():
            out[name][done:end] = some[name]
        done = end
    return out


def numbers(text: bytes) -> np.ndarray:
    """(n,) float: all numbers of a text between white space. Raises ValueError when a word is none."""
    if not text.strip():
        return np.zeros(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, sep=" ")  # a list of words would take ten times the memory
        except DeprecationWarning as error:
            raise ValueError("a word among its numbers is none") from error
