"""Where a shape may stand: fixed, on the floor of a hull, upright in a box, anywhere, or before cameras that are found.

A placement turns a state's numbers (place, front) into a Posed shape, moves them, and says how fast vertices then move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from procmodels.shape import Shape
from recon.fitting.state import Posed
from recon.scene import Cameras as Views
from recon.scene import Canonical, cam_from_canonical

NO_VIEWS = Views((), np.zeros((0, 3, 3)), np.zeros((0, 4, 4)), np.zeros((0, 2), int))
NOTHING = np.zeros(0)


def yaw(radians: float) -> np.ndarray:
    """(4, 4) rotation about the vertical."""
    c, s = np.cos(radians), np.sin(radians)
    out = np.eye(4)
    out[:2, :2] = [(c, -s), (s, c)]
    return out


@dataclass(frozen=True)
class Fixed:
    """The shape's place is known: `target_from_shape`, the identity if the target lies in the canonical frame."""

    views: Views = NO_VIEWS
    target_from_shape: np.ndarray = field(default_factory=lambda: np.eye(4))
    free: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    fronts: int = 1

    def start(self) -> np.ndarray:
        """The place, which is nowhere in particular."""
        return NOTHING

    def posed(self, shape: Shape, place: np.ndarray, front: int) -> Posed:
        return _posed(shape, self.views, self.target_from_shape)

    def moved(self, place: np.ndarray, delta: np.ndarray) -> np.ndarray:
        return place

    def velocities(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        return np.zeros((*posed.shape.vertices().shape, 0))

    def turned(self, place: np.ndarray, front: int, to: int) -> np.ndarray:
        return place

    def half_turn(self, front: int) -> int | None:
        return (front + 2) % 4 if self.fronts == 4 else None

    def priors(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        return NOTHING


@dataclass(frozen=True)
class Standing(Fixed):
    """Upright on the floor in the object's place, as long as the object; place = (yaw,), which is held.

    target_from_shape  a frame with canonical axes about the object
    middle, longest, ground  of the object in that frame: (2,) of its box, its longest side, the floor's height
    """

    middle: np.ndarray = field(default_factory=lambda: np.zeros(2))
    longest: float = 1.0
    ground: float = -0.5
    free: np.ndarray = field(default_factory=lambda: np.zeros(1, bool))
    fronts: int = 4

    def start(self, world_from_shape: np.ndarray | None = None) -> np.ndarray:
        """The place that faces where a shape in the world faces."""
        if world_from_shape is None:
            return np.zeros(1)
        box_from_shape = np.linalg.inv(self.target_from_shape) @ world_from_shape
        return np.array([np.arctan2(box_from_shape[1, 0], box_from_shape[0, 0])])

    def posed(self, shape: Shape, place: np.ndarray, front: int) -> Posed:
        out = yaw(float(place[0]))
        out[:3, :3] *= self.longest
        out[:3, 3] = *self.middle, self.ground - self.longest * float(shape.vertices()[:, 2].min())
        return _posed(shape, self.views, self.target_from_shape @ out)

    def velocities(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        return np.zeros((*posed.shape.vertices().shape, 1))

    def turned(self, place: np.ndarray, front: int, to: int) -> np.ndarray:
        return place + np.pi / 2 * (to - front)


@dataclass(frozen=True)
class Upright:
    """In a box whose sides are known, or nearly so when `loose`; front = which of the ways to stand.

    ways  (4, 4) similarities target_from_canonical. The place is (5,): log scale, translation, yaw in a way's frame
    """

    ways: Sequence[np.ndarray]
    loose: bool = False
    stiffness: float = 0.1  # roots of loss a unit of the place, when loose: the box is right to about its spacing

    @property
    def free(self) -> np.ndarray:
        return np.full(5, self.loose)

    @property
    def fronts(self) -> int:
        return len(self.ways)

    def start(self) -> np.ndarray:
        """In the middle of the box."""
        return np.zeros(5)

    def posed(self, shape: Shape, place: np.ndarray, front: int) -> Posed:
        move = yaw(place[4])
        move[:3, :3] *= np.exp(place[0])
        move[:3, 3] = place[1:4]
        return _posed(shape, NO_VIEWS, self.ways[front] @ move)

    def moved(self, place: np.ndarray, delta: np.ndarray) -> np.ndarray:
        return place + delta * self.free

    def velocities(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        v = posed.shape.vertices()
        # The translation is in the way's frame, the vertices turn and grow with the shape.
        shift = yaw(-place[4])[:3, :3] * np.exp(-place[0])
        return np.concatenate(
            [v[..., None], np.broadcast_to(shift, (len(v), 3, 3)), np.cross((0, 0, 1), v)[..., None]], 2
        )

    def turned(self, place: np.ndarray, front: int, to: int) -> np.ndarray:
        return place * (1, -1, -1, 1, 1) if to == self.half_turn(front) else self.start()

    def half_turn(self, front: int) -> int | None:
        back = self.ways[front][:3, :3] @ yaw(np.pi)[:3, :3]
        return next((i for i, way in enumerate(self.ways) if np.allclose(way[:3, :3], back)), None)

    def priors(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        return self.stiffness * place if self.loose else NOTHING


@dataclass(frozen=True)
class Similarity:
    """Anywhere before known views; place = target_from_shape (4, 4), moved in the shape's own frame by a rotation
    vector, a translation and a log scale. `upright` holds the tilt: a floor is known better than outlines tell it."""

    views: Views
    upright: bool = False
    fronts: int = 4

    @property
    def free(self) -> np.ndarray:
        return np.array([not self.upright] * 2 + [True] * 5)

    def posed(self, shape: Shape, place: np.ndarray, front: int) -> Posed:
        return _posed(shape, self.views, place)

    def moved(self, place: np.ndarray, delta: np.ndarray) -> np.ndarray:
        return moved_frame(place, delta * self.free)

    def velocities(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        v = posed.shape.vertices()
        return np.concatenate([rigid_velocities(v), v[..., None]], 2)

    def turned(self, place: np.ndarray, front: int, to: int) -> np.ndarray:
        return place @ yaw(np.pi / 2 * (to - front)).round()

    def half_turn(self, front: int) -> int | None:
        return (front + 2) % 4

    def priors(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        return NOTHING


def _posed(shape: Shape, views: Views, target_from_shape: np.ndarray) -> Posed:
    """Before cameras of the target's frame."""
    poses = cam_from_canonical(views, Canonical(target_from_shape)) if len(views) else views.cam_from_world
    return Posed(shape, target_from_shape, poses, views.K)


def rigid_velocities(vertices: np.ndarray) -> np.ndarray:
    """(n, 3, 6) of vertices (n, 3) under a rotation vector and a translation."""
    turning = np.stack([np.cross(axis, vertices) for axis in np.eye(3)], -1)
    return np.concatenate([turning, np.broadcast_to(np.eye(3), turning.shape)], 2)


def moved_frame(matrix: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """A similarity (4, 4) moved in its own frame by (7,): rotation vector, translation, log scale."""
    change = np.eye(4)
    change[:3, :3] = np.exp(delta[6]) * cv2.Rodrigues(np.asarray(delta[:3], float))[0]
    change[:3, 3] = delta[3:6]
    out = matrix @ change
    # Rounding of many small moves must not build up into shear.
    u, s, vt = np.linalg.svd(out[:3, :3])
    out[:3, :3] = s.mean() * u @ vt
    return out
