"""From photos of a piece of furniture to an editable procedural mesh.

    python run_recon.py photos/ --class chair

The command itself is recon/command.py, which an installed package runs as `nnproc-recon` or `python -m recon`.
"""

from __future__ import annotations

import sys

from recon.command import main
from recon.system import process

if __name__ == "__main__":
    sys.exit(process.run(main))
