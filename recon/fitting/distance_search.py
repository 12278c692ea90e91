"""What comes nearest to an object that the class cannot make: a search by distances from silhouettes.

Where outlines are met to a pixel or two, their overlap is the sharpest guide there is. Where they cannot be, it trades
size and place for covered pixels. Here an answer fills the object's own length and width and stands on the floor where
the object does, and its parameters are those whose surface lies nearest to the visual hull.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from procmodels import Model
from recon.fitting import shape_fit
from recon.fitting.chamfer_residuals import Body, Places
from recon.fitting.hull_distance import HullDistance
from recon.fitting.shape_fit import ShapeFitOptions
from recon.fitting.silhouette_search import RefineOptions, SilhouetteSearch, State
from recon.geometry.object_windows import object_crops
from recon.geometry.raster import silhouettes as silhouettes_of
from recon.scene import Cameras, Canonical, Poses, Silhouettes
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
    places: int = 1200  # on the shape's surface
    steps: int = 8  # Gauss-Newton steps of a polish
    short: int = 2  # of a changed choice
    sweeps: int = 4  # rounds over the discrete parameters
    tries: int = 2  # most promising changes of a round that are polished
    hull: ShapeFitOptions = field(default_factory=lambda: ShapeFitOptions(random=64, keep=3))


def widest_gap(cameras: Cameras, canonical: Canonical) -> float:
    """Degrees round the object's vertical in which no camera stands; 360 for one camera or none."""
    centres = (cameras.centres() - canonical.world_from_canonical[:3, 3]) @ canonical.world_from_canonical[:3, :2]
    azimuth = np.sort(np.degrees(np.arctan2(centres[:, 1], centres[:, 0])))
    return float(np.diff(azimuth, append=azimuth[:1] + 360).max(initial=0.0)) if len(azimuth) else 360.0


