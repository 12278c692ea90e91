"""How near a look comes to the true colours: of rendered photo sets, whose objects' materials are known.

    python -m recon.evaluate.colours datasets/samples/chair chair.obj

SET is a photo set with its truth (datasets.photosets), MESH the file that was photographed, with its materials beside
it. The true surface is coloured from the photos, each connected piece a part, so that only colours are measured.
Differences are Delta E of 1976 in CIELAB: 2 is just seen, 10 is another shade, 50 another colour.
"""

from __future__ import annotations

import argparse
import logging
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from datasets import staging
from datasets.photosets import Photoset, PhotosetOptions, read_photoset
from procmodels.look import Look, linear
from procmodels.shape import Part, Shape
from recon.appearance import photos
from recon.appearance.atlas import unwrapped
from recon.appearance.shapes import of_mesh
from recon.appearance.texels import Texels
from recon.evaluate.rows import Row, print_table, write_json
from recon.files.painted import PaintedMesh, painted
from recon.scene import Cameras, Canonical, InputError, Poses, Scene, Silhouettes
from recon.system import net, process
from recon.system.arguments import Parser

SMALLEST = 0.004  # share of the surface: smaller pieces (screws) are one part together
_XYZ = np.array([(0.4125, 0.3576, 0.1804), (0.2127, 0.7152, 0.0722), (0.0193, 0.1192, 0.9503)])
_WHITE = np.array([0.9505, 1.0, 1.0888])


@dataclass(frozen=True)
class Difference:
    """Delta E of every part's base colour (P,), of its places (P,) in the mean, and its share of the surface (P,)."""

    base: np.ndarray
    places: np.ndarray
    share: np.ndarray


def run(folder: Path, mesh: Path, options: photos.LookOptions = photos.LookOptions()) -> list[Row]:
    """Measure one set. Raises InputError when the mesh is not the one that was photographed, or has no colours."""
    truth = read_photoset(folder)
    source = true_colours(truth, mesh)
    shape = pieces(truth.mesh)
    started = time.process_time()
    found = photos.run(shape, true_scene(truth), options)
    seconds = time.process_time() - started
    if found.look is None:
        raise InputError(f"no photo of {folder} shows the object")
    apart = compared(shape, found.look, source)
    name = folder.name
    return [
        Row(f"{name}: Delta E of base colours, mean over {len(apart.base)} parts", float(apart.base.mean()), "<= 10"),
        Row(f"{name}: the same by the parts' surface", float(np.average(apart.base, weights=apart.share))),
        Row(f"{name}: the worst part", float(apart.base.max())),
        Row(f"{name}: Delta E of the texture", float(np.average(apart.places, weights=apart.share))),
        Row(f"{name}: seconds of processor time", seconds, "<= 15"),
    ]


def true_colours(truth: Photoset, mesh: Path) -> PaintedMesh:
    """The photographed mesh with its colours in the canonical frame."""
    found = painted(mesh)
    if not isinstance(found, PaintedMesh):
        raise InputError(f"{mesh} has no colours")
    told: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in truth.info["options"].items()}
    corners = found.corners.reshape(-1, 3)
    forward = staging.canonical_from_file(corners, mesh.suffix, PhotosetOptions(**told))
    return replace(found, corners=staging.apply(forward, corners).reshape(-1, 3, 3))


def pieces(mesh: Path) -> Shape:
    """The true surface, a part for every piece that hangs together; the small ones are one."""
    import trimesh

    whole: Any = trimesh.load(mesh, process=False)
    label = trimesh.graph.connected_component_labels(whole.face_adjacency, node_count=len(whole.faces))
    area = np.bincount(label, whole.area_faces)
    label = np.where((area > SMALLEST * area.sum())[label], label, -1)
    parts = []
    for k in np.unique(label):
        used, faces = np.unique(whole.faces[label == k], return_inverse=True)
        parts.append(Part(f"piece {k}", whole.vertices[used], tuple(map(tuple, faces.reshape(-1, 3).tolist()))))
    return Shape(tuple(parts))


def true_scene(truth: Photoset) -> Scene:
    """The photos with their true cameras and masks."""
    n = len(truth.names)
    cameras = Cameras(truth.names, truth.K, truth.cam_from_world, truth.sizes)
    masks = tuple(cv2.imread(str(p), cv2.IMREAD_GRAYSCALE) > 127 for p in truth.masks)
    poses = Poses(cameras, truth.photos, np.zeros((0, 3)), np.zeros((0, n), bool))
    outlines = Silhouettes(truth.names, masks, ("user",) * n, np.ones(n, bool))
    return Scene(poses, outlines, Canonical(truth.world_from_canonical))


def compared(shape: Shape, look: Look, source: PaintedMesh) -> Difference:
    """A look beside the colours of the surface that lies at the same places."""
    atlas = unwrapped(shape, 512 if look.picture is None else len(look.picture))
    texels = Texels.of(atlas).cells()
    true = of_mesh(texels, atlas, source)
    part = atlas.part[texels.triangle]
    shown = look.colours[part]
    if look.picture is not None:
        shown = linear(look.picture.reshape(-1, 3)[texels.flat] / 255)
    count = len(shape.parts)
    pixels = np.bincount(part, minlength=count)
    mean = np.stack([np.bincount(part, true[:, k], count) for k in range(3)], 1) / np.maximum(pixels, 1)[:, None]
    places = np.bincount(part, delta_e(shown, true), count) / np.maximum(pixels, 1)
    return Difference(delta_e(look.colours, mean), places, pixels / pixels.sum())


def delta_e(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(n,) distance in CIELAB (D65) of linear colours (n, 3)."""
    return np.linalg.norm(_lab(one) - _lab(other), axis=1)


def _lab(linear_rgb: np.ndarray) -> np.ndarray:
    share = np.clip(linear_rgb, 0, 1) @ _XYZ.T / _WHITE
    f = np.where(share > 216 / 24389, np.cbrt(share), (24389 / 27 * share + 16) / 116)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], 1)


def main(argv: Sequence[str] | None = None) -> int:
    """The command line; exit code 1 when a bound does not hold."""
    net.quiet(verbose=False)
    return net.run(lambda about: _command(argv, about))


def _command(argv: Sequence[str] | None, about: net.About) -> int:
    parser = Parser(prog="python -m recon.evaluate.colours", description=__doc__)
    parser.add_argument("set", type=Path, help="photo set with truth")
    parser.add_argument("mesh", type=Path, help="the mesh that was photographed, with its materials beside it")
    parser.add_argument("--shaded", action=argparse.BooleanOptionalAction, help="leave the light in the colours")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the rows there")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    about.what = args.set
    rows = run(args.set, args.mesh, photos.LookOptions(unshaded=not args.shaded))
    print_table(rows, sys.stdout)
    if args.json:
        write_json(rows, args.json)
    return 0 if all(r.holds for r in rows) else 1


if __name__ == "__main__":
    sys.exit(process.run(main))
