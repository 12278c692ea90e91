"""python -m datasets.jobs PARENT MODULE ARGUMENTS: a module as a child that ends with process PARENT (child.py)."""

from __future__ import annotations

import runpy
import sys

from datasets.jobs.child import tie_to

if __name__ == "__main__":
    tie_to(int(sys.argv[1]))
    module = sys.argv[2]
    sys.argv = sys.argv[2:]
    runpy.run_module(module, run_name="__main__", alter_sys=True)