class DistanceSearch(SilhouetteSearch):
    """A search on silhouettes whose states stand in the object's place; only scalars, choices and the front move."""

    def __init__(
        self,
        model: Model,
        poses: Poses,
        silhouettes: Silhouettes,
        canonical: Canonical,
        refine: RefineOptions = RefineOptions(),
        options: DistanceOptions = DistanceOptions(),
    ) -> None:
        drawn = object_crops(poses.cameras, silhouettes, canonical, refine.size, refine.max_views)
        super().__init__(model, drawn, refine)
        self.costs, self.box = options, canonical.world_from_canonical
        self.box_from_world = np.linalg.inv(self.box)
        carved = object_crops(poses.cameras, silhouettes, canonical, options.carved)
        self.ground = -0.5
        if silhouettes.floor is not None:
            normal, offset = silhouettes.floor[:3], silhouettes.floor[3]
            self.ground = -float(normal @ self.box[:3, 3] + offset) / canonical.scale
        # Masks that people drew are right; those cut out here may have a hole.
        doubtful = "grabcut" in silhouettes.source and len(self.crops.masks) >= options.many
        self.hull = HullDistance(carved, self.crops, canonical, self.ground, doubtful)
        # The hull is as long and as wide as the object to 1 or 2 percent, where a carving that forgives is to 8.
        corners = self.hull.triangles.reshape(-1, 3)
        low, high = corners.min(0), corners.max(0)
        self.middle, self.longest = (low + high)[:2] / 2, float((high - low).max())

    def better(self, state: State) -> State:
        """The state, or the nearest answer that is found, when the state fills another place or is much farther."""
        placed, distance = self.placed(state), self.distance(state)
        if placed and distance <= self.costs.explained:
            return state
        found = self.nearest(state, by_hull=not placed)
        allowed = self.costs.gain * distance if placed else self.costs.loss * max(distance, self.costs.tiny)
        return found if self.distance(found) < allowed else state

    def placed(self, state: State) -> bool:
        """Whether a state has the object's length and middle, and stands where it stands."""
        box_from_shape = self.box_from_world @ state.canonical
        scale = float(np.linalg.norm(box_from_shape[:3, 0]))
        foot = box_from_shape[2, 3] + scale * float(self.built(state).bounds()[0, 2])
        off = np.array([*(box_from_shape[:2, 3] - self.middle), np.log(scale / self.longest), foot - self.ground])
        return bool((np.abs(off) <= self.costs.misplaced).all())

    def stood(self, state: State) -> State:
        """The state upright on the floor in the object's place, as long as the object, facing where it faces."""
        box_from_shape = self.box_from_world @ state.canonical
        yaw = np.arctan2(box_from_shape[1, 0], box_from_shape[0, 0])
        c, s = np.cos(yaw), np.sin(yaw)
        out = np.eye(4)
        out[:3, :3] = self.longest * np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)])
        out[:2, 3] = self.middle
        out[2, 3] = self.ground - self.longest * float(self.built(state).bounds()[0, 2])
        return replace(state, canonical=self.box @ out)

    def probes(self, state: State) -> np.ndarray:
        """(n,) finite differences of the scalars alone."""
        return super().probes(state)[: len(self.scalars)]

    def moved(self, state: State, delta: np.ndarray) -> State:
        """The state with its scalars moved by (n,) shares of their ranges."""
        return self.stood(replace(state, units=np.clip(state.units + delta, 0, 1)))

    def neighbours(self, state: State) -> Iterator[tuple[str, State]]:
        """States that differ in one discrete value or in the front, in the object's place."""
        return ((name, self.stood(s)) for name, s in super().neighbours(state))

    def distance(self, state: State) -> float:
        """Mean squared distances to the hull and from it, canonical units; comparable with D_chamfer."""
        return float(np.square(self._apart(state, self._places(state))).sum())

    def _places(self, state: State) -> Places:
        return Body.of(self.built(state)).places(self.costs.places)

    def _apart(self, state: State, places: Places) -> np.ndarray:
        """(places + hull's points,) whose squares sum to the distance."""
        body = Body.of(self.built(state))
        if places.count != len(body.corners):  # a part of no height came or went
            places = body.places(self.costs.places)
        own, growth = body.at(places)
        box_from_shape = self.box_from_world @ state.canonical
        own = own @ box_from_shape[:3, :3].T + box_from_shape[:3, 3]
        out = self.hull.sticking_out(own) * np.sqrt(growth / growth.sum())
        empty = self.hull.left_empty(self.images(state, silhouettes_of))
        return np.concatenate([out, empty / np.sqrt(len(empty))])

    def nearest(self, start: State, by_hull: bool = True) -> State:
        """The best by distance that is found from a start and, which takes longer, from the hull as a mesh."""
        starts = [self.stood(start), *([self.stood(self.from_hull())] if by_hull else [])]
        found = [self.improve(self.approach(s, self.costs.steps)) for s in starts]
        return self.approach(min(found, key=self.distance), self.costs.steps)

    def approach(self, state: State, steps: int) -> State:
        """Gauss-Newton steps of the scalars."""
        damping = 1e-2
        for _ in range(steps if len(self.scalars) else 0):
            residuals = partial(self._apart, places=self._places(state))
            state, damping, improved = self.step(state, residuals, damping)
            if not improved:
                break
        return state

    def improve(self, state: State) -> State:
        """Change one choice or the front at a time while that helps, polishing the most promising."""
        loss = self.distance(state)
        for _ in range(self.costs.sweeps):
            others = [s for _, s in self.neighbours(state)]
            ranked = sorted(((self.distance(s), i) for i, s in enumerate(others)))[: self.costs.tries]
            best = min((self.approach(others[i], self.costs.short) for _, i in ranked), key=self.distance)
            if (lower := self.distance(best)) >= loss * (1 - 1e-3):
                break
            state, loss = best, lower
        return state

    def from_hull(self) -> State:
        """The answer for the hull as a mesh that stands upright, with its front unknown."""
        target = shape_target.of_triangles(self.hull.triangles, ("z",), "visual hull")
        found = shape_fit.run(self.model, target, self.costs.hull)
        return self.state(found.params, Canonical(self.box @ found.canonical.world_from_canonical), 0)
