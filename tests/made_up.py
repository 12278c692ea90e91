"""A made-up finished run, for the tests of the last stage: four photos of a chair, one of them without a camera."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

import procmodels
from recon.geometry.raster import iou, silhouettes
from recon.outputs.result import Result
from recon.scene import NO_FRAMES, Cameras, Canonical, Frames, Poses, Scene, Silhouettes, cam_from_canonical, unseen

CHAIR = {"width": 0.5, "depth": 0.5, "leg_height": 0.4, "legs": "basic", "arms": "basic", "back": "vbar"}
SIZES = np.array([(120, 90), (120, 90), (90, 120), (120, 90)])


def world_from_canonical() -> np.ndarray:
    """A similarity that is nothing special: scale 3.1, turned about two axes, moved."""
    turn, _ = cv2.Rodrigues(np.array([0.4, -0.9, 0.3]))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = 3.1 * turn, (4.0, -2.0, 7.5)
    return matrix


def cameras(names: tuple[str, ...], sizes: np.ndarray) -> Cameras:
    """Cameras round the canonical origin, in the world frame."""
    world = world_from_canonical()
    K, poses = [], []
    for i, (width, height) in enumerate(sizes):
        eye = np.array([2.2 * np.cos(i), 2.2 * np.sin(i), 0.9])
        forward = -eye / np.linalg.norm(eye)
        right = np.cross(forward, (0, 0, 1)) / np.linalg.norm(np.cross(forward, (0, 0, 1)))
        cam = np.eye(4)
        cam[:3, :3] = np.stack([right, np.cross(forward, right), forward])
        cam[:3, 3] = -cam[:3, :3] @ eye
        # Rigid: the world's scale is taken out of the rotation and put into the distance.
        cam = np.diag([3.1, 3.1, 3.1, 1]) @ cam @ np.linalg.inv(world)
        poses.append(cam)
        K.append([(110.0 + i, 0, width / 2 + 3), (0, 112.0, height / 2 - 2), (0, 0, 1)])
    return Cameras(names, np.array(K), np.array(poses), sizes)


def made_up(folder: Path, names: tuple[str, ...] = ("a.jpg", "b.JPG", "c <i>&.png", "d.jpg")) -> Result:
    """The result; its photos are written into `folder`. The second photo has no camera, the last is not used."""
    rng = np.random.default_rng(0)
    paths = tuple(folder / f"{i}.png" for i in range(4))
    for path, (width, height) in zip(paths, SIZES, strict=True):
        cv2.imwrite(str(path), rng.integers(0, 255, (height, width, 3)).astype(np.uint8))
    frames = Frames(names, paths, SIZES, np.full(4, np.nan), np.ones(4), (None,) * 4, (("x<y.mov", "not a photo"),))
    keep = [0, 2, 3]
    views = cameras(tuple(names[i] for i in keep), SIZES[keep])
    canonical = Canonical(world_from_canonical())
    shape = procmodels.load("paper/chair").build(CHAIR)
    drawn = silhouettes(shape, views.K, cam_from_canonical(views, canonical), views.sizes)
    masks = tuple(np.roll(m, 1, axis=1) for m in drawn)
    points = rng.normal(size=(20, 3)) * 0.2 + world_from_canonical()[:3, 3]
    return Result(
        class_name="chair",
        params=dict(CHAIR),
        frames=frames,
        scene=Scene(
            Poses(views, tuple(paths[i] for i in keep), points, rng.random((20, 3)) < 0.5, (names[1],)),
            Silhouettes(
                views.names, masks, ("grabcut",) * 3, np.array([True, True, False]), None, ((names[3], "it disagrees"),)
            ),
            canonical,
        ),
        view_iou=np.array([iou(a, b) for a, b in zip(drawn, masks, strict=True)]),
        confidence=0.8,
        explanation="the outlines agree <well>",
        alternatives=(("front turned by 180 degrees", 0.7),),
        seconds={"frames": 1.5, "poses": 20.0},
        warnings=("look out for <script>",),
        seed=3,
        height_m=0.9,
        versions={"python": "3.11"},
    )


def without_views(result: Result) -> Result:
    """The same object, known from elsewhere than photos."""
    scene = unseen(result.scene.canonical)
    return replace(result, frames=NO_FRAMES, scene=scene, view_iou=np.zeros(0), height_m=None)
