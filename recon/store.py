"""Stage results on disk, so that a finished stage is skipped and an interrupted run goes on.

A result (frozen dataclasses of arrays, paths, numbers, text) becomes NAME.json and NAME.npz beside it; nothing is
unpickled. NAME.json carries a key: a hash over the stage's options, the contents of its inputs and the results of the
stages before it. A result whose key differs is stale, whatever its date.

The first line of NAME.json is the SHA-256 of all that follows it, and that holds the SHA-256 of NAME.npz and of every
file that the result names. What does not match in every bit is not used.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import os
import types
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recon.system import scratch
from recon.system.digests import digest, file_digest

log = logging.getLogger("recon")


class Damaged(Exception):
    """A stored result that is not what was stored; the message says what is wrong with it."""


@dataclass(frozen=True)
class Stored:
    """A stage's result, the seconds that computing it took, and a digest of its content."""

    result: Any
    seconds: float
    content: str


class Store:
    """Results below one folder. `known` are the dataclasses that may be read back."""

    def __init__(self, folder: Path, known: Iterable[type]) -> None:
        self.folder = folder
        self.known = {t.__name__: t for t in known}

    def load(self, name: str, key: str) -> Stored | None:
        """The stored result; None when it is absent or stale, or (which is said) damaged."""
        try:
            return self._load(name, key)
        except (Damaged, OSError) as error:
            why = str(error)
        except (KeyError, TypeError, ValueError):  # it is whole, but its fields and types are not (or no longer) these
            why = f"{self.folder / name}.json was written by other code"
        log.warning("the stored result of %s is computed anew: %s", name, why)
        return None

    def _load(self, name: str, key: str) -> Stored | None:
        path, packed = self.folder / f"{name}.json", self.folder / f"{name}.npz"
        if not path.exists():
            return None
        if not path.is_file():
            raise Damaged(f"{path} is no file")
        told, _, body = path.read_bytes().partition(b"\n")
        if _sha256(body).encode() != told:
            raise Damaged(f"{path} is damaged")
        content = json.loads(body)
        if content["stage"] != name:
            raise Damaged(f"{path} is that of {content['stage']}")
        if content["key"] != key:
            return None
        _check(packed, content["npz"])
        for file, expected in content["files"].items():
            _check(self.folder / file, expected)
        with np.load(packed, allow_pickle=False) as arrays:
            return Stored(self._decode(content["result"], dict(arrays)), content["seconds"], _digest_of(content))

    def save(self, name: str, key: str, result: Any, seconds: float) -> str:
        """Write a result and what it took; returns the digest of its content.

        The JSON goes last, so that a kill leaves nothing that looks whole. Raises OSError.
        """
        arrays: dict[str, np.ndarray] = {}
        files: dict[str, str] = {}
        tree = self._encode(result, arrays, files)
        packed = io.BytesIO()
        np.savez(packed, **arrays)
        npz = _sha256(packed.getvalue())
        content = {"stage": name, "key": key, "seconds": seconds, "npz": npz, "files": files, "result": tree}
        body = json.dumps(content).encode()
        self.forget([name])
        with scratch.folder(self.folder) as partial:
            for ending, data in (("npz", packed.getvalue()), ("json", _sha256(body).encode() + b"\n" + body)):
                (partial / name).write_bytes(data)
                (partial / name).replace(self.folder / f"{name}.{ending}")
        return _digest_of(content)

    def forget(self, names: Iterable[str]) -> None:
        """Remove stored results."""
        for name in names:
            for ending in ("json", "npz"):
                scratch.remove(self.folder / f"{name}.{ending}")

    def _encode(self, value: Any, arrays: dict[str, np.ndarray], files: dict[str, str]) -> Any:
        """`value` as JSON; its arrays go to `arrays`, the digests of the files that it names to `files`."""

        def encoded(inner: Any) -> Any:
            return self._encode(inner, arrays, files)

        if is_dataclass(value) and not isinstance(value, type):
            inner = {f.name: encoded(getattr(value, f.name)) for f in fields(value)}
            return {"type": type(value).__name__, "fields": inner}
        if isinstance(value, np.ndarray):
            name = f"a{len(arrays)}"
            arrays[name] = value
            return {"array": name}
        if isinstance(value, Path):
            place = os.path.relpath(value.resolve(), self.folder.resolve())  # a results folder may be moved
            files[place] = file_digest(value)
            return {"path": place}
        if isinstance(value, dict):
            return {"dict": {k: encoded(v) for k, v in value.items()}}
        if isinstance(value, tuple | list):
            return [encoded(v) for v in value]
        return value.item() if isinstance(value, np.generic) else value

    def _decode(self, tree: Any, arrays: dict[str, np.ndarray]) -> Any:
        if isinstance(tree, list):
            return tuple(self._decode(v, arrays) for v in tree)
        if not isinstance(tree, dict):
            return tree
        if "array" in tree:
            return arrays[tree["array"]]
        if "path" in tree:
            return (self.folder / tree["path"]).resolve()
        if "dict" in tree:
            return {k: self._decode(v, arrays) for k, v in tree["dict"].items()}
        cls = self.known[tree["type"]]
        return cls(**{k: self._decode(v, arrays) for k, v in tree["fields"].items()})


def _check(path: Path, expected: str) -> None:
    """Raise Damaged when a file is not the one of this SHA-256, OSError when it cannot be read."""
    if not path.is_file():
        raise Damaged(f"{path} is gone")
    if file_digest(path) != expected:
        raise Damaged(f"{path} is damaged")


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _digest_of(content: dict[str, Any]) -> str:
    """What the stages after this one depend on: not when or how fast it was computed."""
    return digest(content["npz"], content["files"], content["result"])


def dataclasses_of(*modules: types.ModuleType) -> Iterator[type]:
    """Every dataclass that these modules define."""
    for module in modules:
        for value in vars(module).values():
            if isinstance(value, type) and is_dataclass(value) and value.__module__ == module.__name__:
                yield value
