"""One mask, and a camera of which little or nothing is known: find parameters and camera together.

Views of a bank that look like the mask start the search. Each is then moved by the exact search of recon.refine, whose
seven numbers of the alignment here mean: turn and place of the object before the camera, and the focal length (the
object moves away as the focal length grows, so that only the perspective changes). One mask does not tell all of this;
weak priors decide what it leaves open: a camera held level, above the floor, with an ordinary lens.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from scipy.optimize import minimize

from nnproc.rays import look_at_cameras
from procmodels import Model
from procmodels.space import Params
from recon.crops import Crops
from recon.raster import coverage
from recon.raster import silhouettes as silhouettes_of
from recon.refine import Refined, RefineOptions, _Search, _State
from recon.scene import Cameras, Canonical, cam_from_canonical
from recon.view_bank import Bank, BankOptions, Hit, mask_box, rolled, search

USUAL_FOCAL = 1.4  # of the image's longer side: about 40 degrees
MARGIN = 1.35  # side of the window, in sizes of the object's box


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
    roll_cost: float = 0.004  # IoU that a roll of 8 degrees must win
    focal_cost: float = 0.003  # IoU that a focal length 1.8 times longer or shorter than usual must win
    elevation_cost: float = 0.004  # IoU that 8 degrees below the floor or above 40 degrees must win


@dataclass(frozen=True)
class OneView:
    """One mask and what is known of its camera.

    mask            (H, W) bool
    K               (3, 3) float, pixels; its focal length is a guess unless focal_known
    cam_from_model  (4, 4) rigid or None: the whole pose is known, in a frame with canonical axes about the object
    """

    mask: np.ndarray
    K: np.ndarray
    focal_known: bool = False
    cam_from_model: np.ndarray | None = None


@dataclass(frozen=True)
class FoundView:
    """The answer: refined (its canonical is in the frame of `cam_from_world`, iou at window size) and the camera."""

    refined: Refined
    K: np.ndarray
    cam_from_world: np.ndarray
    azimuth: float
    elevation: float


@dataclass(frozen=True)
class _View(_State):
    """A state with its focal length, in units of the guess."""

    zoom: float = 1.0


def guessed_K(width: int, height: int) -> np.ndarray:
    """(3, 3) pinhole of an ordinary lens, principal point in the middle."""
    focal = USUAL_FOCAL * max(width, height)
    return np.array([(focal, 0, width / 2), (0, focal, height / 2), (0, 0, 1)], float)


def find(model: Model, view: OneView, bank: Bank, options: CameraSearchOptions = CameraSearchOptions()) -> FoundView:
    """Parameters and camera that explain the mask best."""
    job = _ViewSearch(model, view, options)
    starts = job.starts(bank, options.starts)
    polished = job.distinct([job.polish(s) for s in starts], options.finals, 2)
    job.options = options.fine
    finals = sorted((job.climbed(job.improve_choices(s)) for s in polished), key=job.iou, reverse=True)
    best = job.climbed(finals[0])
    refined = Refined(
        job.params(best),
        Canonical(best.canonical),
        job.agreement(best),
        max(map(job.agreement, starts)),
        tuple(sorted([*job.alternatives(best), *job.other_cameras(best, finals[1:])], key=lambda a: -a[1])),
    )
    K = view.K.copy()
    K[(0, 1), (0, 1)] *= best.zoom
    return FoundView(refined, K, job.crops.cameras.cam_from_world[0], *job.direction(best))


def first_look(model: Model, view: OneView, bank: Bank, options: CameraSearchOptions = CameraSearchOptions()) -> float:
    """IoU after a short search: cheap evidence for or against a class."""
    job = _ViewSearch(model, view, options)
    return max(job.agreement(job.climbed(job.polish(s))) for s in job.starts(bank, 3))


def _spread(bank: Bank, hits: list[Hit], count: int) -> list[Hit]:
    """The best hits, no shape twice from one side."""
    chosen: dict[tuple[int, int], Hit] = {}
    for hit in hits:
        chosen.setdefault((int(bank.shape[hit.entry]), int(bank.azimuth[hit.entry] // 45)), hit)
        if len(chosen) == count:
            break
    return list(chosen.values())


def window(mask: np.ndarray, K: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The square on the object: shares of its pixels that are object (size, size) float32, which pixels lie in the
    photo (size, size) bool, and K for it. The mask must not be empty."""
    box = mask_box(mask)
    assert box is not None
    x, y, w, h = box
    side = int(np.ceil(MARGIN * max(w, h))) + 2
    left, top = round(x + w / 2 - side / 2), round(y + h / 2 - side / 2)
    pad = side
    both = np.stack([mask, np.ones_like(mask)], -1).astype(np.float32)
    both = cv2.copyMakeBorder(both, pad, pad, pad, pad, cv2.BORDER_CONSTANT, value=(0, 0))
    cut = both[top + pad : top + pad + side, left + pad : left + pad + side]
    small = cv2.resize(cut, (size, size), interpolation=cv2.INTER_AREA)
    moved = K.copy()
    moved[:2, 2] -= (left, top)
    moved[:2] *= size / side
    return small[..., 0], small[..., 1] > 0.99, moved


