"""One small good input of every class; damage is done to them afterwards."""

from __future__ import annotations

import json
import struct
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh
from PIL import Image

from nnproc.rays import look_at_cameras
from procmodels import load
from recon.files import colmap_model, pix3d_camera
from recon.files.photo import pillow_heif
from recon.geometry.raster import silhouettes
from recon.outputs import camera_export
from recon.scene import Cameras, Poses
from tests.bad_inputs import more_shapes

CHAIR = {"width": 0.45, "depth": 0.5, "leg_height": 0.42, "legs": "support", "arms": "none", "back": "hbar"}
WIDTH, HEIGHT, VIEWS = 160, 120, 6
RUN, AXES, TABLE2 = "run_recon", "recon.evaluate.axes", "recon.evaluate"  # commands


@dataclass(frozen=True)
class Good:
    """A class of input: the words of its command, run in its folder, and the files there that may be damaged.

    text  whether they are text, whose numbers can be exchanged
    """

    name: str
    words: tuple[str, ...]
    targets: tuple[str, ...]
    text: bool = False
    command: str = RUN


@dataclass(frozen=True)
class Scene:
    """A chair before six cameras."""

    mesh: trimesh.Trimesh
    cameras: Cameras
    masks: list[np.ndarray]
    photos: list[np.ndarray]  # (H, W, 3) uint8 RGB


def scene() -> Scene:
    """Always the same: photos are coloured noise, the chair brighter than the rest."""
    shape = load("paper/chair").build(CHAIR)
    K, pose = (t.numpy() for t in look_at_cameras([0, 60, 120, 180, 240, 300], [20] * VIEWS, 2.3, 45, HEIGHT))
    K[:, 0, 2] = WIDTH / 2
    sizes = np.tile((WIDTH, HEIGHT), (VIEWS, 1))
    masks = silhouettes(shape, K, pose, sizes)
    noise = np.random.default_rng(1).integers(0, 120, (VIEWS, HEIGHT, WIDTH, 3))
    photos = [(n + 120 * m[..., None]).astype(np.uint8) for n, m in zip(noise, masks, strict=True)]
    cameras = Cameras(tuple(f"p{i}.png" for i in range(VIEWS)), K.astype(float), pose.astype(float), sizes)
    return Scene(shape.to_trimesh(), cameras, masks, photos)


def make_all(folder: Path) -> list[Good]:
    """Write every good input into a folder of its own below `folder`."""
    made = scene()
    goods = []
    makers = (_photos, _images, _known_cameras, _videos, _meshes, _clouds, _splats, _others_programs, _voxels, _others)
    for make in makers:
        for good in make(made, folder):
            goods.append(good)
    return goods


def _in(folder: Path, name: str) -> Path:
    out = folder / name
    out.mkdir(parents=True)
    return out


def _photos(made: Scene, folder: Path) -> Iterator[Good]:
    """Folders of photos without cameras, in every format."""
    assert pillow_heif.options, "HEIC is known"
    for ending in ("jpg", "png", "tif", "webp", "bmp", "heic", "avif"):
        own = _in(folder, f"photos-{ending}")
        for i, picture in enumerate(made.photos[:3]):
            path = own / "photos" / f"p{i}.{ending}"
            path.parent.mkdir(exist_ok=True)
            Image.fromarray(picture).save(path)
        yield Good(own.name, ("photos",), (f"photos/p0.{ending}", f"photos/p1.{ending}"))


