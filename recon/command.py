"""The command: flags to what is asked for, one run, a summary of a few lines.

    python run_recon.py photos/ --class chair

An installed package has it as `nnproc-recon` and as `python -m recon`.
Exit codes: 0 done, 2 your input or options, 3 no reconstruction could be made, 130 interrupted and 143 terminated (run
again to go on).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import os
import sys
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recon.system import net, process

if TYPE_CHECKING:
    from recon.pipelines.inputs import Asked

SCRIPT = "run_recon.py"  # the command in a copy of the sources


def parser(prog: str = SCRIPT) -> argparse.ArgumentParser:
    """The command line."""
    from recon.system.arguments import Parser, path

    p = Parser(prog=prog, description="From photos of furniture to a procedural mesh.")
    inputs = "folder of JPEG, PNG or HEIC photos, 20 to 60 from all around; a video; a folder with known cameras; "
    p.add_argument("photos", type=path, metavar="INPUT", help=inputs + "a mesh, point cloud, splat or voxel grid")
    p.add_argument("--out", type=path, help="where results go (default: out/<name of the photo folder>)")
    add_options(p)
    p.add_argument("--force", action="store_true", help="redo every stage")
    p.add_argument("--from", dest="start", metavar="STAGE", help="redo from this stage on (frames, poses, ...)")
    p.add_argument("--verbose", action="store_true", help="say more about every stage")
    return p


def add_options(p: argparse._ActionsContainer) -> None:
    """What can be said of an input, beside where it is and where its results go."""
    from procmodels import names
    from recon.system.arguments import number, path, seed, whole

    p.add_argument(
        "--input", metavar="KIND", help="what INPUT is, when it is taken for something else: mesh, cloud, ..."
    )
    p.add_argument("--up", help="axis of a shape's file that points up: x, y, z, -x, -y, -z (default: found)")
    p.add_argument("--front", help="axis of a shape's file that the object faces (default: found)")
    classes = f"{', '.join(names())}; auto tries all of them; or a model's .py file, code that is run (default chair)"
    p.add_argument("--class", dest="class_name", default="chair", metavar="NAME", help=classes)
    p.add_argument("--masks", type=path, help="folder or zip of your own masks: named as the photos, white = object")
    p.add_argument("--mask", type=path, metavar="FILE", help="of one image: white = object")
    p.add_argument("--box", metavar="X,Y,W,H", help="of one image: pixels round the object, which is then cut out")
    p.add_argument("--pix3d", type=path, metavar="FILE", help="of one image: Pix3D's pix3d.json with its camera")
    p.add_argument(
        "--camera-off", type=number, metavar="DEGREES", help="how far --pix3d's camera may be off; found with the shape"
    )
    p.add_argument("--height", type=number, metavar="METRES", help="real height of the object: gives real sizes")
    p.add_argument("--ruler", type=number, metavar="MM", help="what the printed sheet's ruler of 150 mm measures")
    p.add_argument(
        "--cameras",
        type=path,
        metavar="PATH",
        help="known cameras of photos or a splat: COLMAP model or transforms.json",
    )
    p.add_argument("--allow-outside", action="store_true", help="follow a camera file to images outside its folder")
    p.add_argument(
        "--turntable", action="store_true", help="the object turned before a still camera; needs masks or transparency"
    )
    p.add_argument("--intrinsics", metavar="FX,FY,CX,CY", help="in pixels of the original photos; held")
    p.add_argument("--focal-mm", metavar="F[,WIDTH]", help="focal length and sensor width in mm (36); held")
    p.add_argument("--frames", type=whole, metavar="N", help="of a video, that are used (default 40)")
    p.add_argument(
        "--obj-up", choices=("y", "z"), default="y", help="up axis of mesh.obj (default y, as readers assume)"
    )
    p.add_argument("--plain", action="store_true", help="no colours and no texture from the input")
    p.add_argument("--seed", type=seed, default=0, help="same seed, same result (default 0)")


def console() -> int:
    """The command as an installed package has it."""
    return process.run(lambda: main(prog="nnproc-recon"))


def main(argv: list[str] | None = None, prog: str = SCRIPT) -> int:
    """Run the command; returns the exit code."""
    calm_threads()
    words = joined(sys.argv[1:] if argv is None else argv)
    net.quiet("--verbose" in words)
    return net.run(lambda about: _command(words, about, prog))


def calm_threads() -> None:
    """Call before torch and numpy are loaded.

    Threads that spin while they wait starve the other core's work on small machines, and the linear systems here are
    tiny.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _command(words: list[str], about: net.About, prog: str) -> int:
    """Reconstruct and tell; raises what net.run says to the user."""
    args = parser(prog).parse_args(words)
    about.what = args.photos
    logging.basicConfig(level=logging.DEBUG if args.verbose else logging.INFO, format="%(message)s", stream=sys.stderr)
    from recon.pipelines import inputs

    out = _out(args)
    asked = asked_of(args, out)
    inputs.check(asked)
    about.log_folder = out / ".recon"
    with contextlib.redirect_stdout(sys.stderr):  # model files and libraries may print; the summary stands alone
        report = inputs.run(asked).report_json
    sys.stdout.write(summary(report))
    sys.stdout.flush()
    return 0


def _out(args: argparse.Namespace) -> Path:
    """The folder of the results."""
    if args.out is not None:
        return args.out
    source = args.photos
    return Path("out") / (source.stem if source.is_file() else Path(os.path.realpath(source)).name)


def joined(argv: list[str]) -> list[str]:
    """`--front -y` as `--front=-y`: argparse would take -y for another option."""
    out: list[str] = []
    for word in argv:
        if out and out[-1] in ("--up", "--front") and word in ("-x", "-y", "-z"):
            out[-1] += f"={word}"
        else:
            out.append(word)
    return out


def asked_of(args: argparse.Namespace, out: Path) -> Asked:
    """What the words of a command line ask for."""
    from recon.pipelines.inputs import Asked
    from recon.pipelines.stages import Redo

    flags = {f.name: getattr(args, f.name) for f in fields(Asked) if f.name not in ("source", "out", "redo")}
    redo = Redo(getattr(args, "force", False), getattr(args, "start", None))
    return Asked(source=args.photos, out=out, redo=redo, **flags)


def summary(report: Path) -> str:
    """The few lines that end a run."""
    from recon.outputs.result import tried
    from recon.system.names import shown

    r = json.loads(report.read_text())
    values = ", ".join(f"{k} {v if isinstance(v, str) else round(v, 3)}" for k, v in r["params"].items())
    classes = tuple((c["class"], c["iou"]) for c in r.get("classes", []))
    noun = r["class"].rpartition("/")[2]  # a chair of the paper is a chair
    lines = [
        *([tried(classes)] if classes else []),
        f"{noun if r.get('belongs', True) else f'no {noun}; the nearest one'}: {values}",
        f"{_agreement(r)}, confidence {r['confidence']:.2f}, {r['seconds']['total']:.0f} s",
        *(f"warning: {w}" for w in r["warnings"]),
        f"results: {shown(str(report.parent))} (start with report.html)",
    ]
    return "\n".join(lines) + "\n"


def _agreement(r: dict[str, Any]) -> str:
    """How well the result explains the input, from the content of report.json."""
    if "distance" in r:
        return f"D_chamfer {r['distance']:.5f} to {r['input']['what']} ({r['input']['stands']})"
    score = "no photo is used" if r["mean_iou"] is None else f"outlines agree by {r['mean_iou']:.3f} (mean IoU)"
    return f"{score}, {r['registered']['how']}"
