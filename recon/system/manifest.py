"""Which files of a results folder are this command's own: its manifest lists them with their hashes.

The manifest lies in the folder's .recon. Where it is missing (results of version 0.2.0, or .recon was removed), a run's
files are recognised by its report.json, which was written last: they are as old as the report says that writing took.
A file that was put there or changed since is another's.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from recon.system.whole_files import write_bytes

WORK = ".recon"  # below the output folder: results of the stages, the manifest, the lock
FILES = (
    "mesh.glb",
    "mesh.obj",
    "mesh.mtl",
    "texture.jpg",
    "mesh.stl",
    "mesh.usdz",
    "model.blend",
    "params.json",
    "report.json",
    "report.html",
    "contact_sheet.png",
)
FOLDERS = ("cameras", "masks")
NAME = "manifest.json"
_SLACK = 10.0, 2.0  # seconds before and after: clocks of file systems are coarse, and a disk may be slow


@dataclass(frozen=True)
class Manifest:
    """Hashes by path relative to the folder.

    files   what is there
    coming  what is just being moved there to replace it, None when nothing is: a killed run left it half done
    """

    files: dict[str, str] = field(default_factory=dict)
    coming: dict[str, str] | None = None

    def knows(self, name: str) -> bool:
        """Whether a file of this name was written here."""
        return name in self.files or name in (self.coming or {})

    def unchanged(self, out: Path, name: str) -> bool:
        """Whether the file is there exactly as it was written."""
        path = out / name
        return is_file(path) and file_hash(path) in (self.files.get(name), (self.coming or {}).get(name))


def read(out: Path) -> Manifest:
    """The manifest of a results folder; of one without, or with a damaged one, what its report.json vouches for."""
    try:
        content = json.loads((out / WORK / NAME).read_text(encoding="utf-8"))
        found = Manifest(content["files"], content["coming"])
        if content["checksum"] == _checksum(found) and all(map(_is_result, (*found.files, *(found.coming or {})))):
            return found
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        pass  # absent or damaged
    return Manifest({name: file_hash(out / name) for name in _of_report(out)})


def write(out: Path, manifest: Manifest) -> None:
    """Store the manifest. Raises OSError, and ValueError for names that are no result's, which `read` refuses."""
    if strange := [n for n in (*manifest.files, *(manifest.coming or {})) if not _is_result(n)]:
        raise ValueError(f"{strange[0]} is no file of a result: FILES lacks it")
    content = {"files": manifest.files, "coming": manifest.coming, "checksum": _checksum(manifest)}
    write_bytes(out / WORK / NAME, (json.dumps(content, indent=1) + "\n").encode(), durable=True)


def _checksum(manifest: Manifest) -> str:
    return hashlib.sha256(json.dumps([manifest.files, manifest.coming], sort_keys=True).encode()).hexdigest()


def _is_result(name: str) -> bool:
    """Whether a path relative to the folder can be a result's: nobody else's manifest may lead out of the folder."""
    return name in FILES or (Path(name).parts[0] in FOLDERS and ".." not in Path(name).parts)


def _of_report(out: Path) -> list[str]:
    """Names of results that are as old as their report.json."""
    report = out / "report.json"
    if not is_report(report):
        return []
    took = float(json.loads(report.read_text(encoding="utf-8"))["seconds"]["outputs"])
    end = report.stat().st_mtime
    first, last = end - took - _SLACK[0], end + _SLACK[1]
    names = [*FILES, *(name for folder in FOLDERS if is_folder(out / folder) for name in files_below(out, folder))]
    return [n for n in names if is_file(out / n) and first <= (out / n).stat().st_mtime <= last]


def is_report(path: Path) -> bool:
    """Whether a file is the report.json of a run."""
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8")) if is_file(path) else None
        return "nnproc-recon" in content["versions"] and content["seconds"]["outputs"] >= 0 and "params" in content
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


def is_own_picture(path: Path) -> bool:
    """Whether a picture in a folder is the contact sheet of an earlier run, and no photo."""
    return path.name == "contact_sheet.png" and is_report(path.with_name("report.json"))


def is_file(path: Path) -> bool:
    """Whether there is a regular file itself, no link to one."""
    return path.exists() and stat.S_ISREG(path.lstat().st_mode)


def is_folder(path: Path) -> bool:
    """Whether there is a folder itself, no link to one."""
    return path.is_dir() and not path.is_symlink()


def files_below(out: Path, folder: str) -> Iterator[str]:
    """Everything in a folder of `out` that is no folder, as paths relative to `out`; links are not followed."""
    for place, folders, names in os.walk(out / folder):
        inside = Path(place)
        linked = [name for name in folders if (inside / name).is_symlink()]
        for name in sorted((*names, *linked)):
            yield str((inside / name).relative_to(out))


def file_hash(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
