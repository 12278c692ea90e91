"""Names of axes, and the rotation from a file's axes into the canonical ones (X right, faces -Y, Z up)."""

from __future__ import annotations

import numpy as np

AXES = {s + a: (-1.0 if s == "-" else 1.0) * np.eye(3)[i] for s in ("", "+", "-") for i, a in enumerate("xyz")}


def turn(up: str, front: str) -> np.ndarray:
    """(3, 3) rotation, canonical from file, for a file whose `up` and `front` are axes such as "y" or "-z".

    Raises ValueError when they are not, or lie on one line.
    """
    if up not in AXES or front not in AXES:
        raise ValueError(f"up and front are axes such as y or -z, not {up!r} and {front!r}")
    z, y = AXES[up], -AXES[front]
    if abs(z @ y) > 0.5:
        raise ValueError(f"up ({up}) and front ({front}) lie on one axis")
    return np.array([np.cross(y, z), y, z])
