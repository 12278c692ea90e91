"""Files from parameters: python -m procmodels build params.json --out chair.glb

params.json is a result's, perhaps with other values, or as little as {"class": "chair", "values": {...}}; what it holds
is in docs/params.schema.json. Exit codes: 0 done, 2 the file, its values or an option cannot be used.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from procmodels.blender import BlenderMissing
from procmodels.file_kinds import KINDS, UP_AXES, write_new
from procmodels.model_file import ModelError
from procmodels.params_file import ParamsError, asset_of, read


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser("python -m procmodels", description="Procedural furniture from its parameters.")
    commands = p.add_subparsers(dest="command", required=True, metavar="build")
    build = commands.add_parser("build", help="write a shape as a file for other programs")
    build.add_argument("params", type=Path, metavar="params.json", help="values of a class, as a result has them")
    build.add_argument("--out", type=Path, required=True, metavar="FILE", help=f"a new file: {', '.join(KINDS)}")
    build.add_argument("--class", dest="model", metavar="NAME", help="instead of the file's; a model's .py file is run")
    build.add_argument("--height", type=_metres, metavar="METRES", help="real height, instead of the file's")
    build.add_argument("--obj-up", choices=UP_AXES, default="y", help="up axis of an OBJ file (%(default)s)")
    return p


def _metres(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < 1000:
        raise argparse.ArgumentTypeError(f"a height in metres is wanted, got {text!r}")
    return value


def main(argv: list[str] | None = None) -> int:
    """The command; returns the exit code."""
    args = parser().parse_args(argv)
    try:
        found = read(args.params, args.model)
        if found.warning:
            sys.stderr.write(f"warning: {found.warning}\n")
        write_new(asset_of(found, args.height), args.out, args.obj_up)
    except (ParamsError, ModelError, BlenderMissing) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    except OSError as error:
        sys.stderr.write(f"error: {args.out} cannot be written ({error.strerror or error})\n")
        return 2
    sys.stdout.write(f"{args.out}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
