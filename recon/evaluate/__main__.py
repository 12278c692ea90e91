"""python -m recon.evaluate TABLE: measure what docs/results.md says; each table is a command of its own."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from datasets.jobs import Backend, Here, Pool, RayNodes
from datasets.part_labels import DEBIAN
from nnproc.infer import WeightsError
from procmodels import ModelError, load, names, paper_names
from procmodels.registry import PAPER
from recon.evaluate import alignment, calibration, chair, gallery, printed_sheet, robust, space_pictures
from recon.evaluate.beliefs import command as beliefs
from recon.evaluate.beliefs import gather
from recon.evaluate.rows import Row, machine, print_table, read_json_rows, write_json
from recon.evaluate.speed import command as speed
from recon.evaluate.speed.rows import SpeedOptions, quick, read_rows, write_rows
from recon.evaluate.tables import table1, table1_rows, table2, table3
from recon.evaluate.tables.real_answers import INPUTS
from recon.evaluate.tables.table2_rows import Table2Row
from recon.scene import InputError
from recon.system import net, process
from recon.system.arguments import Parser

WORK = Path(".cache/evaluate")


def main(argv: list[str] | None = None) -> int:
    """The command line; exit code 1 when a bound does not hold."""
    net.quiet(verbose=False)
    return net.run(lambda about: _command(argv, about))


def _command(argv: list[str] | None, about: net.About) -> int:
    """Measure and tell; raises what net.run says to the user."""
    parser = Parser(prog="python -m recon.evaluate", description=__doc__)
    tables = parser.add_subparsers(dest="table", required=True)
    _chair_flags(tables.add_parser("chair", help="photo sets of chairs: what was promised and what is measured"))
    _table1_flags(tables.add_parser("table1", help="the paper's Table 1: tasks, baselines, ablations"))
    _table2_flags(tables.add_parser("table2", help="the paper's Table 2: real objects from every kind of input"))
    _table3_flags(tables.add_parser("table3", help="the paper's Table 3: meshes, beside ShapeAssembly's figures"))
    _speed_flags(tables.add_parser("speed", help="times side by side: renderers, fits, growth, limits, stages"))
    _robust_flags(tables.add_parser("robust", help="what wrong and half-hidden masks cost"))
    _calibration_flags(tables.add_parser("calibration", help="is the stated confidence right? sets and plots it"))
    _beliefs_flags(tables.add_parser("beliefs", help="what may be stated of real objects, and what is none; sets it"))
    _alignment_flags(tables.add_parser("alignment", help="up, yaw, front and size of photo sets that make it hard"))
    _sheet_flags(tables.add_parser("sheet", help="size, up and cameras by a printed sheet"))
    for table in tables.choices.values():
        table.add_argument("--json", type=Path, metavar="FILE", help="also write the rows there")
    _gallery_flags(tables.add_parser("gallery", help="a picture of each class: shapes, voxels, rebuilt meshes"))
    _space_flags(tables.add_parser("space", help="pictures of a class's prior and of every choice; needs no network"))
    for table in tables.choices.values():
        table.add_argument("--work", type=Path, default=WORK, help="intermediate results, kept between runs")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    about.what = args.table
    try:
        return args.run(args)
    except (ModelError, WeightsError, ValueError) as error:
        raise InputError(str(error)) from error


def _space_flags(parser: argparse.ArgumentParser) -> None:
    options = space_pictures.SpaceOptions()
    parser.add_argument("--class", dest="name", required=True, help="a class, or the path of a model's file")
    parser.add_argument("--shapes", type=int, default=options.shapes, help="random shapes of the prior")
    parser.add_argument("--seed", type=int, default=options.seed)
    parser.add_argument("--out", type=Path, default=options.out, help="folder of the pictures")
    parser.set_defaults(run=_space)


def _space(args: argparse.Namespace) -> int:
    options = space_pictures.SpaceOptions(args.shapes, seed=args.seed, out=args.out)
    for path in space_pictures.run(load(args.name), options):
        sys.stdout.write(f"{path}\n")
    return 0


def _chair_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quick", action="store_true", help="a few minutes: no rendering of photo sets")
    parser.set_defaults(run=_chair)


def _chair(args: argparse.Namespace) -> int:
    return _told(args, chair.run(args.work, args.quick))


def _table1_flags(parser: argparse.ArgumentParser) -> None:
    options = table1.Table1Options()
    parser.add_argument("--class", dest="classes", action="append", choices=paper_names(), help="may be repeated; all")
    parser.add_argument("--shapes", type=int, default=options.shapes, help="held-out shapes of each kind (at most 300)")
    parser.add_argument("--method", action="append", choices=table1.ALL_METHODS, help="may be repeated; spread, ours")
    parser.add_argument("--task", action="append", choices=table1.TASKS, help="may be repeated; all")
    parser.add_argument("--grid", action="append", choices=table1.GRIDS, help="on- or off-grid shapes; both")
    parser.add_argument("--variant-steps", type=int, default=options.variant_steps, help="training steps of ablations")
    parser.add_argument("--data", type=Path, default=options.data, help="generated pairs, for training the ablations")
    parser.add_argument("--show", type=Path, metavar="FILE", help="measure nothing; print the table of FILE")
    _worker_flags(parser)
    parser.set_defaults(run=_table1)


def _table1(args: argparse.Namespace) -> int:
    if args.show:
        sys.stdout.write(table1_rows.compact(read_json_rows(args.show, table1_rows.Table1Row.from_json)))
        return 0
    defaults = table1.Table1Options()
    if not 2 <= args.shapes <= 300:
        raise ValueError(f"--shapes {args.shapes}: 2 to 300 shapes are held out of each class")
    options = table1.Table1Options(
        shapes=args.shapes,
        methods=tuple(args.method or defaults.methods),
        tasks=tuple(args.task or defaults.tasks),
        grids=tuple(args.grid or defaults.grids),
        variant_steps=args.variant_steps,
        data=args.data,
        work=args.work,
    )
    rows = []
    for row in table1.run(args.classes or paper_names(), options, _backend(args)):
        rows.append(row)
        if args.json:
            _add_rows(args.json, [row])
    table1_rows.print_rows(rows, sys.stdout)
    return 0


def _with_the_papers() -> list[str]:
    """The classes, and those of the paper by their full names."""
    return [*names(), *(PAPER + name for name in paper_names())]


def _worker_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--workers", type=int, default=1, metavar="N", help="processes that measure; the rows are the same"
    )
    parser.add_argument("--ray", metavar="ADDRESS", help="of a Ray cluster whose machines measure")


def _backend(args: argparse.Namespace) -> Backend:
    if args.workers < 1:
        raise ValueError(f"--workers {args.workers}: at least 1")
    pool = Pool(args.workers) if args.workers > 1 else Here()
    return RayNodes(args.ray) if args.ray else pool


def _table2_flags(parser: argparse.ArgumentParser) -> None:
    _real_flags(parser, _with_the_papers())
    parser.set_defaults(all_classes=tuple(names()))
    parser.add_argument("--input", action="append", choices=tuple(INPUTS), help="may be repeated; all")
    parser.set_defaults(run=lambda args: _real(args, args.input or tuple(INPUTS), table2.summary))


def _table3_flags(parser: argparse.ArgumentParser) -> None:
    _real_flags(parser, table3.CLASSES)
    parser.set_defaults(run=lambda args: _real(args, ("mesh",), table3.summary))


def _real_flags(parser: argparse.ArgumentParser, classes: Sequence[str]) -> None:
    parser.add_argument(
        "--data",
        type=Path,
        action="append",
        metavar="PATH",
        help="ShapeNet, Pix3D, a .sh3f catalogue or a folder of meshes; may be repeated",
    )
    parser.add_argument("--class", dest="classes", action="append", choices=classes, help="may be repeated; all")
    _worker_flags(parser)
    parser.add_argument("--limit", type=int, help="only the first objects of a class and source")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--show", type=Path, metavar="FILE", help="measure nothing; print the table of FILE's rows")
    parser.set_defaults(all_classes=tuple(classes))


def _real(args: argparse.Namespace, inputs: Sequence[str], summary: Callable[[list[Table2Row]], str]) -> int:
    if args.show:
        sys.stdout.write(summary(read_json_rows(args.show, Table2Row.from_json)))
        return 0
    if not args.data:
        raise ValueError("--data PATH is needed: ShapeNet, Pix3D, a .sh3f catalogue or a folder of meshes")
    if args.limit is not None and args.limit < 1:
        raise ValueError(f"--limit {args.limit}: at least 1")
    options = table2.Table2Options(
        data=tuple(args.data),
        classes=tuple(args.classes or args.all_classes),
        inputs=tuple(inputs),
        limit=args.limit,
        seed=args.seed,
        work=args.work,
    )
    rows: list[Table2Row] = []
    for found in table2.run(options, _backend(args)):
        rows += found
        table2.write_csv(rows, args.work / f"{args.table}.csv")
        if args.json:
            table2.write_rows(rows, args.json)
    if not rows:
        raise ValueError("none of the data holds an object of these classes")
    sys.stdout.write(f"Measured on {machine()}.\n\n{summary(rows)}")
    for sheet in table2.write_worst(rows, args.work):
        sys.stdout.write(f"the worst: {sheet}\n")
    return 0


def _robust_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--class", dest="classes", action="append", choices=_with_the_papers(), help="may be repeated; chair"
    )
    parser.add_argument("--shapes", type=int, default=robust.RobustOptions.shapes, help="held-out shapes, off the grid")
    parser.set_defaults(
        run=lambda args: _told(
            args, list(robust.run(robust.RobustOptions(tuple(args.classes or ("chair",)), args.shapes)))
        )
    )


def _alignment_flags(parser: argparse.ArgumentParser) -> None:
    kinds = [kind.name for kind in alignment.KINDS]
    parser.add_argument(
        "--kind", action="append", choices=kinds, metavar="NAME", help=f"may be repeated; {', '.join(kinds)}"
    )
    parser.set_defaults(run=lambda args: _told(args, list(alignment.run(args.work, args.kind or ()))))


def _sheet_flags(parser: argparse.ArgumentParser) -> None:
    kinds = [kind.name for kind in printed_sheet.KINDS]
    parser.add_argument(
        "--kind", action="append", choices=kinds, metavar="NAME", help=f"may be repeated; {'; '.join(kinds)}"
    )
    parser.set_defaults(run=lambda args: _told(args, list(printed_sheet.run(args.work, args.kind or ()))))


def _calibration_flags(parser: argparse.ArgumentParser) -> None:
    options = calibration.CalibrationOptions()
    parser.add_argument(
        "--class", dest="classes", action="append", choices=_with_the_papers(), help="may be repeated; four"
    )
    parser.add_argument("--shapes", type=int, default=options.shapes, help="held-out shapes a class, off the grid")
    parser.add_argument("--plot", type=Path, default=Path("docs/calibration.png"))
    parser.add_argument("--keep", action="store_true", help="measure and plot, but leave recon/calibration.json alone")
    parser.set_defaults(run=_calibration)


def _calibration(args: argparse.Namespace) -> int:
    defaults = calibration.CalibrationOptions()
    options = calibration.CalibrationOptions(tuple(args.classes or defaults.classes), args.shapes, work=args.work)
    return _told(args, calibration.run(options, args.plot, None if args.keep else calibration.FILE))


def _beliefs_flags(parser: argparse.ArgumentParser) -> None:
    own = gather.GatherOptions.own
    parser.add_argument("--class", dest="name", default="chair", help="a class, or the path of a model's file; chair")
    parser.add_argument("--labels", help="whose labels in datasets/labels; those of the class")
    parser.add_argument(
        "--data", type=Path, action="append", metavar="PATH", help="beside Debian's catalogues; repeated"
    )
    parser.add_argument("--input", action="append", choices=tuple(gather.ANSWERS), help="may be repeated; all")
    parser.add_argument("--limit", type=int, help="only the first objects, some of each kind")
    parser.add_argument("--own", type=int, default=own, help=f"shapes of the class itself ({own})")
    parser.add_argument(
        "--outlines",
        type=Path,
        metavar="DIR",
        help="networks that did not see the objects: N.safetensors, each made"
        " by nnproc.learn_outlines --without N (default: the shipped one, which saw all)",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", action="store_true", help="measure, but leave recon/fitting/beliefs.json alone")
    parser.add_argument("--default", action="store_true", help="classes without a table of their own go by this one")
    parser.set_defaults(run=_beliefs)


def _beliefs(args: argparse.Namespace) -> int:
    if args.limit is not None and args.limit < 1:
        raise ValueError(f"--limit {args.limit}: at least 1")
    model = load(args.name)
    options = gather.GatherOptions(
        data=(*([DEBIAN] if DEBIAN.is_dir() else []), *(args.data or ())),
        kinds=tuple(args.input or gather.ANSWERS),
        labels=args.labels or model.space.name,
        limit=args.limit,
        own=args.own,
        outlines=args.outlines,
        seed=args.seed,
        work=args.work,
    )
    told = beliefs.BeliefOptions(options, default=args.default)
    return _told(args, beliefs.run(model, replace(told, table=None) if args.keep else told))


def _told(args: argparse.Namespace, rows: list[Row]) -> int:
    print_table(rows, sys.stdout)
    if args.json:
        write_json(rows, args.json)
    return 0 if all(r.holds for r in rows) else 1


def _gallery_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--class", dest="classes", action="append", choices=paper_names(), help="may be repeated; all")
    parser.add_argument("--out", type=Path, default=gallery.GalleryOptions.out, help="folder of the pictures")
    parser.add_argument("--grid", choices=table1.GRIDS, default="on", help="held-out shapes on or off the grid")
    parser.add_argument("--data", type=Path, default=gallery.GalleryOptions.data, help="generated pairs, for the bank")
    parser.add_argument(
        "--task4",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="show the search from four outlines; default: when the bank of outlines is there (20 to 60 s to make)",
    )
    parser.set_defaults(run=_gallery)


def _gallery(args: argparse.Namespace) -> int:
    options = gallery.GalleryOptions(task4=args.task4, grid=args.grid, out=args.out, data=args.data, work=args.work)
    for path in gallery.run(args.classes or paper_names(), options):
        sys.stdout.write(f"{path}\n")
    return 0


def _speed_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quick", action="store_true", help="under a minute: few repeats, no photos")
    parser.add_argument("--repeats", type=int, default=SpeedOptions.repeats, help="turns of every side (5)")
    parser.add_argument("--show", type=Path, metavar="FILE", help="measure nothing; print the table of FILE")
    parser.set_defaults(run=_speed)


def _speed(args: argparse.Namespace) -> int:
    if args.show:
        sys.stdout.write(speed.compact(read_rows(args.show)))
        return 0
    if args.repeats < 1:
        raise ValueError(f"--repeats {args.repeats}: at least 1")
    options = SpeedOptions(repeats=args.repeats, work=args.work)
    options = quick(options) if args.quick else options
    rows = speed.print_rows(speed.run(options), options, sys.stdout)
    if args.json:
        write_rows(rows, args.json)
    return 0


def _add_rows(path: Path, rows: list[table1_rows.Table1Row]) -> None:
    """Add rows to a JSON list, each in place of an earlier one of the same name; written whole or not at all."""
    kept = json.loads(path.read_text()) if path.is_file() else []
    key = ("class", "grid", "task", "method")
    new = {tuple(r[k] for k in key): r for r in (row.as_json() for row in rows)}
    merged = [new.pop(tuple(r[k] for k in key), r) for r in kept] + list(new.values())
    partial = path.with_suffix(path.suffix + ".partial")
    partial.parent.mkdir(parents=True, exist_ok=True)
    partial.write_text(json.dumps(merged, indent=1) + "\n")
    partial.replace(path)


if __name__ == "__main__":
    sys.exit(process.run(main))