def _images(made: Scene, folder: Path) -> Iterator[Good]:
    """One image with a mask, one mask, masks from unknown views, and a camera of Pix3D."""
    own = _in(folder, "image-and-mask")
    Image.fromarray(made.photos[0]).save(own / "a.jpg")
    _mask(made.masks[0], own / "m.png")
    yield Good(own.name, ("a.jpg", "--mask", "m.png"), ("a.jpg", "m.png"))
    own = _in(folder, "rgba-image")
    Image.fromarray(np.dstack([made.photos[0], made.masks[0] * 255]).astype(np.uint8)).save(own / "a.png")
    yield Good(own.name, ("a.png",), ("a.png",))
    own = _in(folder, "mask")
    _mask(made.masks[0], own / "m.png")
    yield Good(own.name, ("m.png",), ("m.png",))
    own = _in(folder, "mask-folder")
    for i in range(3):
        _mask(made.masks[i], own / "masks" / f"m{i}.png")
    yield Good(own.name, ("masks",), ("masks/m0.png", "masks/m1.png"))
    own = _in(folder, "pix3d")
    Image.fromarray(made.photos[0]).save(own / "0007.jpg")
    _mask(made.masks[0], own / "0007.png")
    (own / "pix3d.json").write_text(json.dumps([_record(made)]))
    yield Good(own.name, ("0007.jpg", "--mask", "0007.png", "--pix3d", "pix3d.json"), ("pix3d.json",), text=True)


