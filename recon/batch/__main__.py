"""Many objects with one command.

    python -m recon.batch objects/ --out results/ --class chair --workers 2

LIST is a folder of inputs; a CSV or JSON list with a column "input" and, where wanted, one for every option; or a whole
data set: ShapeNet, Pix3D, meshes in folders by class. All options of run_recon.py are taken, for all inputs.
Exit codes: 0 all done, 2 the list or an option cannot be used, 3 some inputs gave no result: the table says which.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from recon.command import calm_threads, joined
from recon.system import net, process

GB = 1 << 30
WANTED = 4 * GB  # memory that a worker is counted with when nobody says how many there are


def main(argv: list[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    calm_threads()
    net.quiet(verbose=False)
    return net.run(lambda about: _command(joined(sys.argv[1:] if argv is None else argv), about))


def parser() -> argparse.ArgumentParser:
    """The command line."""
    from recon.batch.options import add_unsaid
    from recon.system.arguments import Parser, number, path, whole

    text = __doc__ or ""
    p = Parser(prog="python -m recon.batch", description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("list", type=path, metavar="LIST", help="folder of inputs, CSV or JSON list, or data set")
    p.add_argument("--out", type=path, required=True, metavar="DIR", help="results, a folder for each input")
    p.add_argument("--workers", type=whole, metavar="N", help="objects at a time (default: as cores and memory allow)")
    p.add_argument("--ray", metavar="ADDRESS", help="of a Ray cluster that does the work: auto, or HOST:PORT")
    p.add_argument("--memory", type=number, default=6.0, metavar="GB", help="that a worker may take (default 6)")
    p.add_argument("--limit", type=whole, metavar="N", help="only the first inputs")
    add_unsaid(p.add_argument_group("options of every input, unless the list says otherwise"))
    return p


def _command(words: list[str], about: net.About) -> int:
    """Reconstruct all and tell; raises what net.run says to the user."""
    args = parser().parse_args(words)
    about.what = args.list
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    from recon.batch import run
    from recon.batch.entries import entries
    from recon.batch.options import given
    from recon.command import parser as of_one
    from recon.system.arguments import nameable

    _check(args)
    nameable(args.out, "--out")
    common = given(args)
    of_one().parse_args(["INPUT", *(f"--{k}" if v is True else f"--{k}={v}" for k, v in common.items())])
    rows = run.run(entries(args.list, common, args.out, args.limit), args.out, _backend(args))
    sys.stdout.write(summary(rows, args.out))
    sys.stdout.flush()
    return 0 if all(row["status"] == "done" for row in rows) else net.FAILED


def _check(args: argparse.Namespace) -> None:
    from recon.scene import InputError

    for option, value in (("--workers", args.workers), ("--limit", args.limit)):
        if value is not None and value < 1:
            raise InputError(f"{option} is at least 1, got {value}")
    if not args.memory >= 1:
        raise InputError(f"--memory is in GB, at least 1; got {args.memory:g}")


def _backend(args: argparse.Namespace) -> Any:
    """What does the work."""
    from datasets.jobs import Limits, Pool, RayNodes

    limits = Limits(memory=int(args.memory * GB))
    if args.ray is not None:
        return RayNodes(args.ray, args.workers, limits)
    return Pool(args.workers or default_workers(), limits)


def default_workers() -> int:
    """As many as there are cores, and memory for."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return max(1, min(os.cpu_count() or 1, memory // WANTED))


def summary(rows: list[dict[str, Any]], out: Path) -> str:
    """The lines that end a batch."""
    from recon.system.names import shown

    counts = Counter(row["status"] for row in rows)
    others = ", ".join(f"{n} {status}" for status, n in sorted(counts.items()) if status != "done")
    lines = [f"{counts['done']} of {len(rows)} reconstructed{f'; {others}' if others else ''}"]
    lines += [f"{shown(r['name'])}: {shown(r['error'])}" for r in rows if r["status"] != "done"][:20]
    lines.append(f"results: {shown(str(out))} (start with index.html; table.csv holds all values)")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(process.run(main))
