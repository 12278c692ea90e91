"""What a mask's shape alone says: inverted, cut by the photo's edge, in pieces, filling everything."""

from __future__ import annotations

import cv2
import numpy as np

SUSPECT = 0.5  # of the photo's edge that an inverted mask has white, at least
SURELY = 0.9  # the same, where no other view can confirm it
RIVAL = 0.3  # a second part this large, compared with the largest, may be another object
FULL = 0.85  # of the photo that no photographed object fills
CUT = 0.02  # of the photo's edge that an object touches, at least, to be cut by it
FLAT, EDGED = 2.0, 0.75  # change of colour a pixel, 0..255, that is no edge; share of a right outline that is one
MANY = 0.34  # of the photos that must show something wrong before it is said


def edge_share(mask: np.ndarray) -> float:
    """Share of the pixels along the photo's edge that are object, for a mask (H, W) bool."""
    edge = np.concatenate([mask[0], mask[-1], mask[1:-1, 0], mask[1:-1, -1]])
    return float(edge.mean())


def surely_inverted(mask: np.ndarray) -> bool:
    """Whether white is the background: it runs all along the edge, and what is black does not."""
    return edge_share(mask) > SURELY and not mask.all()


def areas(mask: np.ndarray) -> np.ndarray:
    """Areas in px of the mask's connected parts, largest first."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return np.sort(stats[1:, cv2.CC_STAT_AREA])[::-1]


def outline_support(image: np.ndarray, mask: np.ndarray) -> float:
    """Share of the outline of a mask (H, W) bool that runs along an edge of its photo (H, W, 3) uint8 BGR; 1 for none.

    An edge is where the colour changes faster than it does in half of the photo.
    """
    colours = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2LAB).astype(np.float32), (0, 0), 1)
    across, down = (cv2.Sobel(colours, cv2.CV_32F, *d) / 8 for d in ((1, 0), (0, 1)))
    steep = np.sqrt((across**2 + down**2).max(2))
    near = cv2.dilate(steep, np.ones((5, 5), np.uint8))
    line = mask & (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    line[[0, -1]] = line[:, [0, -1]] = False  # where the photo ends, no edge can be
    return float((near[line] > max(FLAT, float(np.median(steep)))).mean()) if line.any() else 1.0


def unusable(mask: np.ndarray) -> str | None:
    """Why an automatic mask (H, W) bool cannot be the object, or None: it fills the photo, or runs along its edge."""
    if mask.mean() > FULL or edge_share(mask) > SUSPECT:
        return (
            "what was found fills the photo or runs along its edge: the object was not told from the room; give a mask"
        )
    return None


def implausible(masks: list[np.ndarray]) -> list[str]:
    """Warnings about masks (H, W) bool that were found automatically, each with what to do."""
    masks = [m for m in masks if m.any()]
    if not masks:
        return []
    parts = [areas(m) for m in masks]
    found = {
        "the object that was found reaches the photo's edge: the whole object must be in view, with floor around it": [
            edge_share(m) > CUT for m in masks
        ],
        "the object that was found falls into large separate pieces: parts are missing, or other things were taken": [
            len(a) > 1 and a[1] > RIVAL * a[0] for a in parts
        ],
        "the object that was found fills the photo: it was not told from the room behind it": [
            m.mean() > FULL for m in masks
        ],
    }
    return [
        f"in {sum(wrong)} of {len(masks)} photos {what}; look at contact_sheet.png and give masks (--masks)"
        for what, wrong in found.items()
        if np.mean(wrong) > MANY
    ]
