"""What a photo set is made of, decided before rendering: options, the object's place, cameras, focus, exposure.

Canonical frame: X right, object faces -Y, Z up, bounding box centred, longest side 1.
World frame: metres, Z up, the object stands on z = 0. Cameras: OpenCV axes, pixel centres at +0.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from datasets import camera_rings
from datasets.axis_rotations import AXES, turn
from procmodels.studio import render
from procmodels.studio.room import Paper

Y_UP = (".obj", ".glb", ".gltf")  # formats whose files are usually Y-up; the others are taken as Z-up
FLOORS = ("patterned", "plain")
_RANGES = {"views": (2, 1000), "width": (16, 8192), "height": (16, 8192), "samples": (1, 4096), "quality": (1, 100)}


class PhotosetError(ValueError):
    """The mesh, an option or a photo set on disk is not usable; the message says why and what to do."""


@dataclass(frozen=True)
class PhotosetOptions:
    views: int = 28  # photos, half of them on each of two rings
    width: int = 800  # pixels
    height: int = 600  # pixels
    samples: int = 16  # light paths a pixel, before denoising
    seed: int = 0  # cameras, pictures on floor and walls, light, exposure, focus, paint of bare meshes
    up: str = "auto"  # the file's up axis: x y z with sign; auto = y for OBJ and glTF, z otherwise
    front: str = "auto"  # the file's axis that the object faces; auto = +z when y is up, -y otherwise
    object_height: float = 0.9  # metres
    lens_mm: float = 32.0  # focal length on a 36 mm wide sensor: focal in pixels = lens_mm / 36 * width
    quality: int = 88  # JPEG
    arc: float = 360.0  # degrees of each ring that the cameras keep to, about the object's front; 360 = all round
    floor: str = "patterned"  # or "plain": one colour, nothing for structure from motion to hold on to
    rug: bool = False  # a patterned rug, 1 cm thick, under the object; the object stands on z = 0, the floor is lower
    papers: tuple[Paper, ...] = ()  # printed pages on the floor; their places are of the world, about the object
    wall: float = 0.0  # metres from the object's back to a wall right behind it, with arc <= 180; 0 = none
    threads: int = 0  # render threads, 0 = all cores
    rotation: tuple[float, ...] = (1, 0, 0, 0, 1, 0, 0, 0, 1)  # row by row, applied first, in the file's axes
    source: str = ""  # where the mesh comes from; recorded only
    licence: str = ""  # of the mesh; recorded only

    def __post_init__(self) -> None:
        for name, (low, high) in _RANGES.items():
            if not low <= getattr(self, name) <= high:
                raise PhotosetError(f"{name} must be {low} to {high}, got {getattr(self, name)}")
        for name in ("up", "front"):
            if getattr(self, name) not in ("auto", *AXES):
                raise PhotosetError(f"{name} must be an axis such as z or -y, got {getattr(self, name)!r}")
        for name in ("object_height", "lens_mm"):
            if not 0 < getattr(self, name) < 1e4:
                raise PhotosetError(f"{name} must be above 0, got {getattr(self, name)}")
        if not 0 < self.arc <= 360:
            raise PhotosetError(f"arc must be above 0 and at most 360 degrees, got {self.arc}")
        if self.floor not in FLOORS:
            raise PhotosetError(f"floor must be one of {', '.join(FLOORS)}, got {self.floor!r}")
        if self.wall < 0 or (self.wall > 0 and self.arc > 180):
            raise PhotosetError(f"wall must be 0 or more metres and needs arc <= 180, got {self.wall} and {self.arc}")
        if self.seed < 0:
            raise PhotosetError(f"seed must be 0 or more, got {self.seed}")

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return self.lens_mm / render.SENSOR_MM * self.width


@dataclass(frozen=True)
class Plan:
    """Everything that the seed decides; the same seed gives the same plan, so an interrupted run can go on.

    vertices              (n, 3) float, the object in the canonical frame
    faces                 (m, 3) int, triangles
    canonical_from_file   (4, 4) float, a similarity
    names                 V file names of the photos
    K                     (3, 3) float, pixels, shared by all
    cam_from_world        (V, 4, 4) float, rigid
    world_from_canonical  (4, 4) float, a similarity; scale = metres of the object's longest side
    shots                 V, what the studio needs
    reach                 metres, the farthest camera's distance from the middle of the room, along the floor
    """

    vertices: np.ndarray
    faces: np.ndarray
    canonical_from_file: np.ndarray
    names: tuple[str, ...]
    K: np.ndarray
    cam_from_world: np.ndarray
    world_from_canonical: np.ndarray
    shots: tuple[render.Shot, ...]
    reach: float


def apply(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) under a (4, 4) transform."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def canonical_from_file(vertices: np.ndarray, suffix: str, options: PhotosetOptions) -> np.ndarray:
    """(4, 4) similarity that turns, centres and scales a mesh's vertices (n, 3) into the canonical frame.

    suffix  of the mesh file, such as ".obj"; tells the axes where the options leave them to it
    """
    up = options.up if options.up != "auto" else ("y" if suffix.lower() in Y_UP else "z")
    front = options.front if options.front != "auto" else ("z" if up[-1] == "y" else "-y")
    try:
        rotation = turn(up, front) @ np.array(options.rotation, float).reshape(3, 3)
    except ValueError as error:
        raise PhotosetError(f"{error}: give both --up and --front") from error
    turned = vertices @ rotation.T
    low, high = turned.min(0), turned.max(0)
    longest = float((high - low).max())
    if not np.isfinite(longest) or (high - low)[2] <= 1e-6 * longest:
        raise PhotosetError("the mesh has no height or is not finite: there is nothing to stand on the floor")
    out = np.eye(4)
    out[:3, :3] = rotation / longest
    out[:3, 3] = -(low + high) / 2 / longest
    return out


def _stand(object_height: float, canonical_height: float, yaw: float) -> np.ndarray:
    """world_from_canonical (4, 4): in metres, on the floor, over the origin, turned by `yaw` (radians)."""
    scale = object_height / canonical_height
    out = np.diag([scale, scale, scale, 1.0])
    out[:2, :2] = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]) * scale
    out[2, 3] = object_height / 2
    return out


def plan(raw: np.ndarray, faces: np.ndarray, suffix: str, options: PhotosetOptions) -> Plan:
    """Place object and cameras; `raw` (n, 3) vertices in the file's axes, `suffix` of that file."""
    to_canonical = canonical_from_file(raw, suffix, options)
    vertices = apply(to_canonical, raw)
    rng = np.random.default_rng([options.seed, 1])
    # A random yaw: the world's axes must not give the object's away.
    yaw = rng.uniform(0, 2 * np.pi)
    place = _stand(options.object_height, float(np.ptp(vertices[:, 2])), yaw)
    K = camera_rings.intrinsics(options.width, options.height, options.focal)
    size = (options.width, options.height)
    orbit = camera_rings.Orbit(arc=options.arc, towards=float(np.degrees(yaw)) - 90)
    poses = camera_rings.plan(apply(place, vertices), options.views, K, size, orbit, rng)
    places = np.linalg.inv(poses)
    shots = []
    for i, world_from_cam in enumerate(places):
        distance = float(np.linalg.norm(world_from_cam[:3, 3] - place[:3, 3]))
        exposure, focus, opening = rng.uniform(-0.2, 0.2), rng.uniform(0.92, 1.08), rng.uniform(0.0005, 0.0015)
        noise = 1000 * options.seed + i
        shots.append(render.Shot(world_from_cam, exposure, distance * focus, distance * opening, noise))
    names = tuple(f"photo_{i:03d}.jpg" for i in range(options.views))
    reach = float(np.linalg.norm(places[:, :2, 3], axis=1).max())
    return Plan(vertices, faces, to_canonical, names, K, poses, place, tuple(shots), reach)
