"""Cameras that are found with the shape: where the object is before each of them, and their focal length."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from procmodels.shape import Shape
from recon.fitting import camera_priors
from recon.fitting.camera_priors import PriorOptions
from recon.fitting.placement import moved_frame, rigid_velocities, yaw
from recon.fitting.state import Posed
from recon.geometry.view_geometry import seen_from
from recon.scene import Cameras as Views

FOCAL = 5.0  # a fifth of the focal length's logarithm moves an outline about as much as the other numbers do


@dataclass(frozen=True)
class Cameras:
    """Place = target_from_shape (4, 4) for each view, row by row, and what the focal length is in units of a guess.

    A step is, view by view, a rotation vector and a translation in the shape's own frame, and a fifth of the focal
    length's logarithm; the object moves away as that grows, so that only the perspective changes.

    views       the guesses; the pose of a view is the identity, or a known one
    focal_free  the focal length is a guess
    known       the poses are known, but where the object is; they may be turned by `doubt` degrees, 0 for not at all
    usual_depth median and spread of log(depth / width) of real objects, or None
    """

    views: Views
    focal_free: bool = True
    known: bool = False
    doubt: float = 0.0
    usual_depth: tuple[float, float] | None = None
    costs: PriorOptions = field(default_factory=PriorOptions)

    @property
    def free(self) -> np.ndarray:
        turns = not self.known or self.doubt > 0
        return np.array(([turns] * 3 + [True] * 3) * len(self.views) + [self.focal_free and not self.known])

    @property
    def fronts(self) -> int:
        return 1 if self.known else 4

    def place(self, target_from_shape: np.ndarray, zoom: float) -> np.ndarray:
        """Of (V, 4, 4) and the focal length in units of the guess."""
        return np.append(target_from_shape.ravel(), zoom)

    def frames(self, place: np.ndarray) -> tuple[np.ndarray, float]:
        """What `place` was made of."""
        return place[:-1].reshape(-1, 4, 4), float(place[-1])

    def shared(self, places: list[np.ndarray]) -> np.ndarray:
        """The place of all views, with one focal length, from places of each view alone."""
        alone = [self.frames(p) for p in places]
        zoom = float(np.exp(np.mean([np.log(z) for _, z in alone])))
        frames = np.concatenate([f for f, _ in alone])
        frames[:, :3, 3] *= zoom / np.array([z for _, z in alone])[:, None]  # of one size in the picture
        return self.place(frames, zoom)

    def posed(self, shape: Shape, place: np.ndarray, front: int) -> Posed:
        frames, zoom = self.frames(place)
        poses = self.views.cam_from_world @ frames
        poses[:, :3] /= np.linalg.norm(frames[:, :3, 0], axis=1)[:, None, None]
        K = self.views.K.copy()
        K[:, (0, 1), (0, 1)] *= zoom
        return Posed(shape, frames[0], poses, K)

    def moved(self, place: np.ndarray, delta: np.ndarray) -> np.ndarray:
        delta = delta * self.free
        frames, zoom = self.frames(place)
        grown = float(np.exp(FOCAL * delta[-1]))
        out = np.stack(
            [moved_frame(f, np.append(d, 0)) for f, d in zip(frames, delta[:-1].reshape(-1, 6), strict=True)]
        )
        out[:, :3, 3] *= grown  # the focal length is free only where the world is the camera's frame
        return self.place(out, zoom * grown)

    def velocities(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        v = posed.shape.vertices()
        count = len(self.views)
        out = np.zeros((count, *v.shape, 6 * count + 1))
        for i, pose in enumerate(posed.cam_from_shape):
            # A step counts translations in the frame of the shape, whose unit is canonical.
            out[i, ..., 6 * i : 6 * i + 6] = rigid_velocities(v)
            seen = v @ pose[:3, :3].T + pose[:3, 3]
            seen[:, 2] = 0  # a longer lens shows all as if it lay further from the axis
            out[i, ..., -1] = FOCAL * (seen + pose[:3, 3]) @ pose[:3, :3]
        return out

    def turned(self, place: np.ndarray, front: int, to: int) -> np.ndarray:
        frames, zoom = self.frames(place)
        return self.place(frames @ yaw(np.pi / 2 * (to - front)).round(), zoom)

    def half_turn(self, front: int) -> int | None:
        return None if self.known else (front + 2) % 4

    def priors(self, posed: Posed, place: np.ndarray) -> np.ndarray:
        frames, zoom = self.frames(place)
        if self.known:
            doubt = np.radians(self.doubt) or np.inf
            turns = [cv2.Rodrigues(f[:3, :3] / np.linalg.norm(f[:3, 0]))[0].ravel() for f in frames]
            return np.sqrt(self.costs.turn / len(frames)) * np.concatenate(turns) / doubt
        extent = np.ptp(posed.shape.vertices(), axis=0)
        rows = []
        for pose in posed.cam_from_shape:
            azimuth, elevation = seen_from(pose[:3, :3], pose[:3, 3])
            up = pose[:3, 2]
            rows.append(camera_priors.roots(up, azimuth, elevation, zoom, extent, self.usual_depth, self.costs))
        return np.concatenate(rows) / np.sqrt(len(rows))