class _ViewSearch(_Search):
    """recon.refine's search with a camera that is found, too."""

    def __init__(self, model: Model, view: OneView, options: CameraSearchOptions) -> None:
        share, valid, K = window(view.mask, view.K, options.size)
        pose = np.eye(4) if view.cam_from_model is None else view.cam_from_model
        cameras = Cameras(("view",), K[None], pose[None], np.array([[options.size] * 2]))
        super().__init__(model, Crops(cameras, share[None], valid[None]), options.coarse)
        self.view, self.costs = view, options
        n = len(self.scalars)
        self.free = np.ones(n + 7)
        if view.focal_known or view.cam_from_model is not None:
            self.free[n + 6] = 0  # the focal length
        if view.cam_from_model is not None:
            self.free[n : n + 3] = 0  # the turn
        self.area = float(self.hard.sum())

    # Where the object is

    def allowed(self, bank: Bank) -> np.ndarray:
        """(N,) bool: views of the bank that a known pose allows, otherwise all."""
        if self.view.cam_from_model is None:
            return np.ones(len(bank.bits), bool)
        ray = np.linalg.inv(self.crops.cameras.K[0]) @ [*self._middle(mask_box(self.hard[0]), 0.0), 1]
        azimuth, elevation = _seen_from(self.view.cam_from_model[:3, :3], ray)
        known, views = (_unit(a, e) for a, e in ((azimuth, elevation), (bank.azimuth, bank.elevation)))
        cosine = views @ known
        return cosine >= min(np.cos(np.radians(self.costs.near)), np.sort(cosine)[-100:][0])

    def placed(self, bank: Bank, hit: Hit) -> _View:
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
        look = _shortest_turn(np.array([0, 0, 1.0]), ray) @ turn @ _shortest_turn(middle, np.array([0, 0, 1.0]))
        pose = look_at_cameras([float(bank.azimuth[i])], [float(bank.elevation[i])], distance, 30, 64)[1][0].numpy()
        pose[:3] = look @ pose[:3]
        params = bank.params[int(bank.shape[i])]
        return self._in_world(params, pose, focal / K[0, 0])

    def _in_world(self, params: Params, pose: np.ndarray, zoom: float) -> _View:
        """The state of a pose (4, 4) rigid, cam_from_canonical; a known pose sets the turn and the depth."""
        world = self.crops.cameras.cam_from_world[0]
        if self.view.cam_from_model is not None:
            pose[:3, :3] = world[:3, :3]
            pose[:3] *= max(float(world[2, 3]), 1e-6) / pose[2, 3]
        state = self.state(params, Canonical(np.linalg.inv(world) @ pose), 0)
        return _View(state.units, state.discrete, state.canonical, 0, zoom)

    def _middle(self, box: tuple[float, float, float, float] | None, roll: float) -> np.ndarray:
        """(2,) window pixels: the middle of a box in the mask rolled by that much."""
        assert box is not None
        forward = rolled(self.hard[0], roll)[1]
        point = np.array([box[0] + box[2] / 2 - 0.5, box[1] + box[3] / 2 - 0.5, 1])
        return cv2.invertAffineTransform(forward) @ point + 0.5

    def direction(self, state: _State) -> tuple[float, float]:
        """Azimuth and elevation in degrees from which the camera sees the object."""
        pose = self._pose(state)
        return _seen_from(pose[:3, :3], pose[:3, 3])

    def _pose(self, state: _State) -> np.ndarray:
        return cam_from_canonical(self.crops.cameras, Canonical(state.canonical))[0]

    # What recon.refine asks for

    def images(self, state: _State, draw: object) -> np.ndarray:
        """(1, S, S), drawn with the state's own focal length."""
        K = self.crops.cameras.K.copy()
        K[:, (0, 1), (0, 1)] *= getattr(state, "zoom", 1.0)
        function = silhouettes_of if draw is silhouettes_of else coverage
        return np.stack(function(self._built(state), K, self._pose(state)[None], self.crops.cameras.sizes))

    def moved(self, state: _State, delta: np.ndarray) -> _State:
        """As in recon.refine; the last number is a fifth of the focal length's logarithm instead of a size."""
        delta = delta * self.free
        grown = float(np.exp(5 * delta[-1]))
        delta[-1] = 0
        out = super().moved(state, delta)
        assert isinstance(out, _View)
        canonical = out.canonical.copy()
        if grown != 1:
            canonical[:3, 3] *= grown  # the focal length is free only where the world is the camera's frame
        return replace(out, canonical=canonical, zoom=out.zoom * grown)

    def agreement(self, state: _State) -> float:
        """IoU with the mask, without priors."""
        return super().iou(state)

    def iou(self, state: _State) -> float:
        """What the search maximises: IoU less what an unusual camera costs."""
        return self.agreement(state) - float((self._unusual(state) ** 2).sum())

    def _residual(self, state: _State, blur: float) -> np.ndarray:
        return np.concatenate([super()._residual(state, blur), np.sqrt(self.area) * self._unusual(state)])

    def _unusual(self, state: _State) -> np.ndarray:
        """(4,) roots of the priors' costs: roll, focal length, from below, from above."""
        if self.view.cam_from_model is not None:
            return np.zeros(4)
        pose, costs = self._pose(state), self.costs
        up, elevation = pose[:3, 2], self.direction(state)[1]
        roll = np.degrees(np.arctan2(up[0], -up[1]))
        zoom = np.log(getattr(state, "zoom", 1.0)) / np.log(1.8)
        outside = np.array([min(elevation, 0.0), max(elevation - 40, 0.0)]) / 8
        return np.array(
            [
                np.sqrt(costs.roll_cost) * roll / 8,
                np.sqrt(costs.focal_cost) * zoom,
                *np.sqrt(costs.elevation_cost) * outside,
            ]
        )

    # Ways to move

    def starts(self, bank: Bank, count: int) -> list[_State]:
        """The views of the bank that agree best with the mask, drawn exactly in its place."""
        hits = search(bank, self.hard[0], self.crops.valid[0], self.costs.bank, self.allowed(bank))
        placed: list[_State] = [self.placed(bank, h) for h in _spread(bank, hits, self.costs.placed)]
        return self.distinct(placed, count, 3)

    def climbed(self, state: _State) -> _View:
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
        assert isinstance(best, _View)
        return best

    def _soft_iou(self, state: _State) -> float:
        """IoU of shares of pixels, less what an unusual camera costs."""
        drawn, mask = self.images(state, coverage) * self.crops.valid, self.crops.masks
        both = float(np.minimum(drawn, mask).sum() / max(np.maximum(drawn, mask).sum(), 1))
        return both - float((self._unusual(state) ** 2).sum())

    # Several answers

    def distinct(self, states: list[_State], count: int, each: int) -> list[_State]:
        """The best states, at most `each` of them from one side."""
        sides: dict[int, int] = {}
        out: list[_State] = []
        for _, _, state in sorted(((-self.iou(s), i, s) for i, s in enumerate(states)), key=lambda t: t[:2]):
            side = round(self.direction(state)[0] / 30) % 12
            sides[side] = sides.get(side, 0) + 1
            if sides[side] <= each and len(out) < count:
                out.append(state)
        return out

    def other_cameras(self, best: _State, others: list[_State]) -> list[tuple[str, float]]:
        """(description, IoU) of the finalists that are seen from elsewhere."""
        out, (azimuth, _) = [], self.direction(best)
        for state in others:
            there, elevation = self.direction(state)
            apart = round((there - azimuth + 180) % 360 - 180)
            word = "front" if abs(apart) > 40 else "camera"
            text = f"{word} turned by {apart} degrees, seen from an elevation of {elevation:.0f} degrees"
            out.append((text, self.agreement(state)))
        return out


def _seen_from(rotation: np.ndarray, ray: np.ndarray) -> tuple[float, float]:
    """Azimuth (0..360) and elevation in degrees of a camera with rotation cam_from_canonical that looks along `ray`."""
    x, y, z = rotation.T @ ray / np.linalg.norm(ray)
    return float(np.degrees(np.arctan2(-x, y)) % 360), float(np.degrees(np.arcsin(np.clip(-z, -1, 1))))


def _unit(azimuth: float | np.ndarray, elevation: float | np.ndarray) -> np.ndarray:
    """(..., 3) unit vector from the object to the camera, for angles in degrees."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.stack([np.cos(e) * np.sin(a), -np.cos(e) * np.cos(a), np.sin(e)], -1)


def _shortest_turn(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(3, 3) rotation that takes the direction of `source` to that of `target`."""
    a, b = source / np.linalg.norm(source), target / np.linalg.norm(target)
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    return cv2.Rodrigues(axis / sine * np.arctan2(sine, a @ b))[0] if sine > 1e-9 else np.eye(3)
