"""Photos of a painted shape, drawn by casting rays: no Blender, and every colour is known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from procmodels.look import srgb
from procmodels.parts.primitives import box
from procmodels.shape import Part, Shape, normalised
from recon.appearance.atlas import unwrapped
from recon.appearance.views import Rays
from recon.scene import Cameras, Canonical, Poses, Scene, Silhouettes

SIZE = (160, 120)
FLOOR = (0.1, 0.8, 0.1)  # linear RGB behind the object: no part has such a green
Paint = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # places (n, 3), normals, parts -> (n, 3) linear


def stool() -> Shape:
    """A seat on two boards, the same on both sides."""
    parts = [
        box("seat", (-0.4, -0.3, 0.5), (0.4, 0.3, 0.62)),
        box("board left", (-0.38, -0.3, 0.0), (-0.28, 0.3, 0.5)),
        box("board right", (0.28, -0.3, 0.0), (0.38, 0.3, 0.5)),
    ]
    return normalised(parts)


def around(n: int, arc: float = 360.0, start: float = 20.0) -> list[np.ndarray]:
    """n cameras' cam_from_canonical (4, 4), from low and high in turn."""
    out = []
    for i in range(n):
        turn, up = np.radians(start + arc * i / n), np.radians((12, 42)[i % 2])
        eye = 2.3 * np.array([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)])
        forward = -eye / np.linalg.norm(eye)
        right = np.cross(forward, (0, 0, 1)) / np.linalg.norm(np.cross(forward, (0, 0, 1)))
        cam = np.eye(4)
        cam[:3, :3] = np.stack([right, np.cross(forward, right), forward])
        cam[:3, 3] = -cam[:3, :3] @ eye
        out.append(cam)
    return out


def photographed(
    shape: Shape, paint: Paint, poses: list[np.ndarray], folder: Path, gains: np.ndarray | None = None, spread: int = 0
) -> Scene:
    """Photos before a green floor; gains (V, 3) change each photo, masks are `spread` px too wide."""
    atlas = unwrapped(shape, 64)
    rays, n = Rays(atlas), len(poses)
    K = np.array([(1.5 * SIZE[0], 0, SIZE[0] / 2), (0, 1.5 * SIZE[0], SIZE[1] / 2), (0, 0, 1)])
    row, column = np.indices(SIZE[::-1]).reshape(2, -1) + 0.5
    masks, paths = [], []
    for i, pose in enumerate(poses):
        away = np.stack([column, row, np.ones_like(row)], 1) @ np.linalg.inv(K).T @ pose[:3, :3]
        eye = -pose[:3, :3].T @ pose[:3, 3]
        distance, triangle = rays.cast(eye, away)
        hit = np.isfinite(distance)
        image = np.tile(FLOOR, (len(row), 1))
        places = eye + distance[hit, None] * away[hit]
        image[hit] = paint(places, atlas.normals[triangle[hit]], atlas.part[triangle[hit]])
        image = np.clip(image * (1 if gains is None else gains[i]), 0, 1)
        paths.append(folder / f"{i:02d}.png")
        cv2.imwrite(str(paths[-1]), np.rint(255 * srgb(image)).astype(np.uint8).reshape(*SIZE[::-1], 3)[..., ::-1])
        mask = hit.reshape(SIZE[::-1]).astype(np.uint8)
        masks.append(cv2.dilate(mask, np.ones((2 * spread + 1,) * 2)) > 0)
    names = tuple(p.name for p in paths)
    cameras = Cameras(names, np.tile(K, (n, 1, 1)), np.array(poses), np.tile(SIZE, (n, 1)))
    placed = Poses(cameras, tuple(paths), np.zeros((0, 3)), np.zeros((0, n), bool))
    outlines = Silhouettes(names, tuple(masks), ("user",) * n, np.ones(n, bool))
    return Scene(placed, outlines, Canonical(np.eye(4)))


def screen() -> Shape:
    """A post that a screen hides from the front."""
    return normalised([box("post", (-0.1, 0.1, 0), (0.1, 0.3, 1)), box("screen", (-0.5, -0.3, 0), (0.5, -0.2, 1))])


def part_named(shape: Shape, name: str) -> tuple[int, Part]:
    return next((i, p) for i, p in enumerate(shape.parts) if p.name == name)
