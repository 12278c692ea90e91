"""From photos, masks, meshes, point clouds or splats of furniture to the parameters of a procedural model.

    import recon

    result = recon.reconstruct("chair.obj", class_name="chair", out="results/chair")
    result.params, result.confidence, result.shape().vertices()

Importing this loads nothing heavy: libraries come with the first call. Nothing is printed; progress goes to the logger
"recon", which says nothing until the program that uses it gives it a handler.
"""

from __future__ import annotations

import importlib
import logging
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from recon.api import Result, reconstruct
    from recon.scene import InputError, ReconError, ReconstructionError

__all__ = ["InputError", "ReconError", "ReconstructionError", "Result", "reconstruct"]
_PLACES = {
    "Result": "recon.api",
    "reconstruct": "recon.api",
    "InputError": "recon.scene",
    "ReconError": "recon.scene",
    "ReconstructionError": "recon.scene",
}
logging.getLogger("recon").addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    """The names above, from where they live, when they are first used."""
    if name not in _PLACES:
        raise AttributeError(f"module 'recon' has no attribute {name!r}")
    return getattr(importlib.import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return [*__all__, *(n for n in globals() if n not in __all__)]
