"""Render a photo set with ground truth from any textured mesh, and read one back.

    python -m datasets.photosets chair.glb --out DIR
    python -m datasets.photosets --sh3f CATALOGUE.sh3f --model chair --out DIR

DIR/photos/*.jpg         what a phone would have taken: EXIF focal length, slight changes of exposure and focus
DIR/truth/cameras.json   K, cam_from_world of every photo, and world_from_canonical
DIR/truth/masks/*.png    white = object; holes between legs and slats are kept
DIR/truth/mesh.ply       the true surface in the canonical frame
DIR/truth/info.json      source, licence, seed, options

Frames and axes: see `datasets.staging`.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import os
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from datasets import ground_truth, photography, staging, sweethome3d
from datasets.staging import PhotosetError, PhotosetOptions
from procmodels.studio import render

__all__ = ["Photoset", "PhotosetError", "PhotosetOptions", "main", "read_photoset", "render_photoset"]


@dataclass(frozen=True)
class Photoset:
    """A photo set with ground truth.

    names                 V file names of the photos, sorted
    photos, masks         V paths
    K                     (V, 3, 3) float, pixels
    cam_from_world        (V, 4, 4) float, rigid
    sizes                 (V, 2) int, (width, height) in pixels
    world_from_canonical  (4, 4) float, a similarity; scale = metres of the object's longest side
    mesh                  path of the true mesh, canonical frame
    info                  source, licence, seed, options
    """

    names: tuple[str, ...]
    photos: tuple[Path, ...]
    masks: tuple[Path, ...]
    K: np.ndarray
    cam_from_world: np.ndarray
    sizes: np.ndarray
    world_from_canonical: np.ndarray
    mesh: Path
    info: dict[str, Any]


def read_photoset(folder: Path) -> Photoset:
    """Read a photo set that `render_photoset` wrote; complains when a file is missing or broken."""
    folder = Path(folder)
    try:
        cameras = json.loads((folder / "truth" / "cameras.json").read_text())
        info = json.loads((folder / "truth" / "info.json").read_text())
        views = sorted(cameras["views"], key=lambda v: v["name"])
        names = tuple(str(v["name"]) for v in views)
        out = Photoset(
            names,
            tuple(folder / "photos" / n for n in names),
            tuple(folder / "truth" / "masks" / f"{Path(n).stem}.png" for n in names),
            np.array([v["K"] for v in views], float).reshape(-1, 3, 3),
            np.array([v["cam_from_world"] for v in views], float).reshape(-1, 4, 4),
            np.array([[v["width"], v["height"]] for v in views], int).reshape(-1, 2),
            np.array(cameras["world_from_canonical"], float).reshape(4, 4),
            folder / "truth" / "mesh.ply",
            info,
        )
    except (FileNotFoundError, NotADirectoryError) as error:
        raise PhotosetError(f"{folder}: not a finished photo set, {error.filename} is missing") from error
    except (KeyError, TypeError, ValueError) as error:
        raise PhotosetError(f"{folder}: truth/cameras.json or truth/info.json is broken ({error})") from error
    missing = [p for p in (*out.photos, *out.masks, out.mesh) if not p.is_file()]
    if missing:
        raise PhotosetError(f"{folder}: {len(missing)} files are missing, the first is {missing[0].name}")
    return out


def render_photoset(mesh_path: Path, out: Path, options: PhotosetOptions | None = None) -> Photoset:
    """Photograph a mesh in the studio; an interrupted run goes on where it stopped, a finished one is read back."""
    mesh_path, out, options = Path(mesh_path), Path(out), options or PhotosetOptions()
    info = _info(mesh_path, options)
    if (out / "truth").exists():
        done = read_photoset(out)
        if done.info != info:
            raise PhotosetError(f"{out}: holds a photo set made with other options; remove it or choose another folder")
        return done
    if (out.exists() and not out.is_dir()) or (out / "photos").exists():
        raise PhotosetError(f"{out}: is a file or has a photos folder without truth; choose another folder")
    plan = _open_studio(mesh_path, options)
    work = _work_folder(out, info)
    ground_truth.write_truth(work / "truth", plan, (options.width, options.height))
    photography.photograph(work / "photos", plan, options)
    if out.exists() and any(out.iterdir()):  # a README may wait there
        for name in ("photos", "truth"):  # truth last: its presence says that all is there
            os.replace(work / name, out / name)
        work.rmdir()
    else:
        os.replace(work, out)
    return read_photoset(out)


def _work_folder(out: Path, info: dict[str, Any]) -> Path:
    """Where an unfinished set lies; one left over from other options is thrown away."""
    work = out.with_name(out.name + ".partial")
    marker = work / "truth" / "info.json"
    text = json.dumps(info, indent=1) + "\n"
    if work.exists() and not (marker.is_file() and marker.read_text() == text):
        shutil.rmtree(work)
    for folder in (work / "photos", work / "truth" / "masks"):
        folder.mkdir(parents=True, exist_ok=True)
    marker.write_text(text)
    return work


def _info(mesh_path: Path, options: PhotosetOptions) -> dict[str, Any]:
    """What the set is made of; a set is made again when this changes."""
    if not mesh_path.is_file():
        raise PhotosetError(f"{mesh_path}: no such file")
    recorded = dataclasses.asdict(options)
    del recorded["threads"]  # the machine's business, not the set's
    for name in ("arc", "floor", "rug", "wall", "papers"):  # younger than the first sets: told only where they differ
        if recorded[name] == getattr(PhotosetOptions, name):
            del recorded[name]
    source, licence = recorded.pop("source"), recorded.pop("licence")
    digest = hashlib.sha256(mesh_path.read_bytes()).hexdigest()
    info = {"mesh": mesh_path.name, "sha256": digest, "source": source, "licence": licence, "options": recorded}
    return json.loads(json.dumps(info))  # tuples become lists, as when read back


def _open_studio(mesh_path: Path, options: PhotosetOptions) -> staging.Plan:
    """Import the mesh into the studio and decide where it and the cameras stand."""
    try:
        vertices, faces = render.load_mesh(mesh_path)
    except render.StudioError as error:
        raise PhotosetError(str(error)) from error
    return staging.plan(vertices, faces, mesh_path.suffix, options)


def _parser() -> argparse.ArgumentParser:
    d = PhotosetOptions()
    parser = argparse.ArgumentParser(
        "python -m datasets.photosets", description="Render photos with ground truth of a mesh."
    )
    parser.add_argument("mesh", nargs="?", type=Path, help="OBJ, GLB, PLY or STL file")
    parser.add_argument(
        "--sh3f", type=Path, help="a Sweet Home 3D catalogue instead of a mesh; alone it lists its models"
    )
    parser.add_argument("--model", help="name of a model in the catalogue")
    parser.add_argument("--out", type=Path, help="folder to make")
    parser.add_argument("--views", type=int, default=d.views, help="photos (%(default)s)")
    parser.add_argument("--size", default=f"{d.width}x{d.height}", help="pixels (%(default)s)")
    parser.add_argument("--samples", type=int, default=d.samples, help="light paths a pixel (%(default)s)")
    parser.add_argument("--seed", type=int, default=d.seed, help="same seed, same cameras (%(default)s)")
    parser.add_argument("--up", default=d.up, help="the file's up axis, such as z (by format)")
    parser.add_argument("--front", default=d.front, help="the axis that the object faces, such as -y (by format)")
    parser.add_argument("--height", type=float, help=f"of the object, metres (the catalogue's, or {d.object_height})")
    parser.add_argument("--arc", type=float, default=d.arc, help="degrees about the front (%(default)g: all round)")
    parser.add_argument("--floor", choices=staging.FLOORS, default=d.floor, help="(%(default)s)")
    parser.add_argument("--rug", action="store_true", help="lay a patterned rug under the object")
    parser.add_argument("--wall", type=float, default=d.wall, help="metres behind the object (%(default)g: none)")
    parser.add_argument("--source", default="", help="where the mesh comes from; recorded")
    parser.add_argument("--licence", default="", help="of the mesh; recorded")
    parser.add_argument("--threads", type=int, default=d.threads, help="render threads, 0 = all cores")
    return parser


def _join_axes(argv: list[str]) -> list[str]:
    """`--front -y` as `--front=-y`: argparse takes a bare -y for an option."""
    out: list[str] = []
    for word in argv:
        if out and out[-1] in ("--up", "--front") and word in staging.AXES:
            out[-1] += "=" + word
        else:
            out.append(word)
    return out


def _options(args: argparse.Namespace, model: sweethome3d.Model | None) -> PhotosetOptions:
    try:
        width, height = (int(v) for v in args.size.lower().split("x"))
    except ValueError as error:
        raise PhotosetError(f"--size must look like 800x600, got {args.size!r}") from error
    tall, source, licence, rotation = args.height, args.source, args.licence, PhotosetOptions.rotation
    if model:
        tall = tall if tall is not None else (model.size[2] / 100 or None)
        source = source or f"{args.sh3f.name}, model {model.name} by {model.creator or 'an unnamed author'}"
        licence, rotation = licence or model.licence, model.rotation
    return PhotosetOptions(
        views=args.views,
        width=width,
        height=height,
        samples=args.samples,
        seed=args.seed,
        up=args.up,
        front=args.front,
        object_height=PhotosetOptions.object_height if tall is None else tall,
        threads=args.threads,
        arc=args.arc,
        floor=args.floor,
        rug=args.rug,
        wall=args.wall,
        rotation=rotation,
        source=source,
        licence=licence,
    )


def main(argv: list[str] | None = None) -> int:
    """The command; exit code 0, or 2 with a message when the input is not usable."""
    args = _parser().parse_args(_join_axes(sys.argv[1:] if argv is None else argv))
    try:
        if args.sh3f and not args.model:
            rows = (f"{m.name}\t{m.title}\n" for m in sweethome3d.read_catalogue(args.sh3f))
            sys.stdout.writelines(rows)
            return 0
        if (args.mesh is None) == (args.sh3f is None) or args.out is None:
            raise PhotosetError("give --out and either a mesh file or --sh3f with --model")
        with tempfile.TemporaryDirectory() as scratch:
            model = sweethome3d.find_model(args.sh3f, args.model) if args.sh3f else None
            options = _options(args, model)
            mesh = sweethome3d.extract_model(args.sh3f, model, Path(scratch)) if model else args.mesh
            done = render_photoset(mesh, args.out, options)
    except (
        PhotosetError,
        sweethome3d.CatalogueError,
        OSError,
    ) as error:  # OSError: the disk, with the path in its text
        sys.stderr.write(f"error: {error}\n")
        return 2
    sys.stdout.write(f"{len(done.names)} photos in {args.out / 'photos'}, truth in {args.out / 'truth'}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
