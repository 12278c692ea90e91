"""A list of mixed inputs that are quick to fit, every ninth of them bad."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import trimesh

import procmodels
from datasets.voxels import surface_grid
from nnproc.rays import look_at_cameras
from recon.geometry.raster import silhouettes

BAD = ("damaged", "missing", "misplaced")  # kinds of bad inputs, by turns


def listed(folder: Path, count: int, bad: int) -> Path:
    """A CSV list of `count` inputs, `bad` of them bad, and the files beside it."""
    folder.mkdir(parents=True)
    places = {round((i + 0.5) * count / bad): BAD[i % len(BAD)] for i in range(bad)}
    rows = [_bad(folder, n, places[n]) if n in places else _good(folder, n) for n in range(count)]
    path = folder / "list.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, ("input", "name", "up", "height", "frames"))
        writer.writeheader()
        writer.writerows(rows)
    return path


def _good(folder: Path, number: int) -> dict[str, object]:
    """Shape `number` as a mesh, a cloud, voxels or a mask."""
    model, rng = procmodels.load("paper/chair"), np.random.default_rng([15, number])
    shape = model.build(model.space.sample(rng))
    mesh = shape.to_trimesh()
    row: dict[str, object] = {"name": f"object-{number}", "up": "z", "height": 0.9 if number % 2 else ""}
    if number % 20 == 7:
        path = folder / f"{number}.png"
        K, pose = (t[0].numpy() for t in look_at_cameras([35.0], [20.0], 2.3, 40, 240))
        mask = silhouettes(shape, K[None], pose[None], np.array([(240, 240)]))[0]
        cv2.imwrite(str(path), mask.astype(np.uint8) * 255)
        del row["up"]
    elif number % 10 == 3:
        path = folder / f"{number}.npz"
        np.savez_compressed(path, grid=surface_grid(mesh.vertices, mesh.faces, scratch=folder / "scratch.ply"))
    elif number % 3 == 1:
        path = folder / f"{number}.xyz"
        np.savetxt(path, np.asarray(trimesh.sample.sample_surface(mesh, 3000, seed=number)[0]), fmt="%.5f")
    else:
        path = folder / f"{number}{('.ply', '.obj', '.stl')[number // 3 % 3]}"
        mesh.export(path)
    return {"input": path.name, **row}


def _bad(folder: Path, number: int, kind: str) -> dict[str, object]:
    """An input that is cut off, one that is not there, or one with an option that is not for it."""
    row: dict[str, object] = {"input": f"{number}.obj", "name": f"{kind}-{number}"}
    if kind == "damaged":
        (folder / f"{number}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1")
    elif kind == "misplaced":
        trimesh.creation.box().export(folder / f"{number}.obj")
        row["frames"] = 12
    return row
