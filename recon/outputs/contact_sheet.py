"""Every photo with the outline of its mask and of the result over it, on one sheet with pictures of the result."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from procmodels.shape import Shape
from recon.geometry.raster import silhouettes
from recon.outputs.result import Result
from recon.scene import InputError, cam_from_canonical
from recon.system.names import shown

MASK_COLOUR, RESULT_COLOUR = (40, 200, 255), (255, 96, 20)  # RGB
FINE = 2  # pictures are drawn this much larger, then reduced: smooth thin lines
SPACE = 1.35  # a photo is shown round the object, this many times as large
COLUMNS = 6
MARGIN, GAP, CAPTION = 36, 14, 26  # pixels
PAPER, INK, FAINT = (250, 249, 246), (38, 36, 33), (130, 126, 120)  # RGB
GOOD, FAIR = 0.85, 0.7  # outline agreement (IoU)


@dataclass(frozen=True)
class Tile:
    """One photo. image (H, W, 3) uint8 RGB with outlines; iou and used are None and False for a photo not placed."""

    name: str
    image: np.ndarray
    iou: float | None
    used: bool
    note: str = ""


def tiles(result: Result, shape: Shape, width: int) -> list[Tile]:
    """All photos in their order, `width` pixels wide, those without a camera in grey and without outlines."""
    cameras = result.scene.cameras
    placed = {name: i for i, name in enumerate(cameras.names)}
    poses = cam_from_canonical(cameras, result.scene.canonical)
    reasons = dict(result.scene.silhouettes.reasons)
    out = []
    for name, path in zip(result.frames.names, result.frames.paths, strict=True):
        if name not in placed:
            image = _read(path)
            small = _resized(image, width, round(width * image.shape[0] / image.shape[1]))
            out.append(Tile(shown(name), cv2.cvtColor(_muted(small), cv2.COLOR_GRAY2RGB), None, False, "not placed"))
            continue
        i = placed[name]
        image, mask = _read(result.scene.poses.paths[i]), result.scene.silhouettes.masks[i]
        used = bool(result.scene.silhouettes.used[i])
        note = "" if used else shown(reasons.get(name, "not used"))
        picture = _overlay(image, mask, shape, cameras.K[i], poses[i], width)
        out.append(Tile(shown(name), picture, result.view_iou[i], used, note))
    return out


def _overlay(
    image: np.ndarray, mask: np.ndarray, shape: Shape, K: np.ndarray, cam_from_canonical: np.ndarray, width: int
) -> np.ndarray:
    """The part of a photo round the object, `width` pixels wide, both outlines on it and the rest muted."""
    full = silhouettes(shape, K[None], cam_from_canonical[None], np.array([image.shape[1::-1]]))[0]
    x, y, w, h = _window(mask | full)
    size = FINE * width, FINE * max(1, round(width * h / w))
    K = np.diag([size[0] / w, size[1] / h, 1]) @ np.array([(1, 0, -x), (0, 1, -y), (0, 0, 1)]) @ K
    picture = _resized(image[y : y + h, x : x + w], *size)
    found = cv2.resize(mask[y : y + h, x : x + w].astype(np.float32), size, interpolation=cv2.INTER_LINEAR) > 0.5
    drawn = silhouettes(shape, K[None], cam_from_canonical[None], np.array([size]))[0]
    # Whole pictures and a copy through a mask: a third of the time of changing the masked pixels alone.
    cv2.copyTo(picture // 4 + (_muted(picture) // 4 * 3)[..., None], _stencil(~(found | drawn)), picture)
    for wrong, colour in ((found & ~drawn, MASK_COLOUR), (drawn & ~found, RESULT_COLOUR)):
        tint = np.full_like(picture, colour)
        cv2.copyTo(cv2.addWeighted(picture, 0.55, tint, 0.45, 0), _stencil(wrong), picture)
    for outlined, colour in ((found, MASK_COLOUR), (drawn, RESULT_COLOUR)):
        contours, _ = cv2.findContours(outlined.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.polylines(picture, list(contours), True, colour, FINE, cv2.LINE_AA)
    return cv2.resize(picture, None, fx=1 / FINE, fy=1 / FINE, interpolation=cv2.INTER_AREA)


def _stencil(mask: np.ndarray) -> np.ndarray:
    """(H, W) uint8 as OpenCV wants it."""
    return mask.astype(np.uint8)


def _muted(image: np.ndarray) -> np.ndarray:
    """(H, W) uint8: grey, light and of little contrast."""
    return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) // 2 + 100


def _window(object_mask: np.ndarray) -> tuple[int, int, int, int]:
    """The part of a photo that is shown, (x, y, width, height): round the object, in the photo's own proportions."""
    height, width = object_mask.shape
    rows, columns = np.flatnonzero(object_mask.any(1)), np.flatnonzero(object_mask.any(0))
    if not len(rows):
        return 0, 0, width, height
    share = SPACE * max(float(np.ptp(rows) + 1) / height, float(np.ptp(columns) + 1) / width)
    w, h = (max(1, round(min(share, 1) * side)) for side in (width, height))
    x = int(np.clip(round((columns[0] + columns[-1] - w) / 2), 0, width - w))
    y = int(np.clip(round((rows[0] + rows[-1] - h) / 2), 0, height - h))
    return x, y, w, h


