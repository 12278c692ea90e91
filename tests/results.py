"""Whether the files of a run can be opened by those who get them."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import cv2
import numpy as np
import trimesh

from tests.procmodels.closed import open_edges, triangles_of_stl

BLENDS = (b"BLENDER", b"\x28\xb5\x2f\xfd")  # how a .blend begins, plain or packed by Zstandard


def assert_opens(path: Path) -> None:
    """Fails unless the file holds what its ending promises."""
    ending = path.suffix
    if ending in (".glb", ".obj"):
        mesh = trimesh.load(path, force="mesh")
        assert len(mesh.faces) > 10, path
        assert np.isfinite(mesh.vertices).all(), path
        assert mesh.extents.max() > 0, path
    elif ending == ".blend":
        assert path.read_bytes().startswith(BLENDS), path
    elif ending == ".stl":
        assert open_edges(triangles_of_stl(path.read_bytes())) == 0, path
    elif ending == ".usdz":
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None, path
            assert archive.namelist()[0].endswith((".usdc", ".usda", ".usd")), path
    elif ending == ".json":
        assert json.loads(path.read_text()), path
    elif ending == ".html":
        page = path.read_text()
        assert page.startswith("<!doctype html>"), path
        assert page.rstrip().endswith("</html>"), path
    elif ending == ".png":
        picture = cv2.imread(str(path))
        assert picture is not None, path
        assert picture.std() > 1, f"{path} is of one colour"
    else:
        raise AssertionError(f"{path}: nothing is known of such files")
