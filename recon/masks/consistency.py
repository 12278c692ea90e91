"""Which views contradict the others: masks or cameras that cannot belong to the object that the other views show.

The hull of the other views holds the whole object, and mostly more than it. So a view is held to two things that are
true of every right one, from wherever it looks: its mask lies within the picture of that hull (`covered`), and what it
carves off the hull is nothing that the other masks need (`kept`). That the hull shows more than the mask is no
contradiction: a view from a side that no other one has sees the object thinner than the others can know.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from recon.geometry import voxel_carving
from recon.geometry.voxel_carving import Cells
from recon.scene import Cameras

LONGEST = 320  # px of the pictures that are compared
WITNESSES = 5  # other views that are asked what a view takes from them
SUSPECTS = 6  # views that may be the one which spoils the others' hull
TURNS = 24  # places round the object that a camera may belong to instead
FITS, BETTER = 0.9, 0.1  # of a mask, covered from another place, and how much more it then overlaps


@dataclass(frozen=True)
class Contradiction:
    """A view that contradicts the others.

    covered, kept  as above; usual: what is usually covered, the median of the views that agree
    turned         degrees round the upright through the object by which its camera would fit, None if nothing fits
    """

    view: int
    covered: float
    kept: float
    usual: float
    turned: float | None


@dataclass(frozen=True)
class Votes:
    """Cells, which of them the masks of some views hold, one pixel wider, and which most pictures show.

    total   (*shape) int16, how many of the views; inside: V of (*shape) bool
    """

    cells: Cells
    cameras: Cameras
    masks: list[np.ndarray]
    inside: list[np.ndarray]
    total: np.ndarray
    seen: np.ndarray
    views: tuple[int, ...]

    def less(self, v: int) -> Votes:
        """Without a view."""
        return replace(self, total=self.total - self.inside[v], views=tuple(w for w in self.views if w != v))

    def hull(self, share: float) -> np.ndarray:
        """Cells that this share of the views hold."""
        return (self.total >= share * len(self.views)) & self.seen

    def covered(self, solid: np.ndarray, v: int) -> float:
        """Share of a view's mask that the picture of some cells covers."""
        shown = voxel_carving.picture(self.cells, solid, self.cameras, v)
        return float((shown & self.masks[v]).sum() / max(1, self.masks[v].sum()))

    def each_covered(self, share: float) -> dict[int, float]:
        """Of every view by the hull of the others."""
        return {v: self.covered(self.less(v).hull(share), v) for v in self.views}

    def kept(self, v: int, share: float) -> float:
        """Mean share of what the others' hull shows of their masks that is left when this view carves it, too."""
        rest = self.less(v)
        solid = rest.hull(share)
        _, seen = voxel_carving.add_up(self.cells, self.cameras.subset([v]), [self.masks[v]])
        carved = solid & (self.inside[v] | (seen == 0))  # what it does not see it does not carve
        places = np.linspace(0, len(rest.views) - 1, WITNESSES).round().astype(int)
        pairs = [(self.covered(carved, w), self.covered(solid, w)) for w in {rest.views[i] for i in places}]
        return float(np.mean([a / b for a, b in pairs if b > 0] or [1.0]))


def votes(
    cells: Cells, cameras: Cameras, masks: list[np.ndarray], possible: list[np.ndarray], share: float, fine: int
) -> Votes | None:
    """The masks' votes on cells round what most of that share of them hold; None when they have nothing in common.

    possible  V of (H, W) bool, where the object is or may be, hidden by something: nothing is carved there
    """
    cameras = cameras.scaled(min(1.0, LONGEST / float(cameras.sizes.max())))
    small, loose = (
        [_resized(m, size) for m, size in zip(some, cameras.sizes, strict=True)] for some in (masks, possible)
    )
    # A cell's middle can fall beside a member that is thinner than a cell: a pixel of slack.
    wide = [cv2.dilate(m.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32) for m in loose]
    rough = voxel_carving.held(cells, cameras, wide, 0.75 * share * len(cameras))
    if not rough.any():
        return None
    cells = voxel_carving.around(cells, rough, fine)
    each = [voxel_carving.add_up(cells, cameras.subset([v]), [m]) for v, m in enumerate(wide)]
    inside = [total > 0.5 for total, _ in each]
    total = np.sum(inside, axis=0, dtype=np.int16)
    seen = np.sum([seen for _, seen in each], axis=0) >= voxel_carving.MOST * len(cameras)
    return Votes(cells, cameras, small, inside, total, seen, tuple(range(len(wide))))


