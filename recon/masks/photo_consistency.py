"""What the room behind the object looks like, seen through its planes from the other photos.

A pixel whose ray meets the floor (or a wall) at X has the colour that the other photos show at X, if it sees the room;
if it sees the object, most of them disagree. Shadows on the floor do not disturb this: the lamps do not move.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from recon.geometry.room_planes import Room
from recon.scene import Cameras

Window = tuple[slice, slice]  # rows and columns of a picture
FAR = 30.0  # of the median camera distance: where a ray ends that meets no plane


@dataclass(frozen=True)
class Agreement:
    """How well the pixels of one view agree with other views through the room's planes.

    share  (h, w) float32, 0..1, of the views that could see the same place of the room, those that show the same colour
    count  (h, w) float32, how many views could see it
    """

    share: np.ndarray
    count: np.ndarray


def places_behind(room: Room, cameras: Cameras, view: int, step: int = 1, window: Window | None = None) -> np.ndarray:
    """(h, w, 3) float32 world points where the rays of every step-th pixel (of a window) meet the room's next plane."""
    rows, columns = window or (slice(0, int(cameras.sizes[view, 1])), slice(0, int(cameras.sizes[view, 0])))
    u, v = np.meshgrid(np.arange(columns.start, columns.stop, step) + 0.5, np.arange(rows.start, rows.stop, step) + 0.5)
    rotation = cameras.cam_from_world[view, :3, :3]
    rays = np.stack([u, v, np.ones_like(u)], -1) @ (np.linalg.inv(cameras.K[view]).T @ rotation)
    centre = cameras.centres()[view]
    reach = np.full(u.shape, FAR * room.distance)
    for plane in (room.floor, *room.walls):
        speed = rays @ plane[:3]
        hits = speed < -1e-9  # planes face the cameras
        distance = -(plane[:3] @ centre + plane[3]) / np.where(hits, speed, -1.0)
        reach = np.where(hits & (distance > 0), np.minimum(reach, distance), reach)
    return (centre + rays * reach[..., None]).astype(np.float32)


def project(points: np.ndarray, cameras: Cameras, view: int) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows (h, w) float32 where world points (h, w, 3) float32 appear; far outside for those behind.

    cv2 counts pixel centres from 0, the project from 0.5.
    """
    P = cameras.K[view] @ cameras.cam_from_world[view, :3]
    P[:2] -= 0.5 * P[2]
    x, y, depth = cv2.split(cv2.transform(points, P.astype(np.float32)))
    inverse = cv2.divide(1.0, cv2.max(depth, 1e-6))  # type: ignore[call-overload]
    return cv2.multiply(x, inverse), cv2.multiply(y, inverse)


def look_up(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The values of an image (h, w, 4) at columns x and rows y, bilinear, centres counted from 0; outside it the last
    channel is not zero."""
    return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(0, 0, 0, 255))


def speaking(image: np.ndarray, hidden: np.ndarray | None = None) -> np.ndarray:
    """(h, w, 4) uint8: an image (h, w, 3) and where it sees the object (h, w); nowhere when nothing is known yet."""
    silent = np.zeros(image.shape[:2], np.uint8) if hidden is None else np.where(hidden, 255, 0).astype(np.uint8)
    return np.dstack([image, silent])


def neighbours(cameras: Cameras, most: int) -> list[np.ndarray]:
    """For each view the indices of up to `most` others, nearest by the angle between their optical axes first."""
    forward = cameras.cam_from_world[:, 2, :3]
    angle = np.arccos(np.clip(forward @ forward.T, -1, 1))
    np.fill_diagonal(angle, np.inf)
    return [np.argsort(row, kind="stable")[: min(most, len(cameras) - 1)] for row in angle]


def agree(
    images: list[np.ndarray],
    cameras: Cameras,
    room: Room,
    view: int,
    others: np.ndarray,
    tolerance: int,
    window: Window = (slice(None), slice(None)),
) -> Agreement:
    """Compare one view (or a window of it) with others, through the room.

    images     V of (h, w, 4) uint8, equalised; the last channel is not zero where a view sees the object and so cannot
               speak about the room (`speaking`)
    tolerance  0..255, of a colour channel; one pixel of shift is forgiven too
    """
    height, width = images[view].shape[:2]
    window = (slice(*window[0].indices(height)[:2]), slice(*window[1].indices(width)[:2]))
    places = places_behind(room, cameras, view, window=window)
    own, square = images[view][window][..., :3], np.ones((3, 3), np.uint8)
    slack = np.full(own.shape, tolerance, np.uint8)
    silent = np.zeros(own.shape[:2], np.uint8)
    low = np.dstack([cv2.subtract(cv2.erode(own, square), slack), silent])
    high = np.dstack([cv2.add(cv2.dilate(own, square), slack), silent])
    same, count = np.zeros(own.shape[:2], np.float32), np.zeros(own.shape[:2], np.float32)
    for j in (int(o) for o in others):
        there = look_up(images[j], *project(places, cameras, j))
        cv2.accumulate(cv2.inRange(there, low, high), same)
        count += there[..., 3] == 0
    return Agreement(same / np.maximum(255 * count, 1), count)


def gains(images: list[np.ndarray], cameras: Cameras, room: Room, near: list[np.ndarray]) -> np.ndarray:
    """(V, 3) float: what the images (h, w, 3) uint8 are multiplied by to make exposure and white balance equal.

    Every pair of views gives the median ratio of colours at the same places of the room; least squares gives the gains.
    """
    rows, values = [], []
    loud = [speaking(image) for image in images]
    for i in range(len(images)):
        places = places_behind(room, cameras, i, step=8)
        own = images[i][::8, ::8].astype(np.float32)
        for j in near[i]:
            there = look_up(loud[int(j)], *project(places, cameras, int(j)))
            inside = there[..., 3] == 0
            if inside.sum() >= 50:
                ratio = np.log((own[inside] + 4) / (there[inside][:, :3].astype(np.float32) + 4))
                row = np.zeros(len(images))
                row[i], row[j] = 1, -1
                rows.append(row)
                values.append(np.median(ratio, axis=0))
    if not rows:
        return np.ones((len(images), 3))
    # One more row: the gains' mean is zero.
    A, b = np.vstack([*rows, np.ones(len(images))]), np.vstack([*values, np.zeros(3)])
    return np.exp(-np.linalg.lstsq(A, b, rcond=None)[0])
