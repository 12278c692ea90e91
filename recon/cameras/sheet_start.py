"""A first model for structure from motion from photos of a sheet alone; the other photos are then placed by it.

In the child process of recon.cameras.poses. The usual start, two photos with many matches, is where things that look
alike mislead; here the cameras stand before any match is believed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

LEAST = 3  # photos of one sheet


def model(pycolmap: Any, database: Path, order: dict[str, Any], options: Any, out: Path) -> bool:
    """Write a model of the photos that show sheets into the folder `out`; False when there are too few.

    options  of the mapping that goes on from it
    """
    poses = linked(order["sheet_poses"])
    if len(poses) < LEAST:
        return False
    out.mkdir(exist_ok=True)
    focals = {} if order["rung"]["keep_focal"] else {name: K[0] for name, K in order["sheet_K"].items()}
    known = _with_cameras(pycolmap, database, poses, focals)
    known = pycolmap.triangulate_points(known, database, order["image_dir"], out, options=options)
    if known.num_points3D() < LEAST:
        return False
    adjust = pycolmap.BundleAdjustmentOptions()
    adjust.refine_focal_length = options.ba_refine_focal_length
    adjust.print_summary = False
    pycolmap.bundle_adjustment(known, adjust)
    known.write(out)
    return True


def linked(poses: dict[str, dict[str, list[float]]]) -> dict[str, np.ndarray]:
    """cam_from_world (4, 4) by photo, where the world is the sheet that most photos show.

    poses  cam_from_sheet by photo and board. Photos of other sheets follow where some photo shows both.
    """
    every = {name: {b: np.reshape(m, (4, 4)) for b, m in boards.items()} for name, boards in poses.items()}
    counts: dict[str, int] = {}
    for boards in every.values():
        for board in boards:
            counts[board] = counts.get(board, 0) + 1
    if not counts:
        return {}
    main = max(counts, key=lambda b: (counts[b], b))
    main_from: dict[str, np.ndarray] = {main: np.eye(4)}
    for _ in counts:  # each round reaches sheets one photo further on
        for boards in every.values():
            for via in [b for b in boards if b in main_from]:
                for board in boards.keys() - main_from.keys():
                    main_from[board] = main_from[via] @ np.linalg.inv(boards[via]) @ boards[board]
    out = {}
    for name, boards in every.items():
        near = [b for b in (main, *sorted(boards)) if b in boards and b in main_from]
        if near:
            out[name] = boards[near[0]] @ np.linalg.inv(main_from[near[0]])
    return out


def _with_cameras(pycolmap: Any, database: Path, poses: dict[str, np.ndarray], focals: dict[str, float]) -> Any:
    """A reconstruction of the database's cameras and images, those of `poses` in their places, without points.

    focals  px by photo, in place of those in the database
    """
    opened = pycolmap.Database.open(str(database))
    out = pycolmap.Reconstruction()
    every = opened.read_all_images()
    told = {image.camera_id: focals[image.name] for image in every if focals.get(image.name, np.nan) > 0}
    for camera in opened.read_all_cameras():
        if camera.camera_id in told:
            camera.focal_length = told[camera.camera_id]
        out.add_camera(camera)
    for rig in opened.read_all_rigs():
        out.add_rig(rig)
    images = {image.frame_id: image for image in every if image.name in poses}
    for frame in opened.read_all_frames():
        if frame.frame_id in images:
            matrix = poses[images[frame.frame_id].name][:3]
            frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(matrix[:, :3]), matrix[:, 3])
            out.add_frame(frame)
            out.add_image(images[frame.frame_id])
            out.register_frame(frame.frame_id)
    opened.close()
    return out
