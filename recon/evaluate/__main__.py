"""python -m recon.evaluate chair [--quick] [--json FILE]: print a table of what was promised and what is measured."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from recon.evaluate import chair
from recon.evaluate.rows import print_table, write_json
from recon.scene import ReconError


def main(argv: list[str] | None = None) -> int:
    """The command line; exit code 1 when a bound does not hold."""
    parser = argparse.ArgumentParser(prog="python -m recon.evaluate", description=__doc__)
    parser.add_argument("table", choices=("chair",), help="which measurements to run")
    parser.add_argument("--quick", action="store_true", help="a few minutes: no rendering of photo sets")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the rows there")
    parser.add_argument("--work", type=Path, default=Path(".cache/evaluate"), help="rendered photo sets and results")
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    try:
        rows = chair.run(args.work, args.quick)
    except ReconError as error:
        sys.stderr.write(f"error: {error}\n")
        return error.exit_code
    print_table(rows, sys.stdout)
    if args.json:
        write_json(rows, args.json)
    return 0 if all(r.holds for r in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
