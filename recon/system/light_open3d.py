"""open3d without its plotting in notebooks, which would load a web server that nothing here uses: 0.4 s a start."""

from __future__ import annotations

import sys
from types import ModuleType

_PLOTTING = "open3d.visualization.draw_plotly"


def without_plotting() -> None:
    """Call before open3d is imported; afterwards it changes nothing."""
    if "open3d" in sys.modules or _PLOTTING in sys.modules:
        return
    empty = ModuleType(_PLOTTING)
    for name in ("get_plotly_fig", "draw_plotly", "draw_plotly_server"):  # which open3d.visualization asks for
        setattr(empty, name, None)
    sys.modules[_PLOTTING] = empty
