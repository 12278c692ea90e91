"""Furniture catalogues of Sweet Home 3D: `.sh3f` files are zip archives of OBJ models with a properties file.

The models are Y-up, face +Z and are in arbitrary units; the catalogue gives their size in centimetres.
"""

from __future__ import annotations

import posixpath
import re
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from datasets.catalogue_object import DataError

PROPERTIES = "PluginFurnitureCatalog.properties"
MAX_FILE = 64 << 20  # bytes, unpacked: larger members are refused
MAX_PROPERTIES = 8 << 20  # bytes: the text of thousands of models; in memory it takes fifty times as much
MAX_MODEL = 256 << 20  # bytes, unpacked: all files of one model


class CatalogueError(DataError):
    """The catalogue or a model in it is not usable; the message says why."""


@dataclass(frozen=True)
class Model:
    """One entry of a catalogue.

    name      file name of its OBJ without extension (unique enough to ask for it)
    title     what a person reads
    member    path of the OBJ inside the archive
    size      (width, depth, height) in centimetres
    rotation  nine numbers, row by row: turn that the catalogue wants before use, in the file's axes
    """

    name: str
    title: str
    member: str
    creator: str
    licence: str
    size: tuple[float, float, float]
    rotation: tuple[float, ...]


def read_catalogue(path: Path) -> list[Model]:
    """All models of a catalogue, in its order."""
    with _open(path) as archive:
        text = _read(archive, PROPERTIES, MAX_PROPERTIES).decode("latin-1")
    table = dict(re.findall(r"^\s*([\w#]+)\s*[=:]\s*(.*?)\s*$", text, re.MULTILINE))
    numbers = sorted(int(key[6:]) for key in table if re.fullmatch(r"model#\d{1,9}", key))
    return [_model(table, n) for n in numbers]


def _model(table: dict[str, str], n: int) -> Model:
    member = table[f"model#{n}"].lstrip("/")
    try:
        width, depth, height = (float(table.get(f"{key}#{n}", "0")) for key in ("width", "depth", "height"))
        rotation = tuple(float(v) for v in table.get(f"modelRotation#{n}", "1 0 0 0 1 0 0 0 1").split())
    except ValueError as error:
        raise CatalogueError(f"entry {n} ({member}): {error}") from error
    if len(rotation) != 9:
        raise CatalogueError(f"entry {n} ({member}): modelRotation needs nine numbers, got {len(rotation)}")
    return Model(
        name=PurePosixPath(member).stem,
        title=table.get(f"name#{n}", ""),
        member=member,
        creator=table.get(f"creator#{n}", ""),
        licence=table.get(f"license#{n}", table.get("license", "")),
        size=(width, depth, height),
        rotation=rotation,
    )


def find_model(path: Path, name: str) -> Model:
    """The model of this name; an unknown name lists near ones."""
    models = read_catalogue(path)
    for model in models:
        if model.name == name:
            return model
    near = [m.name for m in models if name.lower() in m.name.lower()] or [m.name for m in models]
    more = "" if len(near) <= 20 else f" and {len(near) - 20} more"
    raise CatalogueError(f"{path.name}: no model {name!r}; there are {', '.join(near[:20])}{more}")


def read_obj(path: Path, model: Model) -> bytes:
    """The OBJ of a model as it is in the archive; enough where only geometry is wanted."""
    with _open(path) as archive:
        return _read(archive, model.member)


def extract_model(path: Path, model: Model, folder: Path) -> Path:
    """Write the OBJ, its MTL files and their textures into `folder`; returns the OBJ's path.

    Only files that the model refers to are written, at their places relative to the OBJ, and never outside `folder`.
    """
    with _open(path) as archive:
        home = posixpath.dirname(model.member)
        files = _collect(archive, model.member, home)
    for member, data in files.items():
        target = folder / posixpath.relpath(member, home or ".")
        if not target.resolve().is_relative_to(folder.resolve()):
            raise CatalogueError(f"{path.name}: {member} would be written outside {folder}")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
    return folder / PurePosixPath(model.member).name


def _collect(archive: zipfile.ZipFile, obj: str, home: str) -> dict[str, bytes]:
    """The bytes of an OBJ and of every file below its folder that it refers to, by member name."""
    files: dict[str, bytes] = {}
    _add(files, archive, obj)
    for mtl in _references(files[obj], rb"mtllib"):
        found = _locate(archive, home, mtl)
        if found is None:
            continue
        _add(files, archive, found)
        for texture in _references(files[found], rb"(?:map_\w+|bump|disp|refl)"):
            member = _locate(archive, home, texture)
            if member is not None and member not in files:
                _add(files, archive, member)
    return files


def _add(files: dict[str, bytes], archive: zipfile.ZipFile, member: str) -> None:
    """One more member; raises CatalogueError before it is read when all together would be more than MAX_MODEL."""
    declared = archive.getinfo(member).file_size if member in archive.namelist() else 0
    if sum(map(len, files.values())) + declared > MAX_MODEL:
        raise CatalogueError(f"{member}: more than {MAX_MODEL >> 20} MB of files")
    files[member] = _read(archive, member)


def _references(text: bytes, keyword: bytes) -> list[str]:
    """File names after a keyword at the start of a line."""
    found = re.findall(rb"^[ \t]*" + keyword + rb"[ \t]+(.+?)[ \t\r]*$", text, re.MULTILINE)
    return [name.decode("utf-8", "replace").replace("\\", "/") for name in found]


def _locate(archive: zipfile.ZipFile, home: str, reference: str) -> str | None:
    """The member below `home` that a reference means (a name may hold blanks or follow options), or None."""
    names = set(archive.namelist())
    for text in (reference, reference.split()[-1]):
        member = posixpath.normpath(posixpath.join(home, text))
        if member in names and not posixpath.relpath(member, home or ".").startswith(".."):
            return member
    return None


def _open(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except FileNotFoundError as error:
        raise CatalogueError(f"{path}: no such file") from error
    except (zipfile.BadZipFile, OSError) as error:
        raise CatalogueError(f"{path}: not a .sh3f catalogue ({error})") from error


def _read(archive: zipfile.ZipFile, member: str, most: int | None = None) -> bytes:
    """A member's bytes; the declared size is checked first and the real one never exceeds it by more than a byte."""
    try:
        most = MAX_FILE if most is None else most
        info = archive.getinfo(member)
        if info.file_size > most:
            raise CatalogueError(f"{member}: {info.file_size >> 20} MB unpacked, more than {most >> 20} MB")
        with archive.open(info) as stream:
            data = stream.read(most + 1)
    except KeyError as error:
        raise CatalogueError(f"{archive.filename}: there is no {member} in it") from error
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise CatalogueError(f"{archive.filename}: {member} is damaged ({error})") from error
    if len(data) > most:
        raise CatalogueError(f"{member}: more than {most >> 20} MB unpacked")
    return data