def contradictions(found: Votes, share: float, slack: np.ndarray, least: int) -> list[Contradiction]:
    """The views that contradict the others, one after the other: a wrong one spoils what the others are measured with.

    share  of the others that must hold a cell of their hull
    slack  (V,) how much less than usual may be covered of a mask, and kept by it
    least  views; fewer cannot outvote one
    """
    out = []
    for _ in range(len(found.views) // 2):
        if len(found.views) < least:
            break
        covered = found.each_covered(share)
        if all(c >= 1 - slack[v] for v, c in covered.items()):
            break
        worst = _worst(found, covered, share)
        rest = found.less(worst)
        after = rest.each_covered(share)
        usual = float(np.median(list(after.values())))
        own = found.covered(rest.hull(share), worst)
        if own >= usual - slack[worst]:
            break
        kept = found.kept(worst, share)
        out.append(Contradiction(worst, own, kept, usual, _turned(rest, worst, share)))
        found = rest
    for v in found.views if len(found.views) >= least else ():
        if (kept := found.kept(v, share)) < 1 - slack[v] - 0.05:
            out.append(Contradiction(v, found.covered(found.less(v).hull(share), v), kept, 1.0, None))
    return out


def _worst(found: Votes, covered: dict[int, float], share: float) -> int:
    """The view without which the others agree best: of few views a wrong one spoils the hull of each."""
    suspects = sorted(covered, key=covered.__getitem__)[:SUSPECTS]
    if len(found.views) > 2 * SUSPECTS or len(suspects) == 1:
        return suspects[0]
    return max(suspects, key=lambda v: (np.mean(list(found.less(v).each_covered(share).values())), -covered[v]))


def _turned(rest: Votes, view: int, share: float) -> float | None:
    """Degrees, to about 15, by which a view's camera must go round the object so that its mask fits the hull."""
    solid = rest.hull(share)
    if not solid.any():
        return None
    middle = rest.cells.origin + rest.cells.axes.T @ ((np.argwhere(solid).mean(0) + 0.5) * rest.cells.side)
    mask, up = rest.masks[view], rest.cells.axes[2]

    def overlap(degrees: float) -> tuple[float, float]:
        turn = np.eye(4)
        turn[:3, :3] = cv2.Rodrigues(np.radians(degrees) * up)[0]
        turn[:3, 3] = middle - turn[:3, :3] @ middle
        poses = rest.cameras.cam_from_world.copy()
        poses[view] = poses[view] @ turn
        shown = voxel_carving.picture(rest.cells, solid, replace(rest.cameras, cam_from_world=poses), view)
        both = float((shown & mask).sum())
        return both / max(1, (shown | mask).sum()), both / max(1, mask.sum())

    here = overlap(0)[0]
    tried = {d: overlap(d) for d in np.arange(1, TURNS) * 360 / TURNS}
    best = max(tried, key=lambda d: tried[d][0])
    fits = tried[best][1] >= FITS and tried[best][0] > here + BETTER
    return float((best + 180) % 360 - 180) if fits else None


def _resized(mask: np.ndarray, size: np.ndarray) -> np.ndarray:
    return cv2.resize(mask.astype(np.float32), (int(size[0]), int(size[1])), interpolation=cv2.INTER_AREA) >= 0.5
