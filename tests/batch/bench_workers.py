"""What a second worker brings: python -m tests.batch.bench_workers [--count 12]. Two idle cores; two to five minutes.

The same list is done by one worker and by two, from nothing, by turns; expected: two are >= 1.7 times as fast.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from datasets.jobs import Pool
from recon.batch import run
from recon.batch.entries import entries
from tests.batch.mixed import listed


def main() -> int:
    """Print seconds and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=12, help="inputs")
    parser.add_argument("--turns", type=int, default=2)
    args = parser.parse_args()
    best: dict[int, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = listed(folder / "list", args.count, 1)
        for turn in range(args.turns):
            for workers in (1, 2):
                out = folder / f"{turn}-{workers}"
                started = time.monotonic()
                run.run(entries(path, {"class": "paper/chair"}, out), out, Pool(workers))
                took = time.monotonic() - started
                best[workers] = min(took, best.get(workers, took))
                sys.stdout.write(f"{workers} worker{'s' * (workers > 1)}: {took:.1f} s for {args.count} inputs\n")
    sys.stdout.write(f"two are {best[1] / best[2]:.2f} times as fast as one\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