def draw(tiles: list[Tile], renders: list[np.ndarray], title: str, sentence: str) -> np.ndarray:
    """The sheet (H, W, 3) uint8 RGB: title, pictures of the result, then all photos."""
    cell = 264
    ratio = float(np.median([t.image.shape[0] / t.image.shape[1] for t in tiles])) if tiles else 0.75
    cell_height = round(cell * min(max(ratio, 0.6), 1.4))
    width = 2 * MARGIN + COLUMNS * cell + (COLUMNS - 1) * GAP
    side = (width - 2 * MARGIN - (len(renders) - 1) * GAP) // max(len(renders), 3)
    lines = _wrapped(sentence, _font(22), width - 2 * MARGIN)
    head = MARGIN + 56 + 30 * len(lines) + 20
    rows = -(-len(tiles) // COLUMNS)
    height = head + side + 64 + rows * (cell_height + CAPTION + GAP) + MARGIN
    sheet = Image.new("RGB", (width, height), PAPER)
    pen = ImageDraw.Draw(sheet)
    pen.text((MARGIN, MARGIN), title, INK, _font(38))
    for i, line in enumerate(lines):
        pen.text((MARGIN, MARGIN + 56 + 30 * i), line, INK, _font(22))
    for i, render in enumerate(renders):
        sheet.paste(Image.fromarray(render).resize((side, side), Image.Resampling.LANCZOS), _at(i, side, head))
    if any(tile.iou is not None for tile in tiles):
        _legend(pen, head + side + 22)
    for i, tile in enumerate(tiles):
        x, y = _at(i % COLUMNS, cell, head + side + 64 + i // COLUMNS * (cell_height + CAPTION + GAP))
        _paste_tile(sheet, pen, tile, (x, y, cell, cell_height))
    return np.asarray(sheet)


def _paste_tile(sheet: Image.Image, pen: ImageDraw.ImageDraw, tile: Tile, box: tuple[int, int, int, int]) -> None:
    """A photo fitted into the box (x, y, width, height), its name and agreement below."""
    x, y, width, height = box
    pen.rectangle((x, y, x + width - 1, y + height - 1), (236, 233, 227))
    picture = Image.fromarray(tile.image)
    picture.thumbnail((width, height), Image.Resampling.LANCZOS)
    sheet.paste(picture, (x + (width - picture.width) // 2, y + (height - picture.height) // 2))
    if not tile.used:
        pen.rectangle((x, y, x + width - 1, y + height - 1), outline=(200, 60, 50), width=3)
    right = f"{tile.iou:.2f}" if tile.iou is not None else ""
    right = right if tile.used else f"{right}  not used" if tile.iou is not None else tile.note
    taken = pen.textlength(right, _font(16))
    pen.text((x + width - taken, y + height + 4), right, colour_of(tile), _font(16))
    pen.text((x, y + height + 4), _shortened(tile.name, width - taken - 12), INK, _font(16))


def colour_of(tile: Tile) -> tuple[int, int, int]:
    """Green, amber or red by agreement; red for photos not used."""
    if not tile.used or tile.iou is None or tile.iou < FAIR:
        return (190, 50, 40)
    return (38, 130, 70) if tile.iou >= GOOD else (176, 120, 10)


def _legend(pen: ImageDraw.ImageDraw, y: int) -> None:
    x = MARGIN
    for colour, text in ((MASK_COLOUR, "outline found in the photo"), (RESULT_COLOUR, "outline of the result")):
        pen.rectangle((x, y + 8, x + 28, y + 12), colour)
        pen.text((x + 38, y), text, INK, _font(18))
        x += 38 + round(pen.textlength(text, _font(18))) + 32
    pen.text((x, y), "number: how well they agree (intersection over union, 1 = perfectly)", FAINT, _font(18))


def _read(path: Path) -> np.ndarray:
    """The picture in RGB. Raises InputError when it is gone."""
    image = cv2.imread(str(path))
    if image is None:
        raise InputError(f"{path} is missing or damaged; run again with --force")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def _resized(image: np.ndarray, width: int, height: int) -> np.ndarray:
    smaller = width < image.shape[1]
    return cv2.resize(image, (width, max(1, height)), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC)


def _at(column: int, side: int, y: int) -> tuple[int, int]:
    return MARGIN + column * (side + GAP), y


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)  # comes with Pillow: no font of the system is needed


def _shortened(text: str, width: float) -> str:
    """The text, its middle left out when it is wider than `width` pixels."""
    font = _font(16)
    if font.getlength(text) <= width:
        return text
    keep = len(text) - 1
    while keep > 2 and font.getlength(_elided(text, keep)) > width:
        keep -= 1
    return _elided(text, keep)


def _elided(text: str, keep: int) -> str:
    return text[: keep // 2] + "..." + text[len(text) - (keep + 1) // 2 :]


def _wrapped(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: int) -> list[str]:
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if font.getlength(longer) <= width or not lines[-1]:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
