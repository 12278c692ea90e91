"""A contact sheet of real objects, so that a person sees that up is up and front is front.

    python -m recon.evaluate.axes ../shared/data/ikea_dev --class chair --picture axes.jpg

Every object is drawn in the canonical frame from the front, a little from its left and from above; the red arrow on the
floor leaves its front (-Y). A chair must look along the arrow. A file that cannot be read is shown as its error.
"""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from PIL import Image, ImageDraw, ImageFont

from datasets.catalogues import DataError, RealObject, objects
from procmodels import names
from recon.outputs.previews import view
from recon.scene import InputError
from recon.system import net, process
from recon.system.arguments import Parser, readable

CELL = 260  # px, side of a picture
CAPTION = 40  # px below it: name, class and number of triangles
COLUMNS = 7
AZIMUTH, FINE = 33.0, 2  # degrees from the front towards +X; samples a pixel along each axis
LIGHT = np.array([-0.35, -0.75, 0.9]) / np.linalg.norm([-0.35, -0.75, 0.9])
PAPER, INK, RED = (250, 249, 246), (38, 36, 33), (215, 40, 30)


def sheet(items: list[RealObject], title: str) -> Image.Image:
    """All objects on one picture."""
    rows = -(-len(items) // COLUMNS)
    out = Image.new("RGB", (COLUMNS * CELL, 40 + rows * (CELL + CAPTION)), PAPER)
    pen = ImageDraw.Draw(out)
    pen.text((8, 10), f"{title}: the red arrow leaves the front, Z is up", INK, ImageFont.load_default(18))
    for i, item in enumerate(items):
        x, y = i % COLUMNS * CELL, 40 + i // COLUMNS * (CELL + CAPTION)
        try:
            mesh = item.load()
            out.paste(picture(mesh), (x, y))
            note = f"{item.class_name}, {len(mesh.faces):,} triangles"
        except DataError as error:
            note = str(error)
        pen.text((x + 6, y + CELL), item.name[:34], INK, ImageFont.load_default(14))
        pen.text((x + 6, y + CELL + 18), note[:44], INK, ImageFont.load_default(12))
    return out


def picture(mesh: trimesh.Trimesh) -> Image.Image:
    """CELL x CELL pixels: a mesh in the canonical frame with its arrow."""
    side = CELL * FINE
    low, high = mesh.bounds
    arrow = _arrow(float(low[1]), float(low[2]))
    # The box's corners, not the vertices: a floor plane to judge the legs by stays in sight.
    corners = trimesh.bounds.corners(np.array([low, high]))
    eye, axes, focal, middle = view(np.concatenate([corners, arrow]), np.radians(AZIMUTH), (side, side))
    rows, columns = np.indices((side, side))
    x, y = ((v + 0.5 - side / 2) / focal + m for v, m in ((columns, middle[0]), (rows, middle[1])))
    directions = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ axes
    shade = _shaded(mesh, eye, directions).reshape(side, side)
    lit = 235 * np.nan_to_num(shade)[..., None]
    image: np.ndarray = np.where(np.isnan(shade)[..., None], PAPER, lit).astype(np.uint8)
    seen = (arrow - eye) @ axes.T
    plane = (seen[:, :2] / seen[:, 2:] - middle) * focal + side / 2
    cv2.fillPoly(image, [np.rint(plane).astype(np.int32)], RED, cv2.LINE_AA)
    return Image.fromarray(cv2.resize(image, (CELL, CELL), interpolation=cv2.INTER_AREA))


def _arrow(front: float, floor: float) -> np.ndarray:
    """(7, 3) corners of an arrow on the floor that starts a little before the object and points to -Y."""
    shape = [(-0.02, 0.05), (0.02, 0.05), (0.02, 0.17), (0.06, 0.17), (0, 0.27), (-0.06, 0.17), (-0.02, 0.17)]
    return np.array([(x, front - y, floor) for x, y in shape])


def _shaded(mesh: trimesh.Trimesh, eye: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(m,) brightness 0 to 1 of what m rays hit, either side of a face; NaN where they hit nothing."""
    import open3d as o3d  # slow to import

    tensor: Any = o3d.core.Tensor  # its stubs do not know that it takes arrays
    scene: Any = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(mesh.vertices.astype(np.float32)), tensor(mesh.faces.astype(np.uint32)))
    rays = np.concatenate([np.broadcast_to(eye, directions.shape), directions], 1).astype(np.float32)
    hit = scene.cast_rays(tensor(rays))
    normals = hit["primitive_normals"].numpy().astype(float)
    normals[(normals * directions).sum(1) > 0] *= -1
    bright = 0.45 + 0.5 * np.clip(normals @ LIGHT, -0.5, 1)
    return np.where(np.isfinite(hit["t_hit"].numpy()), bright, np.nan)


def main(argv: list[str] | None = None) -> int:
    """The command line; exit code 2 when the path cannot be used."""
    net.quiet(verbose=False)
    return net.run(lambda about: _command(argv, about))


def _command(argv: list[str] | None, about: net.About) -> int:
    """List or draw; raises what net.run says to the user."""
    parser = Parser(prog="python -m recon.evaluate.axes", description=__doc__)
    parser.add_argument(
        "path", type=Path, help="whatever datasets.catalogues reads: .sh3f, Pix3D, ShapeNet, mesh folders"
    )
    parser.add_argument("--class", dest="class_name", choices=names(), help="only this class")
    parser.add_argument("--limit", type=int, help="only the first objects")
    parser.add_argument("--picture", type=Path, help="file of the contact sheet; without it the objects are listed")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    logging.getLogger("datasets").setLevel(logging.INFO)  # which folders are left out, and why
    about.what = args.path
    readable(args.path, "PATH")
    try:
        items = objects(args.path, args.class_name)[: args.limit]
    except DataError as error:
        raise InputError(str(error)) from error
    if args.picture is None:
        for item in items:
            sys.stdout.write(f"{item.data}\t{item.class_name}\t{item.name}\t{item.source}\n")
        return 0
    args.picture.parent.mkdir(parents=True, exist_ok=True)
    sheet(items, args.path.name).save(args.picture, quality=90)
    sys.stdout.write(f"{args.picture}: {len(items)} objects\n")
    return 0


if __name__ == "__main__":
    sys.exit(process.run(main))
