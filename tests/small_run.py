"""The pipeline on a few small photos with little effort, as a process of its own: python -m tests.small_run ...

PHOTOS OUT MASKS [--force]. Made for tests that end it in all ways (tests/test_kills.py).
"""

import logging
import sys
from pathlib import Path

from recon.system import process


def main() -> int:
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    from recon.cameras.sfm_options import PosesOptions
    from recon.fitting import refine, view_starts
    from recon.outputs import write
    from recon.pipelines import photos
    from recon.pipelines.stages import Redo

    folder, out, masks = map(Path, sys.argv[1:4])
    options = photos.ReconOptions(
        class_name="paper/chair",
        masks=masks,
        redo=Redo(force="--force" in sys.argv),
        poses=PosesOptions(attempts=1),
        fit=view_starts.FitOptions(size=32, max_views=4, random=8, kept=1),
        refine=refine.RefineOptions(size=48, max_views=4, candidates=1),
        outputs=write.OutputsOptions(renders=1, render_size=64),
    )
    photos.run(folder, out, options)
    return 0


if __name__ == "__main__":
    sys.exit(process.run(main))