def _mask(mask: np.ndarray, path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(mask.astype(np.uint8) * 255).save(path)


def _record(made: Scene) -> dict[str, object]:
    K, pose = made.cameras.K[0], made.cameras.cam_from_world[0]
    rotation = pix3d_camera.OPENCV_FROM_PIX3D.T @ pose[:3, :3] @ pix3d_camera.PIX3D_FROM_CANONICAL.T
    translation = pix3d_camera.OPENCV_FROM_PIX3D.T @ pose[:3, 3]
    return {
        "img": "img/chair/0007.jpg",
        "mask": "mask/chair/0007.png",
        "category": "chair",
        "img_size": [WIDTH, HEIGHT],
        "rot_mat": rotation.tolist(),
        "trans_mat": translation.tolist(),
        "focal_length": float(K[0, 0]) * 32 / WIDTH,
    }


def _known_cameras(made: Scene, folder: Path) -> Iterator[Good]:
    """transforms.json and COLMAP's models, text and binary, with masks."""
    for kind in ("transforms", "colmap-text", "colmap-binary"):
        own = _in(folder, kind)
        photos = _in(own, "photos")
        for name, photo, mask in zip(made.cameras.names, made.photos, made.masks, strict=True):
            Image.fromarray(photo).save(photos / name)
            _mask(mask, own / "masks" / name)
        paths = tuple(photos / n for n in made.cameras.names)
        points = np.random.default_rng(2).uniform(-0.5, 0.5, (200, 3))
        written = own / "written"
        camera_export.write(written, Poses(made.cameras, paths, points, np.zeros((200, VIEWS), bool)))
        words = ("photos", "--masks", "masks", "--cameras")
        if kind == "transforms":
            content = camera_export.transforms(made.cameras, [f"photos/{n}" for n in made.cameras.names], [""] * VIEWS)
            (own / "transforms.json").write_text(json.dumps(content))
            yield Good(own.name, (*words, "transforms.json"), ("transforms.json",), text=True)
            yield Good(own.name, (*words, "transforms.json"), ("masks/p0.png", "photos/p1.png"))
        elif kind == "colmap-text":
            files = tuple(f"written/sparse/0/{name}.txt" for name in ("cameras", "images", "points3D"))
            yield Good(own.name, (*words, "written"), files, text=True)
        else:
            _binary_model(own / "binary", made.cameras, points)
            files = ("binary/cameras.bin", "binary/images.bin", "binary/points3D.bin")
            yield Good(own.name, (*words, "binary"), files)


def _binary_model(folder: Path, cameras: Cameras, points: np.ndarray) -> None:
    """COLMAP's binary files, without tracks."""
    from scipy.spatial.transform import Rotation

    folder.mkdir()
    rows, images = b"", b""
    for i, (K, pose) in enumerate(zip(cameras.K, cameras.cam_from_world, strict=True)):
        rows += struct.pack("<iiQQ4d", i + 1, 1, WIDTH, HEIGHT, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
        images += struct.pack("<i7di", i + 1, w, x, y, z, *pose[:3, 3], i + 1)
        images += cameras.names[i].encode() + b"\0" + struct.pack("<Q", 0)
    (folder / "cameras.bin").write_bytes(struct.pack("<Q", VIEWS) + rows)
    (folder / "images.bin").write_bytes(struct.pack("<Q", VIEWS) + images)
    body = b"".join(struct.pack("<Q3d3BdQ", i + 1, *p, 9, 9, 9, 0.1, 0) for i, p in enumerate(points))
    (folder / "points3D.bin").write_bytes(struct.pack("<Q", len(points)) + body)
    assert colmap_model.is_model(folder)


def _videos(made: Scene, folder: Path) -> Iterator[Good]:
    for ending in ("mp4", "avi"):
        own = _in(folder, f"video-{ending}")
        writer = cv2.VideoWriter(str(own / f"v.{ending}"), cv2.VideoWriter_fourcc(*"mp4v"), 30, (WIDTH, HEIGHT))
        assert writer.isOpened()
        for i in range(24):
            writer.write(np.roll(made.photos[i // 4], 9 * i, 1)[..., ::-1].copy())
        writer.release()
        yield Good(own.name, (f"v.{ending}", "--frames", "6"), (f"v.{ending}",))


def _meshes(made: Scene, folder: Path) -> Iterator[Good]:
    def export(ending: str, **options: object) -> Callable[[Path], object]:
        return lambda path: made.mesh.export(path, file_type=ending, **options)

    writers = {
        "obj": ("a.obj", export("obj"), True),
        "ply-binary": ("a.ply", export("ply"), False),
        "ply-text": ("a.ply", export("ply", encoding="ascii"), True),
        "stl-binary": ("a.stl", export("stl"), False),
        "stl-text": ("a.stl", export("stl_ascii"), True),
        "off": ("a.off", export("off"), True),
        "glb": ("a.glb", export("glb"), False),
    }
    for name, (file, write, text) in writers.items():
        own = _in(folder, f"mesh-{name}")
        write(own / file)
        yield Good(own.name, (file,), (file,), text)
    own = _in(folder, "mesh-gltf")
    for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(made.mesh)).items():
        (own / name).write_bytes(data)
    buffers = sorted(p.name for p in own.glob("*.bin"))
    yield Good(own.name, ("model.gltf",), ("model.gltf",), text=True)
    yield Good("mesh-gltf", ("model.gltf",), (buffers[0],))


def _clouds(made: Scene, folder: Path) -> Iterator[Good]:
    points = trimesh.sample.sample_surface(made.mesh, 1500, seed=0)[0]
    rows = "\n".join(" ".join(f"{v:.6f}" for v in p) for p in points) + "\n"
    head = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1500\nHEIGHT 1\n"
    head += "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1500\nDATA "
    files = {
        "cloud-xyz": ("a.xyz", rows.encode(), True),
        "cloud-csv": ("a.csv", rows.replace(" ", ",").encode(), True),
        "cloud-pcd-text": ("a.pcd", (head + "ascii\n" + rows).encode(), True),
        "cloud-pcd-binary": ("a.pcd", (head + "binary\n").encode() + points.astype("<f4").tobytes(), False),
        "cloud-ply": ("a.ply", _ply(points, {}), False),
    }
    for name, (file, data, text) in files.items():
        (_in(folder, name) / file).write_bytes(data)
        yield Good(name, (file,), (file,), text)
    np.save(_in(folder, "cloud-npy") / "a.npy", points)
    yield Good("cloud-npy", ("a.npy",), ("a.npy",))
    np.savez_compressed(_in(folder, "cloud-npz") / "a.npz", points=points)
    yield Good("cloud-npz", ("a.npz",), ("a.npz",))


def _ply(points: np.ndarray, extra: dict[str, float]) -> bytes:
    """A binary PLY of points, with more properties of one value each."""
    names = ["x", "y", "z", *extra]
    table = np.column_stack([points, *(np.full(len(points), v) for v in extra.values())]).astype("<f4")
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    head += [*(f"property float {n}" for n in names), "end_header", ""]
    return "\n".join(head).encode() + table.tobytes()


def _splats(made: Scene, folder: Path) -> Iterator[Good]:
    points = trimesh.sample.sample_surface(made.mesh, 1500, seed=0)[0]
    extra = {"opacity": 4.0, "scale_0": -5.0, "scale_1": -5.0, "scale_2": -5.0, "rot_0": 1.0}
    extra |= {"rot_1": 0.0, "rot_2": 0.0, "rot_3": 0.0, "f_dc_0": 0.1, "f_dc_1": 0.1, "f_dc_2": 0.1}
    (_in(folder, "splat") / "a.ply").write_bytes(_ply(points, extra))
    yield Good("splat", ("a.ply",), ("a.ply",))
    own = _in(folder, "splat-and-cameras")
    (own / "a.ply").write_bytes(_ply(points, extra))
    content = camera_export.transforms(made.cameras, [f"photos/{n}" for n in made.cameras.names], [""] * VIEWS)
    (own / "transforms.json").write_text(json.dumps(content))
    yield Good(own.name, ("a.ply", "--cameras", "transforms.json"), ("a.ply", "transforms.json"))


def _others_programs(made: Scene, folder: Path) -> Iterator[Good]:
    points = trimesh.sample.sample_surface(made.mesh, 1500, seed=0)[0]
    for name, (file, text) in more_shapes.write(made.mesh, points, folder).items():
        yield Good(name, (file,), (file,), text)


def _voxels(made: Scene, folder: Path) -> Iterator[Good]:
    grid = np.zeros((32, 32, 32), bool)
    cells = ((trimesh.sample.sample_surface(made.mesh, 9000, seed=0)[0] + 0.5) * 31).round().astype(int)
    grid[tuple(cells.clip(0, 31).T)] = True
    np.save(_in(folder, "voxels-npy") / "a.npy", grid)
    yield Good("voxels-npy", ("a.npy",), ("a.npy",))
    np.savez_compressed(_in(folder, "voxels-npz") / "a.npz", voxels=grid)
    yield Good("voxels-npz", ("a.npz",), ("a.npz",))
    flat = grid.transpose(0, 2, 1).ravel()
    runs = b"".join(struct.pack("BB", int(v), 1) for v in flat)
    head = b"#binvox 1\ndim 32 32 32\ntranslate 0 0 0\nscale 1\ndata\n"
    (_in(folder, "voxels-binvox") / "a.binvox").write_bytes(head + runs)
    yield Good("voxels-binvox", ("a.binvox",), ("a.binvox",))


def _others(made: Scene, folder: Path) -> Iterator[Good]:
    """A class file, and catalogues and records for the tables."""
    own = _in(folder, "class-file")
    made.mesh.export(own / "a.obj")
    source = Path(load("chair").build.__code__.co_filename)
    (own / "mine.py").write_bytes(source.read_bytes())
    yield Good(own.name, ("a.obj", "--class", "mine.py"), ("mine.py",), text=True)
    own = _in(folder, "catalogue")
    table = "id#1=a\nname#1=Chair\ncategory#1=Seats\nmodel#1=/a/chair.obj\nwidth#1=44\ndepth#1=45\nheight#1=94\n"
    with zipfile.ZipFile(own / "a.sh3f", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("PluginFurnitureCatalog.properties", table)
        archive.writestr("a/chair.obj", made.mesh.export(file_type="obj"))
    yield Good(own.name, ("a.sh3f", "--picture", "sheet.jpg"), ("a.sh3f",), command=AXES)
    yield Good(own.name, ("a.sh3f",), ("a.sh3f",))
    own = _in(folder, "pix3d-data")
    for part in ("img", "mask", "model"):
        (own / "data" / part / "chair").mkdir(parents=True)
    Image.fromarray(made.photos[0]).save(own / "data/img/chair/0007.jpg")
    _mask(made.masks[0], own / "data/mask/chair/0007.png")
    made.mesh.export(own / "data/model/chair/a.obj")
    record = {**_record(made), "model": "model/chair/a.obj", "voxel": ""}
    (own / "data/pix3d.json").write_text(json.dumps([record]))
    yield Good(own.name, ("data", "--picture", "sheet.jpg"), ("data/pix3d.json",), text=True, command=AXES)
