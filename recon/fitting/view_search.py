"""The search on silhouettes for one mask whose camera is found, too: where the object is, and ways to move it.

The seven numbers of the alignment here mean: turn and place of the object before the camera, and the focal length (the
object moves away as the focal length grows, so that only the perspective changes).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from scipy.optimize import minimize

from nnproc.rays import look_at_cameras
from procmodels import Model
from procmodels.space import Params
from recon.fitting import camera_priors
from recon.fitting.camera_priors import PriorOptions
from recon.fitting.silhouette_bank import Bank, BankOptions, Hit, search
from recon.fitting.silhouette_search import RefineOptions, SilhouetteSearch, State
from recon.geometry.object_windows import Crops
from recon.geometry.raster import coverage
from recon.geometry.raster import silhouettes as silhouettes_of
from recon.geometry.view_geometry import Box, mask_box, rolled, seen_from, shortest_turn, towards, window
from recon.scene import Cameras, Canonical, cam_from_canonical


@dataclass(frozen=True)
class CameraSearchOptions:
    """How the search runs."""

    bank: BankOptions = field(default_factory=BankOptions)
    size: int = 104  # px, side of the window on the object
    placed: int = 40  # views of the bank that are drawn exactly
    starts: int = 12  # of these, that are polished coarsely
    finals: int = 5  # of these, whose discrete parameters are searched
    climbs: int = 250  # evaluations of the last search on IoU itself
    coarse: RefineOptions = field(default_factory=lambda: RefineOptions(blurs=(5.0, 2.5), steps=4))
    fine: RefineOptions = field(default_factory=lambda: RefineOptions(blurs=(4.0, 1.5), steps=4, sweeps=2, tries=3))
    near: float = 25.0  # degrees between a known view direction and views of the bank
    priors: PriorOptions = field(default_factory=PriorOptions)


@dataclass(frozen=True)
class OneView:
    """One mask and what is known of its camera.

    mask            (H, W) bool
    K               (3, 3) float, pixels; its focal length is a guess unless focal_known
    cam_from_model  (4, 4) rigid or None: the whole pose is known, in a frame with canonical axes about the object
    known           (H, W) bool or None: where the mask says something; the object may go on where it does not
    doubt           degrees by which that pose may be turned; 0 holds the turn. Where the object is, is always found
    """

    mask: np.ndarray
    K: np.ndarray
    focal_known: bool = False
    cam_from_model: np.ndarray | None = None
    doubt: float = 0.0
    known: np.ndarray | None = None


@dataclass(frozen=True)
class View(State):
    """A state with its focal length, in units of the guess."""

    zoom: float = 1.0


def _spread(bank: Bank, hits: list[Hit], count: int) -> list[Hit]:
    """The best hits, no shape twice from one side."""
    chosen: dict[tuple[int, int], Hit] = {}
    for hit in hits:
        chosen.setdefault((int(bank.shape[hit.entry]), int(bank.azimuth[hit.entry] // 45)), hit)
        if len(chosen) == count:
            break
    return list(chosen.values())


class ViewSearch(SilhouetteSearch):
    """The search on silhouettes with a camera that is found, too."""

    def __init__(self, model: Model, view: OneView, options: CameraSearchOptions) -> None:
        share, valid, K = window(view.mask, view.K, options.size, view.known)
        pose = np.eye(4) if view.cam_from_model is None else view.cam_from_model
        cameras = Cameras(("view",), K[None], pose[None], np.array([[options.size] * 2]))
        super().__init__(model, Crops(cameras, share[None], valid[None]), options.coarse)
        self.view, self.costs = view, options
        n = len(self.scalars)
        if view.focal_known or view.cam_from_model is not None:
            self.free[n + 6] = 0  # the focal length
        if view.cam_from_model is not None and not view.doubt:
            self.free[n : n + 3] = 0  # the turn
        self.area = float(self.hard.sum())

    def neighbours(self, state: State) -> Iterator[tuple[str, State]]:
        """As in refine; a known pose holds the front as well."""
        known = self.view.cam_from_model is not None
        return ((name, s) for name, s in super().neighbours(state) if not (known and name.startswith("front")))

    # Where the object is

    def allowed(self, bank: Bank) -> np.ndarray:
        """(N,) bool: views of the bank that a known pose allows, otherwise all."""
        if self.view.cam_from_model is None:
            return np.ones(len(bank.bits), bool)
        ray = np.linalg.inv(self.crops.cameras.K[0]) @ [*self._middle(mask_box(self.hard[0]), 0.0), 1]
        azimuth, elevation = seen_from(self.view.cam_from_model[:3, :3], ray)
        known, views = (towards(a, e) for a, e in ((azimuth, elevation), (bank.azimuth, bank.elevation)))
        cosine = views @ known
        return cosine >= min(np.cos(np.radians(self.costs.near)), np.sort(cosine)[-100:][0])

    def placed(self, bank: Bank, hit: Hit) -> View:
        """The state that shows a view of the bank where the mask is."""
        K, i = self.crops.cameras.K[0], hit.entry
        size = float(np.sqrt(hit.box[2] * hit.box[3]))  # pixels
        tangent = float(np.sqrt(bank.box[i, 2] * bank.box[i, 3]))
        distance, focal = float(bank.distance[i]), size / tangent
        if not self.free[-1]:
            distance, focal = distance * K[0, 0] / focal, float(K[0, 0])
        shrunk = bank.distance[i] / distance
        lens = np.array([(focal, 0, K[0, 2]), (0, focal * K[1, 1] / K[0, 0], K[1, 2]), (0, 0, 1)])
        ray = np.linalg.inv(lens) @ [*self._middle(hit.box, hit.roll), 1]
        middle = np.array([*(bank.box[i, :2] + bank.box[i, 2:] / 2) * shrunk, 1])
        turn = cv2.Rodrigues(np.array([0, 0, np.radians(hit.roll)]))[0]
        look = shortest_turn(np.array([0, 0, 1.0]), ray) @ turn @ shortest_turn(middle, np.array([0, 0, 1.0]))
        pose = look_at_cameras([float(bank.azimuth[i])], [float(bank.elevation[i])], distance, 30, 64)[1][0].numpy()
        pose[:3] = look @ pose[:3]
        params = bank.params[int(bank.shape[i])]
        return self._in_world(params, pose, focal / K[0, 0])

    def _in_world(self, params: Params, pose: np.ndarray, zoom: float) -> View:
        """The state of a pose (4, 4) rigid, cam_from_canonical; a known pose sets the turn and the depth."""
        world = self.crops.cameras.cam_from_world[0]
        if self.view.cam_from_model is not None:
            pose[:3, :3] = world[:3, :3]
            pose[:3] *= max(float(world[2, 3]), 1e-6) / pose[2, 3]
        state = self.state(params, Canonical(np.linalg.inv(world) @ pose), 0)
        return View(state.units, state.discrete, state.canonical, 0, zoom)

    def _middle(self, box: Box | None, roll: float) -> np.ndarray:
        """(2,) window pixels: the middle of a box in the mask rolled by that much."""
        assert box is not None
        forward = rolled(self.hard[0], roll)[1]
        point = np.array([box[0] + box[2] / 2 - 0.5, box[1] + box[3] / 2 - 0.5, 1])
        return cv2.invertAffineTransform(forward) @ point + 0.5

    def direction(self, state: State) -> tuple[float, float]:
        """Azimuth and elevation in degrees from which the camera sees the object."""
        pose = self.pose(state)
        return seen_from(pose[:3, :3], pose[:3, 3])

    def pose(self, state: State) -> np.ndarray:
        """(4, 4) rigid, cam_from_canonical in canonical units."""
        return cam_from_canonical(self.crops.cameras, Canonical(state.canonical))[0]

    # What SilhouetteSearch asks for

    def images(self, state: State, draw: object) -> np.ndarray:
        """(1, S, S), drawn with the state's own focal length."""
        K = self.crops.cameras.K.copy()
        K[:, (0, 1), (0, 1)] *= getattr(state, "zoom", 1.0)
        function = silhouettes_of if draw is silhouettes_of else coverage
        return np.stack(function(self.built(state), K, self.pose(state)[None], self.crops.cameras.sizes))

    def moved(self, state: State, delta: np.ndarray) -> State:
        """As in SilhouetteSearch; the last number is a fifth of the focal length's logarithm instead of a size."""
        delta = delta * self.free
        grown = float(np.exp(5 * delta[-1]))
        delta[-1] = 0
        out = super().moved(state, delta)
        assert isinstance(out, View)
        canonical = out.canonical.copy()
        if grown != 1:
            canonical[:3, 3] *= grown  # the focal length is free only where the world is the camera's frame
        return replace(out, canonical=canonical, zoom=out.zoom * grown)

    def agreement(self, state: State) -> float:
        """IoU with the mask, without priors."""
        return super().iou(state)

    def iou(self, state: State) -> float:
        """What the search maximises: IoU less what an unusual camera costs."""
        return self.agreement(state) - float((self._unusual(state) ** 2).sum())

    def _residual(self, state: State, blur: float) -> np.ndarray:
        return np.concatenate([super()._residual(state, blur), np.sqrt(self.area) * self._unusual(state)])

    def _unusual(self, state: State) -> np.ndarray:
        """Roots of what this picture costs for being unlikely; where the pose is known, for being turned from it."""
        if self.view.cam_from_model is not None:
            doubt = np.radians(self.view.doubt) or np.inf
            turned = cv2.Rodrigues(np.asarray(state.canonical[:3, :3], float))[0].ravel()
            return np.sqrt(self.costs.priors.turn) * turned / doubt
        extent = np.ptp(self.built(state).bounds(), axis=0)
        up, zoom = self.pose(state)[:3, 2], getattr(state, "zoom", 1.0)
        return camera_priors.roots(up, *self.direction(state), zoom, extent, self.model.usual_depth, self.costs.priors)

    # Ways to move

    def starts(self, bank: Bank, count: int) -> list[State]:
        """The views of the bank that agree best with the mask, drawn exactly in its place."""
        hits = search(bank, self.hard[0], self.crops.valid[0], self.costs.bank, self.allowed(bank))
        placed: list[State] = [self.placed(bank, h) for h in _spread(bank, hits, self.costs.placed)]
        return self.distinct(placed, count, 3)

    def climbed(self, state: State) -> View:
        """The state after a simplex search on IoU itself, which Gauss-Newton on blurred differences only approaches."""
        n = len(self.scalars)
        steps = np.array([0.08] * n + [0.05] * 3 + [0.02] * 3 + [0.04])
        free = np.flatnonzero(self.free)

        def loss(x: np.ndarray) -> float:
            delta = np.zeros(n + 7)
            delta[free] = x * steps[free]
            return -self._soft_iou(self.moved(state, delta))

        # A scalar at its upper end is tried downwards.
        signs = np.where(np.r_[state.units, np.zeros(7)] > 0.8, -1.0, 1.0)[free]
        simplex = np.vstack([np.zeros(len(free)), np.diag(signs)])
        options = {"maxfev": self.costs.climbs, "initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-4}
        found = minimize(loss, np.zeros(len(free)), method="Nelder-Mead", options=options)
        delta = np.zeros(n + 7)
        delta[free] = found.x * steps[free]
        best = max((self.moved(state, delta), state), key=self.iou)
        assert isinstance(best, View)
        return best

    def _soft_iou(self, state: State) -> float:
        """IoU of shares of pixels, less what an unusual camera costs."""
        drawn, mask = self.images(state, coverage) * self.crops.valid, self.crops.masks
        both = float(np.minimum(drawn, mask).sum() / max(np.maximum(drawn, mask).sum(), 1))
        return both - float((self._unusual(state) ** 2).sum())

    # Several answers

    def distinct(self, states: list[State], count: int, each: int) -> list[State]:
        """The best states, at most `each` of them from one side."""
        sides: dict[int, int] = {}
        out: list[State] = []
        for _, _, state in sorted(((-self.iou(s), i, s) for i, s in enumerate(states)), key=lambda t: t[:2]):
            side = round(self.direction(state)[0] / 30) % 12
            sides[side] = sides.get(side, 0) + 1
            if sides[side] <= each and len(out) < count:
                out.append(state)
        return out

    def other_cameras(self, best: State, others: Sequence[State]) -> list[tuple[str, float]]:
        """(description, IoU) of the finalists that are seen from elsewhere."""
        out, (azimuth, _) = [], self.direction(best)
        for state in others:
            there, elevation = self.direction(state)
            apart = round((there - azimuth + 180) % 360 - 180)
            word = "front" if abs(apart) > 40 else "camera"
            text = f"{word} turned by {apart} degrees, seen from an elevation of {elevation:.0f} degrees"
            out.append((text, self.agreement(state)))
        return out
