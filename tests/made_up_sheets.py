"""Photos of printed sheets whose places are known exactly: planes seen by a pinhole camera."""

import cv2
import numpy as np

from recon.sheet.drawing import MM_PER_INCH, board_picture, page, place

PER_MM, MARGIN = 4.0, 12.0  # of the pictures that are laid out


def look_at(eye, target=(0, 0, 0), roll=0.0):
    """cam_from_world (4, 4), z up in the world."""
    z = np.asarray(target, float) - eye
    z /= np.linalg.norm(z)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    c, s = np.cos(roll), np.sin(roll)
    out = np.eye(4)
    out[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.stack([x, np.cross(z, x), z])
    out[:3, 3] = -out[:3, :3] @ eye
    return out


def lying(x=0.0, y=0.0, degrees=0.0, size=1.0):
    """(4, 4) world_from_sheet on the plane z = 0; `size` 0.97 is a sheet printed too small."""
    c, s = size * np.cos(np.radians(degrees)), size * np.sin(np.radians(degrees))
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, size, 0], [0, 0, 0, 1.0]])


def pixels(K, cam_from_world, world_from_sheet, board, points):
    """(n, 2) where points (n, 2) mm of the board are seen, pixel centres at +0.5."""
    local = (cam_from_world @ world_from_sheet @ np.column_stack([board.in_metres(points), np.ones(len(points))]).T)[:3]
    seen = K @ local
    return (seen[:2] / seen[2]).T


def lay(picture, K, cam_from_world, world_from_sheet, board, light=(20, 225), fine=4, whole=None):
    """Lay a board into a grey picture (H, W) uint8; `light` the grey of ink and paper. Edges are averaged.

    whole  the Paper, for its whole page instead of the board with MARGIN of white
    """
    height, width = picture.shape
    drawn, left, top = board_picture(board, PER_MM, MARGIN), MARGIN, MARGIN
    if whole is not None:
        drawn = page(whole, 1 + whole.numbers.index(board.number), PER_MM * MM_PER_INCH)
        left, top = place(whole)
    corners = np.array([(0, 0), (100, 0), (100, 100), (0, 100)], float)
    photo_from_mm = cv2.getPerspectiveTransform(
        corners.astype(np.float32), pixels(K, cam_from_world, world_from_sheet, board, corners).astype(np.float32)
    )
    half = 0.5 / PER_MM
    mm_from_drawn = np.array([[1 / PER_MM, 0, half - left], [0, 1 / PER_MM, half - top], [0, 0, 1]])
    fine_from_photo = np.array([[fine, 0, -0.5], [0, fine, -0.5], [0, 0, 1]])
    matrix = fine_from_photo @ photo_from_mm @ mm_from_drawn
    size = (width * fine, height * fine)
    paper = light[0] + (light[1] - light[0]) * (drawn.astype(np.float32) / 255)
    shown = cv2.warpPerspective(paper, matrix, size, flags=cv2.INTER_AREA)
    cover = cv2.warpPerspective(np.ones_like(paper), matrix, size)
    shown, cover = (cv2.resize(a, (width, height), interpolation=cv2.INTER_AREA) for a in (shown, cover))
    return np.clip(picture * (1 - cover) + shown + 0.5, 0, 255).astype(np.uint8)


def intrinsics(width, height, focal):
    return np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
