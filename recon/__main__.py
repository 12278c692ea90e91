"""`python -m recon INPUT ...`: the command of run_recon.py where only the packages are installed."""

from __future__ import annotations

import sys

from recon.command import console

if __name__ == "__main__":
    sys.exit(console())
