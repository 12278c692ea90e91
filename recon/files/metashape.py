"""Cameras that Agisoft Metashape exports as XML.

<transform> is chunk_from_camera, row by row, OpenCV axes. cx and cy count from the picture's middle, b1 adds to the
focal length along x. Metashape's p1 and p2 are OpenCV's p2 and p1 (appendix D of its manual). What has no counterpart
in COLMAP's models (b2, k4 of ordinary lenses, tangential terms of fisheye ones) must be undistorted first.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from recon.files.camera_records import CameraRecords, from_rows, rigid
from recon.geometry.lenses import lens
from recon.scene import InputError, Lens
from recon.system.user_files import read_bytes

_SMALL = 1.0  # px that may be left out


def matches(path: Path) -> bool:
    """Whether a file is XML that begins as Metashape's does, with cameras."""
    if path.suffix.lower() != ".xml" or not path.is_file():
        return False
    try:
        return any(True for _ in _document(path).iter("camera"))
    except InputError:
        return False


def _document(path: Path) -> ElementTree.Element:
    """The root, without definitions of entities: those of a foreign file could grow beyond all memory."""
    data = read_bytes(path)
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise InputError(f"{path} defines its own XML entities, which Metashape's files do not")
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise InputError(f"{path} is damaged XML ({error})") from error
    if root.tag != "document" or root.find("chunk") is None:
        raise InputError(f"{path} is no XML of Metashape's: a document with a chunk is wanted")
    return root


def read(path: Path) -> CameraRecords:
    """The placed cameras of the chunk's largest component. Raises InputError naming the file and the camera."""
    try:
        return _records(path, _document(path))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"{path} is damaged ({type(error).__name__}: {error})") from error


def _records(path: Path, root: ElementTree.Element) -> CameraRecords:
    sensors = {s.get("id"): s for s in root.iter("sensor")}
    placed = [c for c in root.iter("camera") if c.find("transform") is not None]
    if not placed:
        raise InputError(f"{path} holds no placed camera: align the photos in Metashape before the export")
    # Each component has a frame of its own.
    largest = Counter(c.get("component_id") for c in placed).most_common(1)[0][0]
    rows = []
    for camera in (c for c in placed if c.get("component_id") == largest):
        what = f"{path}, camera {camera.get('label')}"
        size, K, bends = _lens(sensors[camera.get("sensor_id")], what)
        matrix = np.array((camera.findtext("transform") or "").split(), float).reshape(4, 4)
        rows.append((str(camera.get("label")), size, K, bends, np.linalg.inv(rigid(matrix, what))))
    return from_rows(rows)


def _lens(sensor: ElementTree.Element, what: str) -> tuple[tuple[int, int], np.ndarray, Lens | None]:
    """Size, K and lens of a sensor, by its adjusted calibration."""
    found = sensor.findall("calibration")
    if not found:
        raise InputError(f"{what}: its sensor has no calibration; align the photos in Metashape before the export")
    calibration = next((c for c in found if c.get("class") == "adjusted"), found[0])
    resolution = calibration.find("resolution")
    if resolution is None:
        resolution = sensor.find("resolution")
    assert resolution is not None  # AttributeError would say the same, less clearly
    size = (int(resolution.attrib["width"]), int(resolution.attrib["height"]))
    names = ("cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2", "b1", "b2")
    cx, cy, k1, k2, k3, k4, p1, p2, b1, b2 = (float(calibration.findtext(n) or 0) for n in names)
    f = float(calibration.findtext("f") or 0)
    pinhole = [f + b1, f, size[0] / 2 + cx, size[1] / 2 + cy]
    kind = calibration.get("type", sensor.get("type", "frame"))
    half = np.hypot(*size) / 2
    if kind == "frame":
        model, terms = "FULL_OPENCV", [k1, k2, p2, p1, k3, 0, 0, 0]
        lost = max(abs(k4) * f * (half / f) ** 9 if f else 0, abs(b2) * half / f if f else 0)
    elif kind == "fisheye":
        model, terms = "OPENCV_FISHEYE", [k1, k2, k3, k4]
        lost = max(abs(b2), (abs(p1) + abs(p2)) * 3 * f)
    else:
        model, terms, lost = "EQUIRECTANGULAR", [], 0.0
    if lost > _SMALL:
        raise InputError(
            f"{what}: its lens has terms that only Metashape knows (k4, b2, p1, p2); export undistorted photos"
        )
    try:
        return size, *lens(model, np.array([*pinhole, *terms]), size)
    except InputError as error:
        raise InputError(f"{what}: {error}") from error
