"""What comes nearest to an object that the class cannot make: a search by distances from silhouettes.

Where outlines are met to a pixel or two, their overlap is the sharpest guide there is. Where they cannot be, it trades
size and place for covered pixels. Here an answer fills the object's own length and width and stands on the floor where
the object does, and its parameters are those whose surface lies nearest to the visual hull.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from recon.fitting import shape_fit
from recon.fitting.hull_target import Hull
from recon.fitting.mask_target import Masks
from recon.fitting.placement import Standing
from recon.fitting.problem import Problem
from recon.fitting.search import Schedule, solve
from recon.fitting.shape_fit import ShapeFitOptions
from recon.fitting.shape_starts import StartOptions
from recon.fitting.state import State
from recon.geometry.object_windows import Crops, object_crops
from recon.scene import Cameras, Canonical, Scene
from recon.shapes import shape_target


@dataclass(frozen=True)
class DistanceOptions:
    """When and how long is searched. Distances are mean squares, in canonical units, as D_chamfer is."""

    explained: float = 3e-4  # an answer in its place that is as near as this is left alone
    misplaced: float = 0.045  # canonical units or log scale: more than boxes and floors are wrong by
    gain: float = 0.7  # a new answer must lie within this share of the old one's distance, if that was in its place
    loss: float = 4.0  # or within this, if it was not
    tiny: float = 1e-4  # distances below are alike
    many: int = 12  # views, of which one may be wrong
    carved: int = 224  # pixels along each side of the windows that carve the hull
    search: Schedule = field(default_factory=lambda: Schedule(kept=2, sweeps=4, tries=2, steps=(8, 2, 8)))
    hull: ShapeFitOptions = field(default_factory=lambda: ShapeFitOptions(StartOptions(random=64), keep=3))


def widest_gap(cameras: Cameras, canonical: Canonical) -> float:
    """Degrees round the object's vertical in which no camera stands; 360 for one camera or none."""
    centres = (cameras.centres() - canonical.world_from_canonical[:3, 3]) @ canonical.world_from_canonical[:3, :2]
    azimuth = np.sort(np.degrees(np.arctan2(centres[:, 1], centres[:, 0])))
    return float(np.diff(azimuth, append=azimuth[:1] + 360).max(initial=0.0)) if len(azimuth) else 360.0


class DistanceSearch:
    """States in the object's place: `distances` compares them with the hull, `outlines` with the masks."""

    def __init__(
        self,
        anywhere: Problem,
        scene: Scene,
        options: DistanceOptions = DistanceOptions(),
    ) -> None:
        """`anywhere` has the masks in windows as its target, and the object in any place before their cameras.

        Raises ReconstructionError when the silhouettes have no common inside.
        """
        masks = anywhere.target
        assert isinstance(masks, Masks)
        silhouettes, canonical = scene.silhouettes, scene.canonical
        self.anywhere, self.options, self.canonical = anywhere, options, canonical
        carved = object_crops(scene, options.carved)
        views = anywhere.placement.views  # type: ignore[attr-defined]
        ground = -0.5
        if silhouettes.floor is not None:
            normal, offset = silhouettes.floor[:3], silhouettes.floor[3]
            ground = -float(normal @ canonical.world_from_canonical[:3, 3] + offset) / canonical.scale
        # Masks that people drew are right; those cut out here may have a hole.
        doubtful = "grabcut" in silhouettes.source and len(masks.masks) >= options.many
        self.hull = Hull(carved, Crops(views, masks.masks, masks.valid), canonical, ground, doubtful)
        # The hull is as long and as wide as the object to 1 or 2 percent, where a carving that forgives is to 8.
        corners = self.hull.triangles.reshape(-1, 3)
        low, high = corners.min(0), corners.max(0)
        self.standing = Standing(
            views,
            canonical.world_from_canonical,
            middle=(low + high)[:2] / 2,
            longest=float((high - low).max()),
            ground=ground,
        )
        self.distances = Problem(anywhere.model, self.hull, self.standing)
        self.outlines = Problem(anywhere.model, masks, self.standing)

    def better(self, state: State) -> State | None:
        """The nearest answer that is found, standing, when a state that is anywhere fills another place or is much
        farther; else None."""
        placed, distance = self.placed(state), self.hull.loss(self.anywhere.posed(state))
        if placed and distance <= self.options.explained:
            return None
        found = solve(self.distances, self.starts(state, by_hull=not placed), self.options.search)
        allowed = self.options.gain * distance if placed else self.options.loss * max(distance, self.options.tiny)
        return found.state if found.loss < allowed else None

    def placed(self, state: State) -> bool:
        """Whether a state that is anywhere has the object's length and middle, and stands where it stands."""
        posed = self.anywhere.posed(state)
        box_from_shape = np.linalg.inv(self.canonical.world_from_canonical) @ posed.target_from_shape
        scale = float(np.linalg.norm(box_from_shape[:3, 0]))
        foot = box_from_shape[2, 3] + scale * float(posed.shape.bounds()[0, 2])
        middle = box_from_shape[:2, 3] - self.standing.middle
        off = np.array([*middle, np.log(scale / self.standing.longest), foot - self.standing.ground])
        return bool((np.abs(off) <= self.options.misplaced).all())

    def stood(self, state: State) -> State:
        """The state upright on the floor in the object's place, as long as the object, facing where it faces."""
        return replace(state, place=self.standing.start(self.anywhere.posed(state).target_from_shape))

    def starts(self, state: State, by_hull: bool = True) -> Iterator[State]:
        """The state, stood, and, which takes longer, the answer for the hull as a mesh whose front is unknown."""
        yield self.stood(state)
        if by_hull:
            target = shape_target.of_triangles(self.hull.triangles, ("z",), "visual hull")
            params, place = shape_fit.nearest(self.anywhere.model, target, self.options.hull)
            world = self.canonical.world_from_canonical @ place.world_from_canonical
            yield self.distances.state(params, self.standing.start(world))
