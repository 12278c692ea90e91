"""The table of shape formats: every one is told from a file's content here, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from recon.files import arrays, binvox, blender, gltf, obj, pcd, ply, scans, sog, splat, spz, stl, table, trimesh_files
from recon.files.head import Head, head_of
from recon.files.shape import Format, Recognised, Shape
from recon.scene import InputError

T = TypeVar("T")
_Y_UP, _CAMERAS = ("y", "z"), ("z", "y", "-y")  # splats keep the cameras' axes: y down

# Those with a name inside come first, those without at the end.
FORMATS: tuple[Format, ...] = (
    Format("PLY", lambda head: head.start[:3].lower() == b"ply", ply.describe, ply.read),
    Format("GLB", gltf.is_glb, gltf.describe, gltf.read, _Y_UP),
    Format("PCD", pcd.is_pcd, pcd.describe, pcd.read),
    Format("binvox", binvox.is_binvox, binvox.describe, binvox.read),
    Format("numpy", arrays.is_arrays, arrays.describe, arrays.read),
    Format("SOG", sog.is_sog, sog.describe, sog.read, _CAMERAS),
    Format("SPZ", spz.is_spz, spz.describe, spz.read, ("y", "z", "-y")),
    Format("3MF", trimesh_files.is_3mf, trimesh_files.describe("3MF"), trimesh_files.read("3mf")),
    Format(
        "USD", blender.is_usd, trimesh_files.describe("USD"), blender.read("usd", (".usda", ".usdc", ".usd", ".usdz"))
    ),
    Format("FBX", blender.is_fbx, trimesh_files.describe("FBX"), blender.read("fbx", (".fbx",))),
    Format("Alembic", blender.is_alembic, trimesh_files.describe("Alembic"), blender.read("abc", (".abc",))),
    Format("Blender", blender.is_blend, trimesh_files.describe("Blender"), blender.read("blend", (".blend",))),
    Format("LAS", scans.is_las, scans.describe_las, scans.read("laspy")),
    Format("E57", scans.is_e57, scans.describe_e57, scans.read("pye57")),
    Format("COLLADA", trimesh_files.is_dae, trimesh_files.describe("COLLADA"), trimesh_files.read("dae"), _Y_UP),
    Format("OFF", trimesh_files.is_off, trimesh_files.describe("OFF"), trimesh_files.read("off"), _Y_UP),
    Format("STL", stl.is_text, stl.describe_text, stl.read_text),
    Format("glTF", gltf.is_gltf, gltf.describe, gltf.read, _Y_UP),
    Format("KSPLAT", splat.is_ksplat, splat.describe_ksplat, splat.read_ksplat, _CAMERAS),
    Format("SPLAT", splat.is_splat, splat.describe_splat, splat.read_splat, _CAMERAS),
    Format("STL", stl.is_binary, stl.describe_binary, stl.read_binary),
    Format("OBJ", obj.is_obj, obj.describe, obj.read, _Y_UP),
    Format("text", table.is_table, table.describe, table.read),
)


@dataclass(frozen=True)
class Unread:
    """A format that is known and not read, and what to do."""

    name: str
    begins: Callable[[bytes], bool]
    advice: str


_UNREAD = (
    Unread(
        "a STEP file of a CAD program", lambda b: b.lstrip()[:12] == b"ISO-10303-21", "export its mesh as STL or GLB"
    ),
    Unread("an IGES file of a CAD program", lambda b: b[72:80] == b"S      1", "export its mesh as STL or GLB"),
    Unread("a DXF drawing", lambda b: b.split(None, 2)[:2] == [b"0", b"SECTION"], "export its mesh as STL or OBJ"),
    Unread("a DWG drawing", lambda b: b[:4] == b"AC10", "export its mesh as STL or OBJ"),
    Unread(
        "a file of 3ds Max (or an old Office document)",
        lambda b: b[:8] == b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1",
        "export it as FBX or OBJ",
    ),
    Unread(
        "a SketchUp file",
        lambda b: b"SketchUp Model" in b[:80] or "SketchUp".encode("utf-16-le") in b[:80],
        "export it as DAE or GLB",
    ),
    Unread("a Rhino file", lambda b: b[:16] == b"3D Geometry File", "export its mesh as OBJ or STL"),
    Unread("a VRML or X3D file", lambda b: b[:5] == b"#VRML" or b"<X3D" in b[:4096], "export it as OBJ or GLB"),
    Unread(
        "a 3DS file", lambda b: b[:2] == b"MM" and b[2:4] != b"\0*" and b[6:8] == b"\x02\x00", "export it as OBJ or GLB"
    ),
    Unread("a PDF", lambda b: b[:5] == b"%PDF-", "give the model itself"),
    Unread(
        "a RAR or 7z archive",
        lambda b: b[:4] == b"Rar!" or b[:6] == b"7z\xbc\xaf\x27\x1c",
        "unpack it and give what is inside",
    ),
)


def format_of(head: Head) -> Format | None:
    """The format that a file's content shows, or None. Raises InputError for one that is known and not read."""
    for unread in _UNREAD:
        if unread.begins(head.start):
            raise InputError(f"{head.path} is {unread.name}, which is not read here; {unread.advice}")
    form = next((f for f in FORMATS if f.matches(head)), None)
    if form is None and head.start[:2] == b"\x1f\x8b":
        raise InputError(f"{head.path} is packed with gzip; unpack it and give what is inside")
    return form


def describe(head: Head, form: Format) -> Recognised:
    """What a file of this format holds. Raises InputError, for any damage too."""
    return _guarded(head.path, form.name, lambda: form.describe(head.path))


def read(path: Path, otherwise: str = "text") -> tuple[Shape, Format]:
    """What a shape's file holds, by its content; what shows none is read as the format named `otherwise`.

    Raises InputError, for any damage too.
    """
    form = format_of(head_of(path)) or next(f for f in FORMATS if f.name == otherwise)
    return _guarded(path, form.name, lambda: form.read(path)), form


def _guarded(path: Path, name: str, do: Callable[[], T]) -> T:
    try:
        return do()
    except (InputError, FileNotFoundError, PermissionError):
        raise
    except MemoryError as error:
        raise InputError(f"{path} ({name}) takes more memory than there is; decimate it or thin it out") from error
    except Exception as error:  # a reader of other people's files may fail in any way
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path} is a damaged {name} file ({said}); export it again") from error
