"""Masks without help: votes of the room behind the object, a hull carved from them, and the photos' own edges.

1. Every photo is compared with its neighbours through the planes of the room: what agrees is room (`backdrop.agree`).
2. Cells over the floor add up these votes; what remains is a hull, and shows which colours the object has. A vote for
   the room counts little where the room has a colour of the object: a white chair agrees with a white wall.
3. At full size the comparison is repeated, now only with photos that do not see the hull there, and a second hull is
   carved. Votes, hull and the colours round the object give every pixel log-odds (`odds`); a guided filter moves their
   edges to those of the photo, and GrabCut decides the few pixels that are still open.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from recon.geometry import voxel_carving
from recon.geometry.room_planes import Room
from recon.geometry.voxel_carving import Cells
from recon.masks import foreground_odds as odds
from recon.masks import photo_consistency
from recon.scene import Cameras, ReconstructionError
from recon.system import progress

Each = Callable[[str, Callable[[int], Any]], list[Any]]  # (what is done, for one view) -> results of all views


@dataclass(frozen=True)
class CutoutOptions:
    small: int = 400  # px, longest side of the pictures that the first hull is carved from
    near: int = 14  # neighbours that vote on a view in the first round
    many: int = 24  # in the second round, at full size
    tolerance: int = 12  # 0..255, by how much a channel of one place may differ between photos
    coarse: int = 96  # cells along the longest side of the whole region
    fine: int = 160  # cells along the longest side of the object's box
    lenient: float = -6.0  # log-odds a cell must have to count for the object's box
    solid: float = 3.0  # log-odds a cell must have to belong to the second hull; the first takes 0
    odds: odds.OddsOptions = field(default_factory=odds.OddsOptions)


def cut_out(
    images: list[np.ndarray],
    cameras: Cameras,
    room: Room,
    given: dict[int, np.ndarray],
    options: CutoutOptions = CutoutOptions(),
    seed: int = 0,
) -> list[np.ndarray]:
    """V masks (H, W) bool of the object that all cameras look at.

    images  V of (H, W, 3) uint8, undistorted, at the cameras' sizes
    given   masks (H, W) bool that are known already, by view; they help to carve and are returned as they are
    Raises ReconstructionError when nothing is left over the floor.
    """
    near = photo_consistency.neighbours(cameras, options.many)
    small_cameras = cameras.scaled(min(1.0, options.small / float(cameras.sizes.max())))
    small = [_resized(im, size) for im, size in zip(images, small_cameras.sizes, strict=True)]
    gains = photo_consistency.gains(small, small_cameras, room, [n[:8] for n in near])
    small, even = _multiplied(small, gains), _multiplied(images, gains)
    with ThreadPoolExecutor(2) as pool:  # cv2 and numpy release the interpreter lock

        def each(name: str, work: Callable[[int], Any]) -> list[Any]:
            todo = pool.map(work, range(len(cameras)))
            return list(
                tqdm(todo, f"masks: {name}", len(cameras), unit="photo", leave=False, disable=progress.hidden())
            )

        cells, solid, colours = _first_hull(small, small_cameras, room, near, given, options, each)
        hulls = each("first hull", voxel_carving.pictures(cells, solid, cameras))
        hidden = [cv2.dilate(given.get(v, h).astype(np.uint8), _disc(2)) for v, h in enumerate(hulls)]
        block = voxel_carving.pictures(cells, np.ones(cells.shape, bool), cameras)
        windows = [odds.crop(block(v), 0) for v in range(len(cameras))]

        loud = [photo_consistency.speaking(image, h) for image, h in zip(even, hidden, strict=True)]

        def pixels(v: int) -> tuple[np.ndarray, np.ndarray]:
            found = photo_consistency.agree(loud, cameras, room, v, near[v], options.tolerance, windows[v])
            return _pixel_odds(even[v][windows[v]], found, hulls[v][windows[v]], colours, options.odds)

        both = each("votes", pixels)
        for_cells = [_pasted(b[1], hulls[v].shape, windows[v]) for v, b in enumerate(both)]
        second = _solid(cells, cameras, _with_given(for_cells, given), np.array(cells.shape) / 2, options.solid)
        final = voxel_carving.pictures(cells, second, cameras)

        def mask(v: int) -> np.ndarray:
            if v in given:
                return given[v]
            hull = final(v)
            picture = images[v][windows[v]]
            total = odds.smooth(picture, both[v][0], hull[windows[v]], options.odds)
            found = odds.decide(picture, total, options.odds, seed)
            return odds.without_speckles(_pasted(found, hull.shape, windows[v], False), hull)

        return each("edges", mask)


def _first_hull(
    images: list[np.ndarray],
    cameras: Cameras,
    room: Room,
    near: list[np.ndarray],
    given: dict[int, np.ndarray],
    options: CutoutOptions,
    each: Each,
) -> tuple[Cells, np.ndarray, odds.Colours]:
    """The cells round the object, which of them are solid, and the object's colours, from small pictures."""
    loud = [photo_consistency.speaking(image) for image in images]
    found = each(
        "floor",
        lambda v: photo_consistency.agree(loud, cameras, room, v, near[v][: options.near], options.tolerance),
    )
    small = {v: _resized(m.astype(np.float32), cameras.sizes[v]) > 0.5 for v, m in given.items()}

    def votes(colours: odds.Colours | None) -> list[np.ndarray]:
        like = [colours.share(im) if colours else 0.0 for im in images]
        first, blocked = options.odds.quorum[0], options.odds.blocked
        cast = [odds.votes(a, h, first, blocked, options.odds) for a, h in zip(found, like, strict=True)]
        return _with_given(cast, small)

    def colours_in(cells: Cells, solid: np.ndarray) -> odds.Colours:
        draw = voxel_carving.pictures(cells, solid, cameras)
        inside = [draw(v).astype(np.uint8) for v in range(len(cameras))]
        return odds.Colours(images, [cv2.erode(m, _disc(1)) > 0 for m in inside])

    whole = voxel_carving.region(room.axes, room.focus, room.distance, cameras, options.coarse)
    middle = np.array(whole.shape) * (0.5, 0.5, 0.25)
    colours = colours_in(whole, _solid(whole, cameras, votes(None), middle, options.lenient))
    cast = votes(colours)
    box = _solid(whole, cameras, cast, middle, options.lenient)
    # The object stands on the floor, even if its feet are not found yet.
    cells = voxel_carving.around(whole, box, options.fine, floor=True)
    solid = _to_the_floor(_solid(cells, cameras, cast, np.array(cells.shape) / 2, 0.0))
    return cells, solid, colours_in(cells, solid)


