"""Imports go one way: from room to room, from wing to wing inside `recon/`, and never in a circle."""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("procmodels", "datasets", "nnproc", "recon")
# Each wing of recon/ may import those before it; wings of one row may import each other, but never in a circle.
WINGS = (
    ("scene", "system", "store"),
    ("geometry",),
    ("sheet",),
    ("files",),
    ("cameras", "masks"),
    ("shapes",),
    ("fitting",),
    ("appearance",),
    ("outputs",),
    ("pipelines",),
    ("api", "command", "__main__"),
    ("batch", "viewer", "evaluate"),
)
ROW = {wing: i for i, row in enumerate(WINGS) for wing in row}
FILES = {
    ".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): f
    for room in ROOMS
    for f in sorted((ROOT / room).rglob("*.py"))
}


def _named(path):
    """Every dotted name that a file imports, wherever it does."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def _imports(module):
    """The project's modules that a module imports itself (not the packages that they lie in)."""
    named = set(_named(FILES[module]))
    return {n for n in named if n in FILES and not any(m.startswith(f"{n}.") for m in named)} - {module}


def _wing(module):
    return module.split(".")[1]


@pytest.mark.parametrize("module", FILES)
def test_imports_go_one_way(module):
    room = ROOMS.index(module.split(".")[0])
    for name in _named(FILES[module]):
        top = name.split(".")[0]
        if top in ROOMS:
            assert ROOMS.index(top) <= room, f"{module} imports {name}"
        if top in ("bpy", "bmesh", "mathutils"):
            assert ROOMS[room] == "procmodels"
        if top == "pycolmap":
            assert module in ("recon.cameras.poses", "recon.geometry.lenses")
        assert top not in ("pickle", "dill", "joblib"), "nothing is unpickled"


@pytest.mark.parametrize("module", [m for m in FILES if m.count(".") and m.startswith("recon.")])
def test_a_wing_knows_only_the_wings_before_it(module):
    for other in _imports(module):
        if other.startswith("recon."):
            assert ROW[_wing(other)] <= ROW[_wing(module)], f"{module} imports {other}"


def test_every_file_of_recon_has_a_wing():
    assert {_wing(m) for m in FILES if m.startswith("recon.")} <= set(ROW)


def test_no_two_files_import_each_other_in_a_circle():
    settled, walked = set(), []

    def walk(module):
        assert module not in walked, " -> ".join([*walked[walked.index(module) :], module])
        if module not in settled:
            walked.append(module)
            for other in sorted(_imports(module)):
                walk(other)
            settled.add(walked.pop())

    for module in FILES:
        walk(module)


def test_the_readme_names_every_room_and_stage():
    from recon.pipelines.photos import STAGES

    readme = (ROOT / "README.md").read_text()
    assert all(f"`{room}/`" in readme for room in ROOMS)
    assert ", ".join(STAGES) in readme
