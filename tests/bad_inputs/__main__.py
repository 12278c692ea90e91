"""Run some hundred bad inputs and say which of them do not end as they should."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path

from tests.bad_inputs import cases, good, runner


def main(argv: list[str] | None = None) -> int:
    """The command line; exit code 1 when something is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.bad_inputs", description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="cases (300)")
    parser.add_argument("--seed", type=int, default=0, help="chooses the cases and the damage (0)")
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose names have it")
    parser.add_argument("--whole", action="store_true", help="search for the shape as well, where all was read")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="folder where the inputs stay; else they go")
    parser.add_argument("--verbose", action="store_true", help="print what every case said")
    args = parser.parse_args(argv)
    runner.load_everything(args.whole)
    root = args.keep or Path(tempfile.mkdtemp(prefix="bad-inputs-"))
    root.mkdir(exist_ok=True, parents=True)
    root.chmod(0o755)
    started = time.monotonic()
    goods = good.make_all(root / "good")
    chosen = [c for c in cases.chosen(goods, 10**9 if args.only else args.count, args.seed) if args.only in c.name]
    outcomes = []
    for outcome in runner.run(chosen[: args.count], root / "good", root, args.seed):
        outcomes.append(outcome)
        if outcome.wrong or args.verbose:
            _print(len(outcomes) - 1, outcome)
        if not args.keep:
            for path in root.glob(f"{len(outcomes) - 1:04d}*"):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
    _sum_up(outcomes, time.monotonic() - started)
    if not args.keep:
        shutil.rmtree(root)
    return 1 if any(o.wrong for o in outcomes) else 0


def _print(number: int, outcome: runner.Outcome) -> None:
    last = outcome.said.strip().splitlines()[-1:] or [""]
    facts = f"exit {outcome.code}, {outcome.seconds:.1f} s, {outcome.memory / (1 << 30):.2f} GB"
    wrong = f"WRONG ({', '.join(outcome.wrong)})" if outcome.wrong else "well"
    text = f"{number:04d} {wrong}: {outcome.case.name!r} [{facts}]: {last[0][:400]}\n"
    sys.stdout.write(text.encode("utf-8", "backslashreplace").decode())
    sys.stdout.flush()


def _sum_up(outcomes: list[runner.Outcome], seconds: float) -> None:
    codes = {code: sum(o.code == code for o in outcomes) for code in sorted({o.code for o in outcomes})}
    sys.stdout.write(
        f"{len(outcomes)} bad inputs in {seconds:.0f} s; {sum(bool(o.wrong) for o in outcomes)} end wrongly; exit "
        f"codes {codes}; at most {max((o.memory for o in outcomes), default=0) / (1 << 30):.2f} GB and "
        f"{max((o.seconds for o in outcomes), default=0):.0f} s\n"
    )


if __name__ == "__main__":
    sys.exit(main())
