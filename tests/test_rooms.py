"""The rooms' imports go one way: procmodels -> datasets -> nnproc -> recon; heavy packages stay in their rooms."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("procmodels", "datasets", "nnproc", "recon")
FILES = [f for room in ROOMS for f in sorted((ROOT / room).rglob("*.py"))]


def _imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_one_way(path):
    room = ROOMS.index(path.relative_to(ROOT).parts[0])
    for name in _imports(path):
        top = name.split(".")[0]
        if top in ROOMS:
            assert ROOMS.index(top) <= room, f"{path} imports {name}"
        if top in ("bpy", "bmesh", "mathutils"):
            assert ROOMS[room] == "procmodels"
        if top == "pycolmap":
            assert path.name in ("poses.py", "lenses.py")
        assert top not in ("pickle", "dill", "joblib"), "nothing is unpickled"


def test_the_readme_names_every_room_and_stage():
    from recon.pipeline import STAGES

    readme = (ROOT / "README.md").read_text()
    assert all(f"`{room}/`" in readme for room in ROOMS)
    assert all(stage in readme for stage in STAGES)
