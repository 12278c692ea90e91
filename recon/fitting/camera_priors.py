"""What is likely of a picture whose camera is unknown, in IoU that an unlikely one must win.

One outline does not tell all of shape and camera. People hold cameras level, above the floor, with an ordinary lens,
mostly before the object; and real furniture is about as deep for its width as others of its kind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PriorOptions:
    """The costs; each is the square of its root, so that they serve as residuals, too."""

    roll: float = 0.004  # of 8 degrees
    focal: float = 0.003  # of a focal length 1.8 times longer or shorter than usual
    elevation: float = 0.004  # of 8 degrees below the floor or above 40 degrees
    behind: float = 0.01  # of a view from straight behind
    turn: float = 0.002  # of a given camera turned by as much as it may be
    depth: float = 0.004  # of a depth one spread off the usual; at most 3 spreads count


def roots(
    up: np.ndarray,
    azimuth: float,
    elevation: float,
    zoom: float,
    extent: np.ndarray,
    usual_depth: tuple[float, float] | None,
    options: PriorOptions,
) -> np.ndarray:
    """(6,) roots of the costs.

    up            (3,) the object's vertical in the camera frame
    azimuth, elevation  degrees, where the camera stands; zoom: the focal length in units of an ordinary one
    extent        (3,) width, depth and height of the shape
    usual_depth   median and spread of log(depth / width), or None
    """
    roll = np.degrees(np.arctan2(up[0], -up[1]))
    odd = 0.0
    if usual_depth is not None:
        odd = float(np.clip((np.log(extent[1] / extent[0]) - usual_depth[0]) / usual_depth[1], -3, 3))
    return np.array(
        [
            np.sqrt(options.roll) * roll / 8,
            np.sqrt(options.focal) * np.log(zoom) / np.log(1.8),
            np.sqrt(options.elevation) * min(elevation, 0.0) / 8,
            np.sqrt(options.elevation) * max(elevation - 40, 0.0) / 8,
            np.sqrt(options.behind) * np.sin(np.radians(azimuth) / 2),
            np.sqrt(options.depth) * odd,
        ]
    )