def _with_given(votes: list[np.ndarray], given: dict[int, np.ndarray]) -> list[np.ndarray]:
    """The votes, with given masks in their place: outside is surely free, inside may be in front or behind."""
    return [np.where(given[v], 1.0, -6.0).astype(np.float32) if v in given else x for v, x in enumerate(votes)]


def _solid(cells: Cells, cameras: Cameras, votes: list[np.ndarray], middle: np.ndarray, least: float) -> np.ndarray:
    """(*shape) bool: the main connected part of the cells that most cameras see and whose votes sum to over `least`."""
    total, seen = voxel_carving.add_up(cells, cameras, votes)
    solid = (total > least) & (seen >= voxel_carving.MOST * len(cameras))
    if not solid.any():
        raise ReconstructionError(
            "no object found: every place over the floor looks like floor or wall in some photo. Give masks "
            "(--masks, white = object), or photograph the object on a textured floor in another colour than its own."
        )
    return voxel_carving.main_part(solid, middle)


def _to_the_floor(solid: np.ndarray) -> np.ndarray:
    """The cells, with what stands within 4 % of the height continued straight down.

    A foot that touches the floor has no parallax against it: it agrees with the floor until somebody knows
    that it is there.
    """
    layer = int(np.ceil(0.04 * (np.flatnonzero(solid.any((0, 1)))[-1] + 1)))
    out = solid.copy()
    out[:, :, :layer] |= solid[:, :, layer : layer + 1]
    return out


def _pixel_odds(
    image: np.ndarray,
    found: photo_consistency.Agreement,
    hull: np.ndarray,
    colours: odds.Colours,
    options: odds.OddsOptions,
) -> tuple[np.ndarray, np.ndarray]:
    """(h, w) float32 log-odds for a window's pixels and, as the object may be behind or before them, for cells."""
    like, judged = colours.share(image), found.count >= 2
    own = np.clip(odds.votes(found, like, options.quorum[1], 0.0, options), -3, 3)
    outside = (cv2.dilate(hull.astype(np.uint8), _disc(6)) == 0) & (own <= 0)
    plain = odds.backdrop_odds(image, outside, like, options)
    cells = odds.votes(found, like, options.quorum[1], options.blocked, options)
    return np.where(judged, own, plain), np.where(judged, cells, 0.2 * plain)


def _pasted(
    part: np.ndarray, shape: tuple[int, ...], window: photo_consistency.Window, rest: float | bool = -3.0
) -> np.ndarray:
    out = np.full(shape, rest, part.dtype)
    out[window] = part
    return out


def _disc(radius: int) -> np.ndarray:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))


def _resized(image: np.ndarray, size: np.ndarray) -> np.ndarray:
    return cv2.resize(image, (int(size[0]), int(size[1])), interpolation=cv2.INTER_AREA)


def _multiplied(images: list[np.ndarray], gains: np.ndarray) -> list[np.ndarray]:
    both = zip(images, gains.astype(np.float32), strict=True)
    return [np.clip(im * g + 0.5, 0, 255).astype(np.uint8) for im, g in both]
