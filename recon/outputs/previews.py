"""Small shaded pictures of a shape for the report: soft daylight, a white floor, ray casting; no Blender, no GPU."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from procmodels.asset import COLOUR
from procmodels.look import Look, linear
from procmodels.normals import with_uv
from procmodels.shape import Shape

EYE_DISTANCE = 3.2  # canonical units: far enough for calm perspective
FILL = 0.80  # part of the picture that the object may take
FLOOR_RADIUS = 1.1  # canonical units: shadows fade out before it
SKY, SUN, BOUNCE = 0.85, 0.85, 0.5  # light from above, from the sun, and back from the floor


@dataclass(frozen=True)
class ShadeOptions:
    """How the previews look."""

    supersample: int = 2  # samples a pixel along each axis
    sky_lamps: int = 8  # shadow rays towards the sky a sample: more are smoother
    sun_lamps: int = 3  # shadow rays towards the sun a sample
    floor_blur: float = 0.008  # of the shadows on the floor, share of the picture's width
    sun_radius: float = 0.09  # radians: larger blurs the shadow's edge
    first_azimuth: float = 33.0  # degrees from the front (-Y) towards +X of the first picture
    elevation: float = 17.0  # degrees above the horizon
    background: tuple[float, float, float] = (0.915, 0.905, 0.885)  # linear RGB of the floor in full light
    sun: tuple[float, float, float] = (-0.45, -0.6, 0.9)  # direction towards the sun in the camera's heading


def render_previews(
    shape: Shape,
    n: int = 3,
    size: tuple[int, int] = (480, 480),
    options: ShadeOptions = ShadeOptions(),
    look: Look | None = None,
) -> list[np.ndarray]:
    """n pictures (H, W, 3) uint8 RGB of the shape, seen from all round; the first shows its front from the right.

    size is (width, height) in pixels.
    """
    tracer = _Tracer(shape, look)
    azimuths = [options.first_azimuth + 360 * i / n for i in range(n)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # numpy and open3d work outside the interpreter's lock
        return list(pool.map(lambda azimuth: _render(shape, tracer, np.radians(azimuth), size, options), azimuths))


def view(
    points: np.ndarray, azimuth: float, size: tuple[int, int], options: ShadeOptions = ShadeOptions()
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """A picture's camera, `azimuth` radians round Z: eye (3,), axes (3, 3) x, y (down), z (forward), focal length in
    pixels and the plane's place (2,) in the picture's middle, so that the points (n, 3) fill the (width, height).
    """
    elevation = np.radians(options.elevation)
    away = np.array([np.sin(azimuth) * np.cos(elevation), -np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    eye = EYE_DISTANCE * away
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    axes = np.stack([right, np.cross(-away, right), -away])
    seen = (points - eye) @ axes.T
    plane = seen[:, :2] / seen[:, 2:]
    low, high = plane.min(0), plane.max(0)
    return eye, axes, FILL * float(min(size / (high - low))), (low + high) / 2


class _Tracer:
    """The shape's triangles in open3d's ray caster."""

    def __init__(self, shape: Shape, look: Look | None) -> None:
        import open3d as o3d  # slow to import, and only needed for pictures

        tensor: Any = o3d.core.Tensor  # its stubs do not know that it takes arrays
        self._tensor = tensor
        pieces = [with_uv(part, look.uv[i] if look and look.uv else None) for i, part in enumerate(shape.parts)]
        offsets = np.cumsum([0] + [len(p.places) for p in pieces])
        vertices = np.concatenate([p.places for p in pieces])
        self.normals = np.concatenate([p.normals for p in pieces])
        self.triangles = np.concatenate([p.triangles + o for p, o in zip(pieces, offsets, strict=False)])
        self._paint = _Paint(look, np.concatenate([p.uv for p in pieces]), [len(p.triangles) for p in pieces])
        self.scene: Any = o3d.t.geometry.RaycastingScene()
        vertices, triangles = vertices.astype(np.float32), self.triangles.astype(np.uint32)
        self.scene.add_triangles(self._tensor(vertices), self._tensor(triangles))

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance (m,), inf where nothing is hit, normal (m, 3) and colour (m, 3) of the first hit of m rays."""
        hit = self.scene.cast_rays(self._rays(origins, directions))
        distance, uv = hit["t_hit"].numpy(), hit["primitive_uvs"].numpy()
        triangle = np.where(np.isfinite(distance), hit["primitive_ids"].numpy(), 0).astype(int)
        corners = self.triangles[triangle]
        weights = np.stack([1 - uv.sum(1), uv[:, 0], uv[:, 1]], 1)
        normals = _unit(np.einsum("mi,mij->mj", weights, self.normals[corners]))
        return distance, normals, self._paint.at(triangle, corners, weights)

    def free(self, origins: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """(m,) bool, whether m parallel rays leave without a hit."""
        return ~self.scene.test_occlusions(self._rays(origins, direction)).numpy()

    def _rays(self, origins: np.ndarray, directions: np.ndarray) -> Any:
        rays = np.empty((max(origins.size, directions.size) // 3, 6), np.float32)
        rays[:, :3], rays[:, 3:] = origins, directions
        return self._tensor(rays)


class _Paint:
    """The surface's colours, linear."""

    def __init__(self, look: Look | None, uv: np.ndarray, triangles: list[int]) -> None:
        colours = np.tile(COLOUR, (len(triangles), 1)) if look is None else look.colours
        self._colours, self._uv, self._picture = np.repeat(colours, triangles, axis=0), uv, None
        if look is not None and look.picture is not None:
            side = max(1, len(look.picture) // 2)  # as fine as the pictures that are drawn
            self._picture = cv2.resize(look.picture, (side, side), interpolation=cv2.INTER_AREA)

    def at(self, triangle: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(m, 3) on m triangles, whose corners (m, 3) have these weights (m, 3)."""
        if self._picture is None:
            return self._colours[triangle]
        u, v = np.einsum("mi,mij->jm", weights, self._uv[corners])
        side = len(self._picture)
        column, row = (np.clip(side * x, 0, side - 1).astype(int) for x in (u, 1 - v))
        return linear(self._picture[row, column] / 255)


def _render(
    shape: Shape,
    tracer: _Tracer,
    azimuth: float,
    size: tuple[int, int],
    options: ShadeOptions,
) -> np.ndarray:
    """One picture, from `azimuth` radians round Z."""
    s = options.supersample
    width, height = size[0] * s, size[1] * s
    eye, axes, focal, middle = view(shape.vertices(), azimuth, (width, height), options)
    away, right = eye / EYE_DISTANCE, axes[0]
    sun = options.sun[0] * right - options.sun[1] * away * (1, 1, 0) + (0, 0, options.sun[2])
    lamps = _lamps(_unit(sun), s * s, options)

    shape_hw = (size[1], size[0])
    rows, columns = np.indices(shape_hw)
    solid, floor, bare = np.zeros((3, *shape_hw))
    light = np.zeros((*shape_hw, 3))
    for i, lamp in enumerate(lamps):
        # The floor is blurred below, so that each of its pixels needs one of the samples only, in turn.
        turn = ((rows % s == i // s) & (columns % s == i % s)).ravel()
        x = (columns * s + i % s + 0.5 - width / 2) / focal + middle[0]
        y = (rows * s + i // s + 0.5 - height / 2) / focal + middle[1]
        directions = _unit(np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ axes)
        layers = _shade(tracer, eye, directions, shape.bounds()[0, 2], lamp, turn)
        for total, layer in zip((solid, light, floor, bare), (*layers, turn * (1 - layers[0])), strict=True):
            total += layer.reshape(total.shape) / len(lamps)
    # The few lamps cast faint streaks; on the floor they are blurred away, without letting the object bleed into it.
    open_floor, blurred = (cv2.GaussianBlur(x, (0, 0), options.floor_blur * size[0]) for x in (bare, floor))
    floor = (1 - solid) * blurred / np.maximum(open_floor, 1e-6)
    shown = light + floor[..., None] * np.array(options.background)
    return np.rint(255 * np.clip(shown, 0, 1) ** (1 / 2.2)).astype(np.uint8)


def _lamps(sun: np.ndarray, samples: int, options: ShadeOptions) -> list[tuple[np.ndarray, np.ndarray]]:
    """Directions (k, 3) and strengths (k,) of the light of each of a pixel's samples.

    All pixels share them, so that the picture has no noise; the samples differ, so that a pixel sees many.
    """
    turn = np.pi * (3 - np.sqrt(5))  # golden angle: points spread evenly over a disc or a half sphere
    i = np.arange(options.sky_lamps * samples) + 0.5
    z = np.sqrt(1 - i / len(i))  # fewer near the horizon, so that no single one casts a visible shadow on the floor
    sky = np.stack([np.sqrt(1 - z * z) * np.cos(turn * i), np.sqrt(1 - z * z) * np.sin(turn * i), z], 1)
    i = np.arange(options.sun_lamps * samples) + 0.5
    radius = options.sun_radius * np.sqrt(i / len(i))
    side = _unit(np.cross(sun, (0, 0, 1)))
    disc = np.stack([radius * np.cos(turn * i), radius * np.sin(turn * i)], 1) @ np.stack([side, np.cross(side, sun)])
    # The sky alone gives a level surface in the open SKY, the sun SUN times the cosine.
    directions = np.concatenate([sky, _unit(sun + disc)])
    strengths = np.concatenate([SKY * (0.5 + z) / z / (0.5 + z).sum(), np.full(len(i), SUN / len(i))])
    order = np.concatenate([np.arange(len(sky)) % samples, np.arange(len(i)) % samples])
    return [(directions[order == k], samples * strengths[order == k]) for k in range(samples)]


def _shade(
    tracer: _Tracer,
    eye: np.ndarray,
    directions: np.ndarray,
    level: float,
    lamp: tuple[np.ndarray, np.ndarray],
    turn: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What m rays from `eye` see: 1 on the object (m,); its colour in the light (m, 3); the floor's light (m,), else 0.

    The floor at z = level has light 1 in the open, and its shadows dissolve outwards; it is 0 where `turn` (m,) is not.
    """
    distance, normals, colours = tracer.cast(eye, directions)
    solid = np.isfinite(distance)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_floor = (level - eye[2]) / directions[:, 2]
        from_middle = np.hypot(*(eye[:2] + to_floor[:, None] * directions[:, :2]).T)
    lit = np.flatnonzero(solid | (turn & (to_floor > 0) & (from_middle < FLOOR_RADIUS)))
    on_object, directions = solid[lit], directions[lit]
    normals = np.where(on_object[:, None], normals[lit], (0, 0, 1))
    normals = np.where((normals * directions).sum(1, keepdims=True) > 0, -normals, normals)
    points = eye + np.where(on_object, distance[lit], to_floor[lit])[:, None] * directions + 1e-3 * normals

    seen = np.zeros(len(points))
    for direction, strength in zip(*lamp, strict=True):
        cosine = normals @ direction
        facing = np.flatnonzero(cosine > 0)
        seen[facing] += strength * cosine[facing] * tracer.free(points[facing], direction)
    in_the_open = float(lamp[0][:, 2] @ lamp[1])
    shadow = (1 - seen / in_the_open) * np.clip(2 - 2 * from_middle[lit] / FLOOR_RADIUS, 0, 1)
    light, floor = np.zeros(len(solid)), np.where(solid | ~turn, 0.0, 1.0)
    light[lit] = np.where(on_object, seen + BOUNCE * (1 - normals[:, 2]) / 2, 0)
    floor[lit] -= np.where(on_object, 0, shadow)
    return solid.astype(float), light[:, None] * colours, floor


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)
