"""Stage results on disk, so that a finished stage is skipped and an interrupted run goes on.

A result (frozen dataclasses of arrays, paths, numbers, text) becomes NAME.json and NAME.npz beside it; nothing is
unpickled. NAME.json carries a key: a hash over the stage's options, the contents of its inputs and the keys of the
stages before it. A result whose key differs is stale, whatever its date.
"""

from __future__ import annotations

import hashlib
import json
import types
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import asdict, fields, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np


def digest(*parts: Any) -> str:
    """16 hex digits over JSON-able values, dataclasses of options and other digests."""
    plain = [asdict(p) if is_dataclass(p) and not isinstance(p, type) else p for p in parts]
    return hashlib.sha256(json.dumps(plain, sort_keys=True, default=str).encode()).hexdigest()[:16]


def folder_digest(folder: Path | None) -> str:
    """A digest of the names and contents of a folder's files (not of its subfolders); "none" for None."""
    if folder is None:
        return "none"
    files = sorted(p for p in folder.iterdir() if p.is_file())
    return digest([[p.name, hashlib.sha256(p.read_bytes()).hexdigest()] for p in files])


def code_version() -> str:
    """This project's version: results of another version are stale."""
    try:
        return version("nnproc-recon")
    except PackageNotFoundError:
        return "uninstalled"


class Store:
    """Results below one folder. `known` are the dataclasses that may be read back."""

    def __init__(self, folder: Path, known: Iterable[type]) -> None:
        self.folder = folder
        self.known = {t.__name__: t for t in known}

    def load(self, name: str, key: str) -> tuple[Any, float] | None:
        """The stored result and the seconds it took; None when absent, stale, damaged, or naming lost files."""
        try:
            content = json.loads((self.folder / f"{name}.json").read_text())
            if content["key"] != key:
                return None
            with np.load(self.folder / f"{name}.npz", allow_pickle=False) as arrays:
                return self._decode(content["result"], dict(arrays)), float(content["seconds"])
        except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
            # Whatever is wrong with a stored result, making it anew is right.
            return None

    def save(self, name: str, key: str, result: Any, seconds: float) -> None:
        """Write a result and what it took; the JSON goes last, so that a kill leaves nothing that looks whole."""
        arrays: dict[str, np.ndarray] = {}
        tree = self._encode(result, arrays)
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / f"{name}.json").unlink(missing_ok=True)
        partial = self.folder / f"{name}.npz.partial"
        with partial.open("wb") as file:
            np.savez(file, **arrays)
        partial.replace(self.folder / f"{name}.npz")
        partial = self.folder / f"{name}.json.partial"
        partial.write_text(json.dumps({"key": key, "seconds": seconds, "result": tree}))
        partial.replace(self.folder / f"{name}.json")

    def forget(self, names: Iterable[str]) -> None:
        """Remove stored results."""
        for name in names:
            (self.folder / f"{name}.json").unlink(missing_ok=True)

    def _encode(self, value: Any, arrays: dict[str, np.ndarray]) -> Any:
        if is_dataclass(value) and not isinstance(value, type):
            inner = {f.name: self._encode(getattr(value, f.name), arrays) for f in fields(value)}
            return {"type": type(value).__name__, "fields": inner}
        if isinstance(value, np.ndarray):
            name = f"a{len(arrays)}"
            arrays[name] = value
            return {"array": name}
        if isinstance(value, Path):
            return {"path": str(value.resolve())}
        if isinstance(value, dict):
            return {"dict": {k: self._encode(v, arrays) for k, v in value.items()}}
        if isinstance(value, tuple | list):
            return [self._encode(v, arrays) for v in value]
        return value.item() if isinstance(value, np.generic) else value

    def _decode(self, tree: Any, arrays: dict[str, np.ndarray]) -> Any:
        if isinstance(tree, list):
            return tuple(self._decode(v, arrays) for v in tree)
        if not isinstance(tree, dict):
            return tree
        if "array" in tree:
            return arrays[tree["array"]]
        if "path" in tree:
            path = Path(tree["path"])
            if not path.exists():
                raise ValueError(f"{path} is gone")
            return path
        if "dict" in tree:
            return {k: self._decode(v, arrays) for k, v in tree["dict"].items()}
        cls = self.known[tree["type"]]
        return cls(**{k: self._decode(v, arrays) for k, v in tree["fields"].items()})


def dataclasses_of(*modules: types.ModuleType) -> Iterator[type]:
    """Every dataclass that these modules define."""
    for module in modules:
        for value in vars(module).values():
            if isinstance(value, type) and is_dataclass(value) and value.__module__ == module.__name__:
                yield value
