"""One mask whose camera is found with the shape: what is known of it, and where views of a bank would have it stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from nnproc.rays import look_at_cameras
from procmodels import Model
from recon.fitting.camera_priors import PriorOptions
from recon.fitting.found_cameras import Cameras
from recon.fitting.mask_target import Level, Masks
from recon.fitting.problem import Problem
from recon.fitting.search import Schedule
from recon.fitting.silhouette_bank import Bank, BankOptions, Hit, search
from recon.fitting.state import State
from recon.geometry.view_geometry import Box, mask_box, rolled, seen_from, shortest_turn, towards, window
from recon.scene import Cameras as Views


@dataclass(frozen=True)
class CameraSearchOptions:
    """How the search runs."""

    bank: BankOptions = field(default_factory=BankOptions)
    size: int = 104  # px, side of the window on the object
    levels: tuple[Level, ...] = (Level(4, blur=2), Level(2, blur=1), Level(1, blur=2))
    placed: int = 40  # views of the bank that are drawn exactly
    starts: int = 12  # of these, that are polished coarsely
    finals: int = 3  # of these, whose discrete parameters are searched
    finished: int = 2  # of these, that are polished to the end
    coarse: Schedule = field(default_factory=lambda: Schedule(steps=(4, 3, 4), levels=(0, 1)))
    fine: Schedule = field(
        default_factory=lambda: Schedule(
            sweeps=4, tries=4, far=8, steps=(4, 4, 6), levels=(0, 1), settle=(0.04, 0.015, 0.005, 0.002)
        )
    )
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


class ViewProblem(Problem):
    """Parameters and cameras that explain masks; the views' windows are of one size."""

    placement: Cameras
    target: Masks

    def direction(self, state: State) -> tuple[float, float]:
        """Azimuth and elevation in degrees from which the first camera sees the object."""
        pose = self.posed(state).cam_from_shape[0]
        return seen_from(pose[:3, :3], pose[:3, 3])

    def agreement(self, state: State) -> float:
        """Mean IoU with the masks, without priors."""
        return 1 - self.target.loss(self.posed(state))


def problem_of(model: Model, views: Sequence[OneView], options: CameraSearchOptions, held: bool = False) -> ViewProblem:
    """The problem of these masks; `held` if the shape is known and the cameras alone are sought. All views must know
    equally much of their cameras, as photos of one camera do."""
    windows = [window(v.mask, v.K, options.size, v.known) for v in views]
    shares, valid, K = (np.stack(w) for w in zip(*windows, strict=True))
    poses = np.stack([np.eye(4) if v.cam_from_model is None else v.cam_from_model for v in views])
    names = tuple(f"view {i}" for i in range(len(views)))
    cameras = Cameras(
        Views(names, K, poses, np.full((len(views), 2), options.size)),
        focal_free=not views[0].focal_known,
        known=views[0].cam_from_model is not None,
        doubt=views[0].doubt,
        usual_depth=model.usual_depth,
        costs=options.priors,
    )
    return ViewProblem(model, Masks(shares, valid, options.levels), cameras, held)


def starts(problem: ViewProblem, bank: Bank, options: CameraSearchOptions, count: int) -> list[State]:
    """The views of the bank that agree best with the one mask, drawn exactly in its place."""
    target = problem.target
    hits = search(bank, target.hard[0], target.valid[0], options.bank, _allowed(problem, bank, options))
    placed = [_placed(problem, bank, h) for h in _spread(bank, hits, options.placed)]
    return distinct(problem, placed, count, 3)


def distinct(problem: ViewProblem, states: list[State], count: int, each: int) -> list[State]:
    """The best states, at most `each` of them from one side."""
    sides: dict[int, int] = {}
    out: list[State] = []
    for state in sorted(states, key=problem.loss):
        side = round(problem.direction(state)[0] / 30) % 12
        sides[side] = sides.get(side, 0) + 1
        if sides[side] <= each and len(out) < count:
            out.append(state)
    return out


def _spread(bank: Bank, hits: list[Hit], count: int) -> list[Hit]:
    """The best hits, no shape twice from one side."""
    chosen: dict[tuple[int, int], Hit] = {}
    for hit in hits:
        chosen.setdefault((int(bank.shape[hit.entry]), int(bank.azimuth[hit.entry] // 45)), hit)
        if len(chosen) == count:
            break
    return list(chosen.values())


def _allowed(problem: ViewProblem, bank: Bank, options: CameraSearchOptions) -> np.ndarray:
    """(N,) bool: views of the bank that a known pose allows, otherwise all."""
    views = problem.placement.views
    if not problem.placement.known:
        return np.ones(len(bank.bits), bool)
    ray = np.linalg.inv(views.K[0]) @ [*_middle(problem, mask_box(problem.target.hard[0]), 0.0), 1]
    azimuth, elevation = seen_from(views.cam_from_world[0, :3, :3], ray)
    known, seen = (towards(a, e) for a, e in ((azimuth, elevation), (bank.azimuth, bank.elevation)))
    cosine = seen @ known
    return cosine >= min(np.cos(np.radians(options.near)), np.sort(cosine)[-100:][0])


def _placed(problem: ViewProblem, bank: Bank, hit: Hit) -> State:
    """The state that shows a view of the bank where the mask is."""
    K, i = problem.placement.views.K[0], hit.entry
    size = float(np.sqrt(hit.box[2] * hit.box[3]))  # pixels
    tangent = float(np.sqrt(bank.box[i, 2] * bank.box[i, 3]))
    distance, focal = float(bank.distance[i]), size / tangent
    if not problem.placement.free[-1]:
        distance, focal = distance * K[0, 0] / focal, float(K[0, 0])
    shrunk = bank.distance[i] / distance
    lens = np.array([(focal, 0, K[0, 2]), (0, focal * K[1, 1] / K[0, 0], K[1, 2]), (0, 0, 1)])
    ray = np.linalg.inv(lens) @ [*_middle(problem, hit.box, hit.roll), 1]
    middle = np.array([*(bank.box[i, :2] + bank.box[i, 2:] / 2) * shrunk, 1])
    turn = cv2.Rodrigues(np.array([0, 0, np.radians(hit.roll)]))[0]
    look = shortest_turn(np.array([0, 0, 1.0]), ray) @ turn @ shortest_turn(middle, np.array([0, 0, 1.0]))
    pose = look_at_cameras([float(bank.azimuth[i])], [float(bank.elevation[i])], distance, 30, 64)[1][0].numpy()
    pose[:3] = look @ pose[:3]
    params = bank.params[int(bank.shape[i])]
    world = problem.placement.views.cam_from_world[0]
    if problem.placement.known:  # it sets the turn and the depth
        pose[:3, :3] = world[:3, :3]
        pose[:3] *= max(float(world[2, 3]), 1e-6) / pose[2, 3]
    frame = np.linalg.inv(world) @ pose
    return problem.state(params, problem.placement.place(frame[None], focal / K[0, 0]))


def _middle(problem: ViewProblem, box: Box | None, roll: float) -> np.ndarray:
    """(2,) window pixels: the middle of a box in the mask rolled by that much."""
    assert box is not None
    forward = rolled(problem.target.hard[0], roll)[1]
    point = np.array([box[0] + box[2] / 2 - 0.5, box[1] + box[3] / 2 - 0.5, 1])
    return cv2.invertAffineTransform(forward) @ point + 0.5
