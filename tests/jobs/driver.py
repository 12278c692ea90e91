"""A driver for tests that end it: python -m tests.jobs.driver MARKS, two workers with jobs that take a minute."""

import sys

from datasets.jobs import Pool
from tests.jobs import work

if __name__ == "__main__":
    jobs = ({"number": n, "marks": sys.argv[1], "seconds": 60} for n in range(2))
    list(Pool(2).map(work.slow, jobs))
